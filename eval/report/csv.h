// Comma-separated values that measuring programs have written.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace palpate::eval {

/// Comments "# name: value", then a line of column names, then rows.
struct CsvFile {
  std::map<std::string, std::string> facts;              ///< of the comments
  std::vector<std::map<std::string, std::string>> rows;  ///< by column
  int num_damaged = 0;                                   ///< rows that were cut off

  std::string fact(const std::string& name) const;  ///< empty: there is none
};
/// No rows if there is no such file.
CsvFile read_csv(const std::filesystem::path& path);

/// The whole text as a finite number.
std::optional<double> finite_number(const std::string& text);

/// "boundary/spheres:1000" by '/' and ':' is {boundary: "", spheres: "1000"}.
std::map<std::string, std::string> named_values(const std::string& text, char between, char is);

}  // namespace palpate::eval
