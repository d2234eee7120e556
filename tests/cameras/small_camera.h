// Size of the images of a scripted camera, and what its notes say.
#pragma once

#include <string>
#include <vector>

namespace palpate::test {

inline constexpr int kWidth = 32, kHeight = 24;

inline std::string joined(const std::vector<std::string>& notes) {
  std::string all;
  for (const std::string& note : notes) all += note + "\n";
  return all;
}
inline bool has(const std::string& text, const std::string& words) {
  return text.find(words) != std::string::npos;
}

}  // namespace palpate::test
