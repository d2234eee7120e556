// Data of a report, read from its page.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "src/pages/internal/pages.h"

/// Ends the test in a build without pages.
#define PALPATE_PAGES_OR_SKIP() \
  if (palpate::report_template().empty()) GTEST_SKIP() << "this build has no pages"

namespace palpate::test {

/// The JSON inside the page; what follows must be what the template has there.
inline nlohmann::json report_data(const std::string& page) {
  const std::string begin = "<script type=\"application/json\" id=\"data\">", end = "</script>";
  const std::size_t at = page.find(begin);
  if (at == std::string::npos) return nullptr;
  const std::size_t from = at + begin.size();
  return nlohmann::json::parse(page.substr(from, page.find(end, from) - from));
}

inline nlohmann::json report_data_of(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return report_data({std::istreambuf_iterator<char>(file), {}});
}

/// Decodes base64 of RFC 4648, by the letters themselves.
inline std::string from_base64(const std::string& text) {
  const std::string letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string bytes;
  std::uint32_t bits = 0;
  int num_bits = 0;
  for (const char c : text) {
    if (c == '=') break;
    bits = bits << 6 | static_cast<std::uint32_t>(letters.find(c));
    num_bits += 6;
    if (num_bits < 8) continue;
    num_bits -= 8;
    bytes += static_cast<char>(bits >> num_bits & 0xff);
  }
  return bytes;
}

/// Numbers as they lie in memory.
template <class Value>
std::vector<Value> from_packed(const std::string& base64) {
  const std::string bytes = from_base64(base64);
  std::vector<Value> values(bytes.size() / sizeof(Value));
  std::memcpy(values.data(), bytes.data(), values.size() * sizeof(Value));
  return values;
}

}  // namespace palpate::test
