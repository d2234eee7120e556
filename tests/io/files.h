// Files for tests: a folder that goes away, and files with damage.
#pragma once

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "tests/test_util/temporary_folder.h"

namespace palpate::test {

inline void write_bytes(const std::filesystem::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary).write(bytes.data(), std::streamsize(bytes.size()));
}

inline std::string read_bytes(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// The bytes of plain values, one after the other.
template <class... Values>
std::string bytes_of(const Values&... values) {
  std::string bytes;
  (bytes.append(reinterpret_cast<const char*>(&values), sizeof(values)), ...);
  return bytes;
}

/// Cuts a good file at up to `num_cuts` lengths and calls check(path, length) for each.
template <class Check>
void for_each_truncation(const std::filesystem::path& good, std::size_t num_cuts, Check&& check) {
  const std::string bytes = read_bytes(good);
  const std::filesystem::path cut = good.parent_path() / ("cut" + good.extension().string());
  const std::size_t step = std::max<std::size_t>(1, bytes.size() / num_cuts);
  for (std::size_t length = 0; length < bytes.size(); length += step) {
    write_bytes(cut, bytes.substr(0, length));
    check(cut, length);
  }
}

/// A message says what file is meant and ends with a hint.
template <class Loaded>
void expect_error(const Loaded& loaded, const std::string& words) {
  ASSERT_FALSE(loaded.has_value());
  EXPECT_NE(loaded.error().message.find(words), std::string::npos) << loaded.error().message;
}

}  // namespace palpate::test
