// wrench.csv read back.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

namespace palpate::test {

/// The columns by name.
inline std::map<std::string, std::vector<double>> columns_of(const std::filesystem::path& csv) {
  std::ifstream lines(csv);
  std::string line, word;
  std::getline(lines, line);
  std::vector<std::string> names;
  for (std::istringstream words(line); std::getline(words, word, ',');) names.push_back(word);
  std::map<std::string, std::vector<double>> columns;
  while (std::getline(lines, line)) {
    std::size_t i = 0;
    for (std::istringstream words(line); std::getline(words, word, ','); ++i) {
      columns[names.at(i)].push_back(std::stod(word));
    }
    EXPECT_EQ(i, names.size());
  }
  return columns;
}

}  // namespace palpate::test
