#include "palpate/session/run_folder.h"

#include <gtest/gtest.h>

#include <fstream>
#include <optional>

#include "tests/session/synthetic_stream.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

void touch(const fs::path& path) {
  fs::create_directories(path.parent_path());
  std::ofstream(path) << "x";
}

TEST(RunFolder, AppearsOnCommitOnly) {
  const test::TemporaryFolder root;
  const fs::path target = root.path() / "run";
  {
    auto folder = RunFolder::create(target);
    ASSERT_TRUE(folder) << folder.error().message;
    touch(folder->partial() / "file");
    EXPECT_FALSE(fs::exists(target));
  }
  EXPECT_TRUE(fs::is_empty(root.path()));
  auto folder = RunFolder::create(target.string() + "/");
  ASSERT_TRUE(folder) << folder.error().message;
  touch(folder->partial() / "file");
  ASSERT_TRUE(folder->commit());
  EXPECT_TRUE(fs::exists(target / "file"));
}

TEST(RunFolder, ReplacesARunWhole) {
  const test::TemporaryFolder root;
  const fs::path target = root.path() / "run";
  touch(target / kRecordingFolder / kRecordingManifest);
  touch(target / "old");
  // What a killed run leaves behind is cleared away.
  touch(root.path() / "run.partial" / kRecordingFolder / kRecordingManifest);
  auto folder = RunFolder::create(target);
  ASSERT_TRUE(folder) << folder.error().message;
  touch(folder->partial() / "new");
  ASSERT_TRUE(folder->commit());
  EXPECT_TRUE(fs::exists(target / "new"));
  EXPECT_FALSE(fs::exists(target / "old"));
  EXPECT_EQ(std::distance(fs::directory_iterator(root.path()), {}), 1);
}

TEST(RunFolder, LeavesOtherThingsAlone) {
  const test::TemporaryFolder root;
  touch(root.path() / "folder" / "thesis.tex");
  touch(root.path() / "file");
  touch(root.path() / "half.partial" / "thesis.tex");
  for (const fs::path& target :
       {root.path() / "folder", root.path() / "file", root.path() / "half",
        root.path() / "no" / "such" / "parent", fs::path("/"), root.path()}) {
    EXPECT_FALSE(RunFolder::create(target)) << target;
  }
  EXPECT_TRUE(fs::exists(root.path() / "folder" / "thesis.tex"));
  EXPECT_TRUE(fs::exists(root.path() / "half.partial" / "thesis.tex"));
}

}  // namespace
}  // namespace palpate
