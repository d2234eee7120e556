#include "eval/report/csv.h"

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <sstream>

namespace palpate::eval {
namespace {

/// Splits a line; fields may be quoted.
std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> fields(1);
  bool is_quoted = false;
  for (const char c : line) {
    if (c == '"') {
      is_quoted = !is_quoted;
    } else if (c == ',' && !is_quoted) {
      fields.emplace_back();
    } else {
      fields.back() += c;
    }
  }
  return fields;
}

}  // namespace

std::string CsvFile::fact(const std::string& name) const {
  const auto found = facts.find(name);
  return found == facts.end() ? "" : found->second;
}

CsvFile read_csv(const std::filesystem::path& path) {
  CsvFile result;
  std::ifstream file(path);
  std::vector<std::string> columns;
  for (std::string line; std::getline(file, line);) {
    if (line.ends_with('\r')) line.pop_back();
    if (line.empty()) continue;
    if (line.starts_with('#')) {
      const std::size_t colon = line.find(": ");
      if (colon != std::string::npos && line.starts_with("# ")) {
        result.facts[line.substr(2, colon - 2)] = line.substr(colon + 2);
      }
      continue;
    }
    const std::vector<std::string> fields = split(line);
    if (columns.empty()) {
      columns = fields;
    } else if (fields.size() != columns.size()) {
      ++result.num_damaged;
    } else {
      auto& row = result.rows.emplace_back();
      for (std::size_t i = 0; i < columns.size(); ++i) row[columns[i]] = fields[i];
    }
  }
  return result;
}

std::optional<double> finite_number(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0' || !std::isfinite(value)) return std::nullopt;
  return value;
}

std::map<std::string, std::string> named_values(const std::string& text, char between, char is) {
  std::map<std::string, std::string> values;
  std::istringstream parts(text);
  for (std::string part; std::getline(parts, part, between);) {
    const std::size_t at = part.find(is);
    values[part.substr(0, at)] = at == std::string::npos ? "" : part.substr(at + 1);
  }
  return values;
}

}  // namespace palpate::eval
