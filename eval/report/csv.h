// Reader of CSV files of measuring programs.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace palpate::eval {

/// Comments "# name: value", then a line of column names, then rows.
struct CsvFile {
  std::map<std::string, std::string> facts;              ///< of the comment lines
  std::vector<std::map<std::string, std::string>> rows;  ///< by column
  int num_damaged = 0;                                   ///< truncated rows

  std::string fact(const std::string& name) const;  ///< empty if absent
};
/// Reads a file; without one the result has no rows.
CsvFile read_csv(const std::filesystem::path& path);

/// Parses the whole text as a finite number.
std::optional<double> finite_number(const std::string& text);

/// Splits "boundary/spheres:1000" by '/' and ':' into {boundary: "", spheres: "1000"}.
std::map<std::string, std::string> named_values(const std::string& text, char between, char is);

}  // namespace palpate::eval
