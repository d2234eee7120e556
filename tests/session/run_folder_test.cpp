#include "src/session/internal/run_folder.h"

#include <gtest/gtest.h>

#include <fstream>
#include <optional>

#include "src/session/recording/run_recorder.h"
#include "tests/session/synthetic_stream.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

void touch(const fs::path& path) {
  fs::create_directories(path.parent_path());
  std::ofstream(path) << "x";
}

/// An earlier run with all its names.
void make_run(const fs::path& folder) {
  for (const char* name :
       {"wrench.csv", "wrench.csv.part", "summary.json", "report.html", ".palpate.7.0.part"}) {
    touch(folder / name);
  }
  RunSetup setup;
  setup.streams.resize(1);
  auto recorder = RunRecorder::create(folder / kRecordingFile, test::small_tool(), setup, true);
  ASSERT_TRUE(recorder) << recorder.error().message;
  recorder->finish();
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
  make_run(target);
  // Leftovers of a killed run are cleared away: no process has the largest number.
  make_run(root.path() / "run.partial-2147483647");
  auto folder = RunFolder::create(target);
  ASSERT_TRUE(folder) << folder.error().message;
  touch(folder->partial() / "new");
  ASSERT_TRUE(folder->commit());
  EXPECT_TRUE(fs::exists(target / "new"));
  EXPECT_FALSE(fs::exists(target / "wrench.csv"));
  EXPECT_EQ(std::distance(fs::directory_iterator(root.path()), {}), 1);
}

TEST(RunFolder, ClearsLeftoversOfAPlainName) {
  const test::TemporaryFolder root;
  const fs::path before = fs::current_path();
  fs::current_path(root.path());
  make_run("run.partial-2147483647");
  EXPECT_TRUE(RunFolder::create("run"));
  EXPECT_FALSE(fs::exists("run.partial-2147483647"));
  fs::current_path(before);
}

TEST(RunFolder, ARunWithoutANameIsRefused) {
  const auto folder = RunFolder::create("");
  ASSERT_FALSE(folder);
  EXPECT_NE(folder.error().message.find("needs a name"), std::string::npos);
  EXPECT_FALSE(lies_inside("file", ""));
}

TEST(RunFolder, LeavesOtherThingsAlone) {
  const test::TemporaryFolder root;
  touch(root.path() / "folder" / "thesis.tex");
  touch(root.path() / "file");
  touch(root.path() / "run.partial-2147483647" / "thesis.tex");
  for (const fs::path& target :
       {root.path() / "folder", root.path() / "file", root.path() / "no" / "such" / "parent",
        fs::path("/"), root.path()}) {
    EXPECT_FALSE(RunFolder::create(target)) << target;
  }
  EXPECT_TRUE(fs::exists(root.path() / "folder" / "thesis.tex"));
  EXPECT_TRUE(fs::exists(root.path() / "run.partial-2147483647" / "thesis.tex"));
}

TEST(RunFolder, KeepsARunThatHoldsMoreThanARun) {
  for (const char* name :
       {"notes.txt", "wrench.csv.bak", "recording/more.txt", "recording2.mcap", "figures/a.png"}) {
    const test::TemporaryFolder root;
    make_run(root.path() / "run");
    EXPECT_TRUE(RunFolder::create(root.path() / "run"));
    touch(root.path() / "run" / name);
    const auto folder = RunFolder::create(root.path() / "run");
    ASSERT_FALSE(folder) << name;
    EXPECT_NE(folder.error().message.find("files that are not of an earlier run"),
              std::string::npos);
    EXPECT_TRUE(fs::exists(root.path() / "run" / name));
  }
  for (const char* recording : {"x", "", "\x89MCAP0\r\n"}) {
    const test::TemporaryFolder root;
    make_run(root.path() / "run");
    std::ofstream(root.path() / "run" / kRecordingFile) << recording;
    EXPECT_FALSE(RunFolder::create(root.path() / "run")) << recording;
  }
}

TEST(RunFolder, ThingsAddedDuringTheRunStay) {
  const test::TemporaryFolder root;
  make_run(root.path() / "run");
  auto folder = RunFolder::create(root.path() / "run");
  ASSERT_TRUE(folder) << folder.error().message;
  touch(root.path() / "run" / "notes.txt");
  EXPECT_FALSE(folder->commit());
  EXPECT_TRUE(fs::exists(root.path() / "run" / "notes.txt"));
}

TEST(RunFolder, RunsOfOneNameDoNotDisturbEachOther) {
  const test::TemporaryFolder root;
  auto first = RunFolder::create(root.path() / "run");
  auto second = RunFolder::create(root.path() / "run");
  ASSERT_TRUE(first && second);
  EXPECT_NE(first->partial(), second->partial());
  make_run(first->partial());
  make_run(second->partial());
  touch(second->partial() / "second");
  EXPECT_TRUE(first->commit());
  // The folder of a run that goes on cannot be taken; once it has ended, the last one counts.
  EXPECT_FALSE(second->commit());
  EXPECT_FALSE(fs::exists(root.path() / "run" / "second"));
  { const RunFolder ended = *std::move(first); }
  EXPECT_TRUE(second->commit());
  EXPECT_TRUE(fs::exists(root.path() / "run" / "second"));
  EXPECT_EQ(std::distance(fs::directory_iterator(root.path()), {}), 1);
}

TEST(RunFolder, KnowsWhatLiesInside) {
  const test::TemporaryFolder root;
  make_run(root.path() / "run");
  const fs::path run = root.path() / "run";
  fs::create_directory_symlink(run, root.path() / "link");
  for (const fs::path& path : {run, run / "recording.mcap", run / "some" / ".." / "new",
                               root.path() / "link" / "wrench.csv"}) {
    EXPECT_TRUE(lies_inside(path, run)) << path;
    EXPECT_TRUE(lies_inside(path, run.string() + "/")) << path;
  }
  for (const fs::path& path : {root.path(), root.path() / "run2", run / ".." / "tool.palp"}) {
    EXPECT_FALSE(lies_inside(path, run)) << path;
  }
}

}  // namespace
}  // namespace palpate
