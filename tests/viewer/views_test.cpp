// Data of the page's sources: against queries that are made anew, and against the recordings.
#include "palpate/viewer/viewer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>

#include "src/io/internal/atomic_file.h"
#include "src/session/internal/run_folder.h"
#include "src/viewer/protocol/command.h"
#include "src/viewer/protocol/messages.h"
#include "src/viewer/sources/recorded_run.h"
#include "src/viewer/sources/repetition.h"
#include "tests/session/other_unit_stream.h"
#include "tests/viewer/message_reader.h"
#include "tests/viewer/path_view.h"
#include "tests/viewer/watcher.h"

namespace palpate {
namespace {

using namespace test::path_view;  // NOLINT: all of it
using Json = nlohmann::ordered_json;
using test::pressing_pose;
using test::small_tool;
using test::SyntheticStream;
using test::TemporaryFolder;
using test::Watcher;

TEST(ToolView, ShowsTheToolAndNothingElse) {
  const Tool tool = small_tool();
  const auto view = view_tool(tool, "small");
  EXPECT_EQ(view->content().kind, "tool");
  EXPECT_EQ(view->content().title, "small");
  EXPECT_EQ(view->content().tool, &tool);
  EXPECT_TRUE(view->content().streams.empty());
  EXPECT_EQ(view->controls(), "[]");
  Watcher watcher(*view);
  watcher.poll();
  EXPECT_FALSE(watcher.frame || watcher.contact || watcher.surface);
  EXPECT_EQ(watcher.state()["frame_number"], 0);
  for (const char* command : {"pause", "seek", "set", "end"}) {
    EXPECT_FALSE(watcher.command({{"command", command}})) << command;
  }
  for (const char* text : {"", "no JSON", "[]", "7", R"({"command": 3})"}) {
    EXPECT_FALSE(view->command(text)) << text;
  }
}

TEST(ViewCommand, ThatNoPageWouldSendIsRefusedBeforeItIsTaken) {
  EXPECT_TRUE(ViewCommand::parse(R"({"command": "set", "value": [0, 0, 0.1, 0, 0, 0, 1]})"));
  std::string many = R"({"command": "pause")";
  for (int i = 0; i < 5000; ++i) many += ",\"" + std::to_string(i) + "\":0";
  const std::string deep = std::string(1000, '[') + std::string(1000, ']');
  for (const auto& [text, fault] :
       {std::pair(many + "}", "more than 64 members"),
        std::pair(R"({"command": "set", "value": )" + deep + "}", "more than 16 levels"),
        std::pair(std::string(R"({"command": "pause", "command": "end"})"), "twice")}) {
    const auto command = ViewCommand::parse(text);
    ASSERT_FALSE(command) << fault;
    EXPECT_NE(command.error().message.find(fault), std::string::npos) << command.error().message;
    EXPECT_LT(command.error().message.size(), 200u);
  }
}

void expect_exact_seeks(const RunSettings& settings, int num_frames) {
  const TemporaryFolder folder;
  record_path(folder.path() / "run", settings, num_frames);
  auto view = view_run(folder.path() / "run");
  ASSERT_TRUE(view) << view.error().message;
  Watcher watcher(**view);
  watcher.execute({{"command", "pause"}});
  for (const int tick_number : {61, 7, 40, 0, 41, 62}) {
    const double time = tick_number / kRate;
    watcher.contact = nullptr;
    watcher.execute({{"command", "seek"}, {"time", time + 1e-4}});
    ASSERT_TRUE(watcher.until([&] {
      return watcher.contact != nullptr && watcher.contact->time == time;
    })) << time;
    ASSERT_TRUE(watcher.until([&] {
      return watcher.frame->number == watcher.contact->frame_number &&
             watcher.surface->frame_number == watcher.contact->frame_number;
    }));
    play_to(static_cast<std::size_t>(tick_number), settings, num_frames, [&](Pipeline& pipeline) {
      expect_same(*watcher.contact, pipeline);
      EXPECT_EQ(watcher.contact->X_WT, pipeline.contact().X_WT);
      EXPECT_EQ(watcher.frame->number, pipeline.contact().frame_number);
      const PointCloud seen = pipeline.newest_cloud();
      for (std::size_t i = 0; i < seen.size(); i += 7) {
        const Vec3f shown = watcher.surface->points[i];
        EXPECT_TRUE(shown == seen.point(i) || (std::isnan(shown.x) && std::isnan(seen.point(i).x)));
      }
    });
  }
}

TEST(RunView, ASeekShowsWhatTheRunFelt) { expect_exact_seeks(path_settings(), 12); }

TEST(RunView, ASeekShowsWhatTheRunFeltWithTheNewestFrame) {
  expect_exact_seeks(path_settings(TimeMode::latest), 12);
}

TEST(RunView, ASeekShowsWhatTheRunFeltWhenItPredicts) {
  RunSettings settings = path_settings(TimeMode::predict);
  settings.contact.method = MethodKind::graph;
  expect_exact_seeks(settings, 12);
}

TEST(RunView, ASeekShowsWhatTheRunFeltWithAnAverage) {
  RunSettings settings = path_settings();
  settings.contact.method = MethodKind::simplified;
  settings.contact.edges = Edges::strict;
  settings.surface.depth_change.enabled = true;
  settings.time.average.kind = DepthAverage::moving;
  settings.time.average.frames = 2;
  settings.time.average.keep_frames = 1;
  expect_exact_seeks(settings, 12);
}

/// Also where the first part is no longer there.
TEST(RunView, ASeekGoesIntoAnyPartOfARecording) {
  const TemporaryFolder folder;
  SyntheticStream stream(120);
  auto device = test::path_device(pressing_pose, kRate);
  RunOptions options;
  options.recording.split_bytes = 1;  // another part every second
  ASSERT_TRUE(
      record_run(small_tool(), stream, **device, path_settings(), folder.path() / "run", options));
  ASSERT_GT(recording_parts(folder.path() / "run").size(), 2u);
  const double start = 1;  // s, of the second part
  Penetration whole;
  for (const bool is_kept_part : {false, true}) {
    if (is_kept_part) std::filesystem::remove(folder.path() / "run" / kRecordingFile);
    auto run = open_recorded_run(folder.path() / "run");
    ASSERT_TRUE(run) << run.error().message;
    const double end = (*run)->duration();
    for (const double time : {end, start + 0.1, (start + end) / 2, start + 0.3}) {
      const auto query = (*run)->query_at(time);
      ASSERT_TRUE(query) << query.error().message;
      EXPECT_NEAR(query->time, time, 1 / kRate);
      const auto frame = (*run)->read_frame(query->frame);
      ASSERT_TRUE(frame) << frame.error().message;
      EXPECT_EQ(frame->shown.number, (*run)->frame_number(query->frame));
    }
    // From the first of its depth images on, and later as in the whole run.
    Repetition repetition(**run);
    for (const double time : {start, start + 0.5}) {
      const auto query = (*run)->query_at(time);
      ASSERT_TRUE(query) << query.error().message;
      ASSERT_TRUE(*repetition.go_to(*query, (*run)->settings(0), [] { return true; }));
      repetition.surface();
      const Penetration repeated = repetition.measure();
      if (!is_kept_part) whole = repeated;
      if (time == start) continue;
      EXPECT_GT(repeated.volume, 0);
      EXPECT_EQ(repeated.volume, whole.volume);
      EXPECT_EQ(repeated.measure_W.force, whole.measure_W.force);
    }
  }
}

TEST(RunView, OpensHalfASecondBeforeTheFirstContact) {
  const TemporaryFolder folder;
  SyntheticStream stream(60);
  const auto late = [](double time) {
    const Pose X_WT = pressing_pose(0);
    return time < 1.2 ? Pose{X_WT.translation - Vec3d{0, 0, 0.2}, X_WT.rotation}
                      : pressing_pose(time - 1.2);
  };
  auto device = test::path_device(late, kRate);
  ASSERT_TRUE(record_run(small_tool(), stream, **device, path_settings(), folder.path() / "run"));
  auto run = open_recorded_run(folder.path() / "run");
  ASSERT_TRUE(run);
  double first = -1;
  const auto ticks = (*run)->samples(-1, 10);
  ASSERT_TRUE(ticks);
  for (const ViewSample& tick : *ticks) {
    if (first < 0 && tick.volume > 0) first = tick.time;
  }
  ASSERT_GE(first, 1.2);
  auto view = view_run(folder.path() / "run");
  ASSERT_TRUE(view);
  Watcher watcher(**view);
  EXPECT_NEAR(watcher.state()["time"].get<double>(), first - 0.5, 1e-9);
  ASSERT_TRUE(watcher.until([&] { return watcher.state()["time"] >= first; }));
}

TEST(RunView, BeginsWhenSomebodyLooksAndStopsAtTheEnd) {
  const TemporaryFolder folder;
  record_path(folder.path() / "run", path_settings());
  auto view = view_run(folder.path() / "run");
  ASSERT_TRUE(view);
  Watcher watcher(**view);
  EXPECT_EQ((*view)->content().kind, "recording");
  EXPECT_EQ((*view)->content().title, "run");
  EXPECT_EQ((*view)->content().streams.front().width, 96);
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(watcher.state()["time"], 0);
  ASSERT_TRUE(watcher.until([&] { return watcher.state()["time"] > 0.05; }));
  ASSERT_TRUE(watcher.until([&] { return watcher.state()["paused"] == true; }));
  const Json end = watcher.state();
  EXPECT_NEAR(end["duration"].get<double>(), 0.4, 1.01 / kRate);
  EXPECT_EQ(end["time"], end["duration"]);
  EXPECT_EQ(end["note"], "the recording has ended: Play (Space) begins it again");
  EXPECT_EQ(end["fault"], nullptr);
  const auto num_ticks =
      static_cast<std::size_t>(std::lround(kRate * end["duration"].get<double>())) + 1;
  ASSERT_TRUE(watcher.until([&] { return watcher.samples.size() == num_ticks; }));
  for (std::size_t i = 0; i < watcher.samples.size(); ++i) {
    EXPECT_EQ(watcher.samples[i].time, static_cast<double>(i) / kRate);
  }
  watcher.execute({{"command", "speed"}, {"factor", 0.02}});
  watcher.execute({{"command", "resume"}});
  ASSERT_TRUE(watcher.until([&] { return watcher.state()["time"] < 0.1; }));
  EXPECT_EQ(watcher.state()["speed"], 0.02);
  EXPECT_EQ(watcher.state()["paused"], false);
}

TEST(RunView, StepsFrameByFrameInBothDirections) {
  const TemporaryFolder folder;
  record_path(folder.path() / "run", path_settings());
  auto view = view_run(folder.path() / "run");
  ASSERT_TRUE(view);
  Watcher watcher(**view);
  watcher.execute({{"command", "pause"}});
  watcher.execute({{"command", "seek"}, {"time", 0.21}});
  const auto is_at = [&](int number) {
    return watcher.until([&] {
      return watcher.frame != nullptr && watcher.contact != nullptr &&
             watcher.frame->number == static_cast<std::uint64_t>(number) &&
             watcher.contact->frame_number == static_cast<std::uint64_t>(number);
    });
  };
  ASSERT_TRUE(is_at(6));
  for (const auto& [step, number] :
       {std::pair(1, 7), {1, 8}, {-1, 7}, {-4, 3}, {-100, 0}, {99, 11}}) {
    watcher.execute({{"command", "step"}, {"frames", step}});
    EXPECT_TRUE(is_at(number)) << step << " to " << number;
    EXPECT_TRUE(watcher.until([&] { return watcher.state()["frame_number"] == number; })) << number;
    EXPECT_EQ(watcher.state()["paused"], true);
  }
  watcher.samples.clear();
  watcher.execute({{"command", "seek"}, {"time", 0.1501}});
  ASSERT_TRUE(watcher.until([&] { return watcher.samples.size() == 31; }))
      << watcher.samples.size();
  EXPECT_EQ(watcher.samples.back().time, 0.15);
  EXPECT_GT(watcher.samples.back().volume, 0);
  EXPECT_LT(watcher.samples.back().contact_W.force.z, -0.01);
  EXPECT_EQ(watcher.samples.back().F_H_B.force, watcher.samples.back().contact_W.force);
  EXPECT_EQ(watcher.samples.back().X_WT.translation, pressing_pose(0.15).translation);
}

TEST(RunView, ShowsWhatWouldHaveBeen) {
  const TemporaryFolder folder;
  record_path(folder.path() / "run", path_settings());
  auto view = view_run(folder.path() / "run");
  ASSERT_TRUE(view);
  Watcher watcher(**view);
  watcher.execute({{"command", "pause"}});
  watcher.execute({{"command", "seek"}, {"time", 0.2}});
  ASSERT_TRUE(watcher.until([&] { return watcher.contact && watcher.contact->time == 0.2; }));
  EXPECT_EQ(watcher.state()["note"], nullptr);
  const auto recorded = watcher.contact;
  const auto answer =
      watcher.command({{"command", "set"}, {"key", "contact.method"}, {"value", "graph"}});
  ASSERT_TRUE(answer) << answer.error().message;
  EXPECT_EQ(Json::parse(*answer)["value"], "graph");
  EXPECT_EQ(watcher.state()["settings"]["contact.method"], "graph");
  EXPECT_EQ(watcher.state()["revision"], 1);
  watcher.contact = nullptr;
  ASSERT_TRUE(watcher.until([&] { return watcher.contact != nullptr; }));
  RunSettings other = path_settings();
  other.contact.method = MethodKind::graph;
  play_to(40, other, 12, [&](Pipeline& pipeline) { expect_same(*watcher.contact, pipeline); });
  EXPECT_NE(watcher.contact->spheres.states, recorded->spheres.states);
  ASSERT_TRUE(watcher.until(
      [&] { return watcher.state()["note"].dump().find("contact.method") != std::string::npos; }));

  // Refused, and nothing has changed.
  for (const Json& command : std::initializer_list<Json>{
           {{"command", "set"}, {"key", "contact.method"}, {"value", "magic"}},
           {{"command", "set"}, {"key", "coupling.stiffness"}, {"value", 5}},
           {{"command", "set"}, {"key", "surface.min_depth"}, {"value", 900}},
           {{"command", "set"}},
           {{"command", "seek"}},
           {{"command", "seek"}, {"time", -1}},
           {{"command", "speed"}, {"factor", 0}},
           {{"command", "step"}, {"frames", "one"}},
           {{"command", "mark"}, {"text", "x"}},
           {{"command", "end"}}}) {
    EXPECT_FALSE(watcher.command(command)) << command;
  }
  EXPECT_EQ(watcher.state()["revision"], 1);

  // And back.
  watcher.execute({{"command", "set"}, {"key", "contact.method"}, {"value", "field"}});
  ASSERT_TRUE(watcher.until([&] { return watcher.state()["note"] == nullptr; }));
  watcher.execute({{"command", "seek"}, {"time", 0.1}});
  ASSERT_TRUE(watcher.until([&] { return watcher.contact->time == 0.1; }));
  watcher.execute({{"command", "seek"}, {"time", 0.2}});
  ASSERT_TRUE(watcher.until([&] { return watcher.contact && watcher.contact->time == 0.2; }));
  EXPECT_EQ(watcher.contact->spheres.states, recorded->spheres.states);
}

// A camera with a note at each frame leaves tens of thousands of them in a night.
TEST(RunView, ManyNotesDoNotBuryTheOthersNorThePage) {
  const TemporaryFolder folder;
  SyntheticStream stream(12);
  auto device = test::path_device(pressing_pose, kRate);
  RunMonitor monitor;
  for (int i = 0; i < 20000; ++i) monitor.marks.add("frame " + std::to_string(i) + " was dropped");
  monitor.marks.add("here");
  RunOptions options;
  options.monitor = &monitor;
  ASSERT_TRUE(
      record_run(small_tool(), stream, **device, path_settings(), folder.path() / "run", options));
  auto view = view_run(folder.path() / "run");
  ASSERT_TRUE(view) << view.error().message;
  Watcher watcher(**view);
  watcher.execute({{"command", "pause"}});
  Json marks;
  const auto num_with = [&](const char* words) {
    return std::ranges::count_if(marks, [&](const Json& mark) {
      return mark["text"].get<std::string>().find(words) != std::string::npos;
    });
  };
  ASSERT_TRUE(watcher.until([&] {  // all is read
    marks = watcher.marks();
    return num_with("here") == 1;
  })) << marks;
  EXPECT_EQ(num_with("was dropped"), 200);
  EXPECT_EQ(num_with("later ones are not shown"), 1);
  EXPECT_TRUE(watcher.until([&] { return watcher.state()["num_marks"] == marks.size(); }));
  EXPECT_LT((*view)->state().size(), 10000u);
}

TEST(RunView, AStepRightAfterASeekCountsFromWhereTheSeekWent) {
  const TemporaryFolder folder;
  record_path(folder.path() / "run", path_settings(), 12);
  auto view = view_run(folder.path() / "run");
  ASSERT_TRUE(view) << view.error().message;
  Watcher watcher(**view);
  watcher.execute({{"command", "pause"}});
  const auto go_to = [&](double time, int number) {
    watcher.execute({{"command", "seek"}, {"time", time}});
    ASSERT_TRUE(watcher.until([&] { return watcher.state()["frame_number"] == number; })) << number;
  };
  go_to(8.5 / 30, 8);
  for (int repeat = 0; repeat < 20; ++repeat) {  // the player's thread may be in between
    go_to(0.5 / 30, 0);
    watcher.execute({{"command", "seek"}, {"time", 8.5 / 30}});
    watcher.execute({{"command", "step"}, {"frames", 1}});
    ASSERT_TRUE(watcher.until([&] { return watcher.state()["frame_number"] == 9; }));
    EXPECT_GE(watcher.state()["time"], 9.0 / 30 - 1e-9);
  }
}

TEST(RunView, AUnitThatChangesInMidStreamLeavesTheSceneWhereItIs) {
  const TemporaryFolder folder;
  test::OtherUnitStream stream(12, 6);
  auto device = test::path_device(pressing_pose, kRate);
  ASSERT_TRUE(record_run(small_tool(), stream, **device, path_settings(), folder.path() / "run"));
  auto view = view_run(folder.path() / "run");
  ASSERT_TRUE(view) << view.error().message;
  Watcher watcher(**view);
  watcher.execute({{"command", "pause"}});
  SyntheticStream truth(12);
  for (std::uint64_t number = 0; number < 12; ++number) {
    watcher.execute({{"command", "seek"}, {"time", (static_cast<double>(number) + 0.5) / 30}});
    ASSERT_TRUE(watcher.until([&] { return watcher.frame && watcher.frame->number == number; }));
    DepthFrame frame;
    ASSERT_TRUE(*truth.next(frame));
    test::MessageReader reader(encode_frame(*watcher.frame));
    reader.take<std::uint16_t>(4);
    reader.take<double>(7);
    const double unit = reader.take<double>();
    EXPECT_EQ(unit, number < 6 ? frame.unit : frame.unit / 5);
    const auto counts = reader.take<std::uint16_t>(frame.pixels.size());
    for (std::size_t i = 0; i < counts.size(); ++i) {
      ASSERT_NEAR(unit * counts[i], frame.unit * frame.pixels[i], 1e-9) << number;
    }
  }
}

TEST(RunView, AWrongFolderIsOneClearError) {
  const TemporaryFolder folder;
  EXPECT_FALSE(view_run(folder.path()));
  const auto absent = view_run(folder.path() / "absent");
  ASSERT_FALSE(absent);
  EXPECT_EQ(absent.error().code, Errc::not_found);
  EXPECT_NE(absent.error().message.find("palpate touch"), std::string::npos);
  ASSERT_TRUE(write_file_atomically(folder.path() / kRecordingFile, "no MCAP"));
  EXPECT_FALSE(view_run(folder.path()));
}

}  // namespace
}  // namespace palpate
