// The table of features in docs/backends.md: every row is checked on both backends, on a GPU or by
// the emulator, and the text in the page is the one made here.
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>

#include <gtest/gtest.h>

#include "tests/backends/backend_features.h"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

using test::Feature;
using test::FeatureGroup;

void expect_alike(const std::vector<FeatureGroup>& groups) {
  for (const FeatureGroup& group : groups) {
    for (const Feature& feature : group.features) {
      SCOPED_TRACE(group.title + ": " + feature.name);
      feature.check(feature.allowed);
    }
  }
}

TEST(BackendFeatures, SensingIsAlike) {
  PALPATE_GPU_OR_SKIP();
  expect_alike(test::sensing_features());
}

TEST(BackendFeatures, ContactIsAlike) {
  PALPATE_GPU_OR_SKIP();
  expect_alike(test::contact_features());
}

/// 1e-5, or none.
std::string as_power_of_ten(double allowed) {
  return allowed > 0 ? "1e" + std::to_string(std::lround(std::log10(allowed))) : "none";
}

std::string table() {
  std::ostringstream text;
  for (const auto& groups : {test::sensing_features(), test::contact_features()}) {
    for (const FeatureGroup& group : groups) {
      text << "\n| " << group.title << " | CPU | CUDA | largest relative difference |\n"
           << "|---|---|---|---|\n";
      for (const Feature& feature : group.features) {
        text << "| " << feature.name << " | " << feature.on_cpu << " | " << feature.on_cuda << " | "
             << as_power_of_ten(feature.allowed) << " |\n";
      }
    }
  }
  text << "\n";
  return text.str();
}

TEST(BackendFeatures, AreInTheDocumentation) {
  const std::string path = PALPATE_SOURCE_DIR "/docs/backends.md";
  const std::string begin = "<!-- features: begin -->\n", end = "<!-- features: end -->";
  std::ifstream file(path);
  std::stringstream content;
  content << file.rdbuf();
  std::string page = content.str();
  const std::size_t from = page.find(begin), to = page.find(end);
  ASSERT_TRUE(from < to && to != std::string::npos) << path << " lacks the marks of the table";
  const std::size_t start = from + begin.size();
  if (std::getenv("PALPATE_WRITE_DOCS") != nullptr) {
    page.replace(start, to - start, table());
    ASSERT_TRUE(std::ofstream(path) << page);
  } else {
    EXPECT_EQ(page.substr(start, to - start), table())
        << path << " is not what this test checks: rewrite its table with\n"
        << "  PALPATE_WRITE_DOCS=1 build/release/bin/test_backend_features";
  }
}

}  // namespace
}  // namespace palpate
