// Times of single calls, and rows of results in the columns of bench/results, for the benchmark
// programs of our own.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "palpate/core/core.h"

namespace palpate::bench {

[[noreturn]] inline void stop(const Error& error) {
  std::fprintf(stderr, "%s\n", error.message.c_str());
  std::exit(1);
}

template <class T>
T value_or_stop(Result<T> result) {
  if (!result) stop(result.error());
  return std::move(result).value();
}

using Clock = std::chrono::steady_clock;

inline double microseconds_since(Clock::time_point start) {
  return std::chrono::duration<double, std::micro>(Clock::now() - start).count();
}

/// Distribution of the times of single calls, microseconds.
struct CallTimes {
  std::size_t num = 0;
  double median = 0, p99 = 0, p999 = 0, max = 0, mean = 0;
  double deviation = NAN;  ///< NaN: not known
};

inline CallTimes call_times(std::vector<double> microseconds) {
  std::sort(microseconds.begin(), microseconds.end());
  const auto num = static_cast<double>(microseconds.size());
  const auto at = [&](double share) {
    return microseconds[static_cast<std::size_t>(share * (num - 1))];
  };
  double mean = 0, squares = 0;
  for (const double t : microseconds) mean += t / num;
  for (const double t : microseconds) squares += (t - mean) * (t - mean);
  return {microseconds.size(),     at(0.5), at(0.99), at(0.999), microseconds.back(), mean,
          std::sqrt(squares / num)};
}

/// Formats facts of a row: "key=value key=value".
[[gnu::format(printf, 1, 2)]] inline std::string facts(const char* format, ...) {
  char text[400];
  std::va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  return text;
}

/// Returns the name of the processor.
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

/// Returns the commit that the environment variable PALPATE_COMMIT names.
inline std::string commit() {
  const char* const name = std::getenv("PALPATE_COMMIT");
  return name == nullptr ? "" : name;
}

/// Rows of one program in the columns of bench/record_results.py: to a file, with a line for people
/// on standard output, or without a file on standard output themselves.
class ResultRows {
 public:
  ResultRows(int argc, char** argv, std::string machine_name = machine())
      : machine_(std::move(machine_name)), load_(machine_load()) {
    program_ = argv[0];
    program_.erase(0, program_.rfind('/') + 1);
    for (int i = 0; i < argc; ++i) command_ += (i > 0 ? " " : "") + std::string(argv[i]);
  }
  ~ResultRows() { close(); }
  ResultRows(const ResultRows&) = delete;
  ResultRows& operator=(const ResultRows&) = delete;

  /// Opens the file and prints the names of the columns; "": standard output.
  bool open(const std::string& path) {
    file_ = path.empty() ? stdout : std::fopen(path.c_str(), "w");
    if (file_ == nullptr) {
      std::fprintf(stderr, "%s: cannot write %s\n", program_.c_str(), path.c_str());
      return false;
    }
    std::fputs(
        "date,commit,machine,isa,program,case,calls,median_us,p99_us,p99.9_us,max_us,cpu_us,facts,"
        "load_before,command,note\n",
        file_);
    return true;
  }
  /// False: something was not written.
  bool close() {
    std::FILE* const file = std::exchange(file_, nullptr);
    return file == nullptr || file == stdout || std::fclose(file) == 0;
  }

  /// Adds a row of times.
  void times(const std::string& name, const CallTimes& t, const std::string& more_facts = "") {
    const std::string numbers =
        facts("%zu,%.2f,%.2f,%.2f,%.2f", t.num, t.median, t.p99, t.p999, t.max);
    std::string all = facts("mean_us=%.2f", t.mean);
    if (!std::isnan(t.deviation)) all += facts(" deviation_us=%.2f", t.deviation);
    if (!more_facts.empty()) all += " " + more_facts;
    add(name, numbers, all,
        facts("%10.2f us median %10.2f us p99 %10.2f us max", t.median, t.p99, t.max));
  }
  /// Adds a row of facts.
  void add(const std::string& name, const std::string& its_facts) {
    add(name, ",,,,", its_facts, its_facts);
  }
  /// Adds a row of a value, with a goal unless that is NaN.
  void add(const std::string& name, double value, const char* unit, double goal = NAN) {
    add(name, facts("value=%.6g unit=%s", value, unit) +
                  (std::isnan(goal) ? "" : facts(" goal=%g", goal)));
  }

 private:
  void add(const std::string& name, const std::string& numbers, const std::string& its_facts,
           const std::string& for_people) {
    std::fprintf(file_, "%s,%s,%s,,%s,%s,%s,,%s,%.1f,%s,\n", today().c_str(), commit().c_str(),
                 quoted(machine_).c_str(), program_.c_str(), quoted(name).c_str(), numbers.c_str(),
                 quoted(its_facts).c_str(), load_, quoted(command_).c_str());
    std::fflush(file_);
    if (file_ == stdout) return;
    std::printf("%-64s %s\n", name.c_str(), for_people.c_str());
    std::fflush(stdout);
  }
  static std::string quoted(const std::string& text) {
    return text.find(',') == text.npos ? text : '"' + text + '"';
  }

  std::string machine_, program_, command_;
  double load_;
  std::FILE* file_ = nullptr;
};

}  // namespace palpate::bench
