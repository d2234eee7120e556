// Time and place of a measurement, for the head of its file.
#pragma once

#include <cstdlib>
#include <ctime>
#include <fstream>
#include <string>

namespace palpate::bench {

inline std::string machine() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    if (line.rfind("model name", 0) == 0) return line.substr(line.find(':') + 2);
  }
  return "unknown";
}

inline std::string today() {
  const std::time_t now = std::time(nullptr);
  char text[11];
  std::strftime(text, sizeof text, "%F", std::gmtime(&now));
  return text;
}

/// Returns the load average of the last minute.
inline double machine_load() {
  double load = 0;
  getloadavg(&load, 1);
  return load;
}

}  // namespace palpate::bench
