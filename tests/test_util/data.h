// The optional folder of real data, and tests that run on them and on made ones alike.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include <gtest/gtest.h>

namespace palpate::test {

/// PALPATE_DATA, or ../shared/data beside the checkout; nullopt if there is none.
std::optional<std::filesystem::path> data_folder();

/// Path of one data file; skips the test by name when the data are not there.
#define PALPATE_DATA_OR_SKIP(variable, relative)                                       \
  const auto variable##_folder = ::palpate::test::data_folder();                       \
  if (!variable##_folder)                                                              \
    GTEST_SKIP() << "SKIPPED: no real data for " << relative << " (set PALPATE_DATA)"; \
  const std::filesystem::path variable = *variable##_folder / relative

/// Origin of a test's data.
enum class Origin { recorded, made };

inline std::string name_of(const testing::TestParamInfo<Origin>& origin) {
  return origin.param == Origin::recorded ? "recorded" : "made";
}

}  // namespace palpate::test
