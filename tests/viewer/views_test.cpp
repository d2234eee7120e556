// Data of the page's sources: against queries that are made anew, and against the recordings.
#include "palpate/viewer/viewer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <thread>

#include "palpate/session/run.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/io/internal/atomic_file.h"
#include "src/io/internal/mcap_file.h"
#include "src/run/internal/pipeline.h"
#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_messages.h"
#include "src/viewer/protocol/command.h"
#include "src/viewer/protocol/controls.h"
#include "src/viewer/protocol/messages.h"
#include "src/viewer/protocol/stages.h"
#include "src/viewer/sources/repetition.h"
#include "tests/session/live_hand.h"
#include "tests/session/other_unit_stream.h"
#include "tests/session/path_run.h"
#include "tests/session/synthetic_stream.h"
#include "tests/viewer/message_reader.h"
#include "tests/viewer/watcher.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using test::patient_settings;
using test::pressing_device;
using test::pressing_pose;
using test::small_tool;
using test::SyntheticStream;
using test::TemporaryFolder;
using test::Watcher;

bool same_planes(const std::vector<Plane<float>>& a, std::span<const Plane<float>> b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const auto& p, const auto& q) {
    return p.normal == q.normal && p.offset == q.offset;
  });
}

void expect_same(const ViewContact& shown, const Pipeline& pipeline) {
  SpherePicture spheres;
  spheres.resize(shown.spheres.states.size());
  pipeline.query().measure(pipeline.cameras(), shown.X_WT, spheres.wants());
  EXPECT_EQ(shown.spheres.states, spheres.states);
  EXPECT_TRUE(same_planes(shown.spheres.planes, spheres.planes));
  EXPECT_EQ(shown.spheres.deciders, spheres.deciders);
  EXPECT_EQ(shown.spheres.unseen, spheres.unseen);
}

// A tool

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

// Controls

TEST(Controls, AreTheSettingsThatCanChange) {
  const RunSettings settings;
  const Json list = list_controls(settings_of(settings), is_live_control);
  std::set<std::string> keys;
  for (const Json& control : list) keys.insert(control["key"]);
  EXPECT_TRUE(keys.contains("contact.method"));
  EXPECT_TRUE(keys.contains("coupling.stiffness"));
  for (const char* key :
       {"coupling.base_in_scene", "coupling.tool_in_hand", "safety.max_slew", "loop.threads"}) {
    EXPECT_FALSE(keys.contains(key)) << key;
  }
  for (const Json& control : list_controls(settings_of(settings), is_recorded_control)) {
    EXPECT_FALSE(control["key"].get<std::string>().starts_with("coupling.")) << control;
  }
  const Json& method = list[0];
  EXPECT_EQ(method["kind"], "choice");
  EXPECT_EQ(method["value"], "field");
  EXPECT_EQ(method["choices"], Json({"weighted", "simplified", "graph", "field"}));
}

TEST(Controls, EachCanBeSetToWhatItSaysItCanBe) {
  RunSettings settings;
  for (const auto& control : list_controls(settings_of(settings), is_live_control)) {
    nlohmann::ordered_json value = true;
    if (control["kind"] == "choice") value = control["choices"].back();
    if (control["kind"] == "number") value = control["high"];
    const auto key = control["key"].get<std::string>();
    const auto taken = set_control(settings_of(settings), is_live_control, key, value);
    ASSERT_TRUE(taken) << control << taken.error().message;
    EXPECT_EQ(*taken, value) << control;
    EXPECT_EQ(control_values(settings_of(settings), is_live_control)[key], value) << control;
  }
  EXPECT_EQ(settings.coupling.stiffness, 1e6);
}

TEST(Controls, RefusesWhatItCannotBe) {
  RunSettings settings;
  const auto set = [&](const char* key, const nlohmann::ordered_json& value) {
    return set_control(settings_of(settings), is_live_control, key, value);
  };
  EXPECT_NE(set("contact.method", "magic").error().message.find("weighted"), std::string::npos);
  EXPECT_FALSE(set("contact.method", 3));
  EXPECT_FALSE(set("contact.method", nullptr));
  EXPECT_FALSE(set("surface.filter", 1));
  EXPECT_FALSE(set("surface.min_depth", -1));
  EXPECT_FALSE(set("surface.min_depth", "1"));
  EXPECT_FALSE(set("safety.max_slew", 5));
  EXPECT_FALSE(set("contact", 5));
  EXPECT_FALSE(set("", 5));
  EXPECT_EQ(control_values(settings_of(settings), is_live_control),
            control_values(settings_of(RunSettings{}), is_live_control));
  EXPECT_EQ(*set("surface.normal_radius", 2.7), 3);
  EXPECT_EQ(settings.surface.normals.radius, 3);
}

TEST(Controls, OfObjectsHaveTheirNames) {
  RunSettings settings;
  settings.objects.resize(3);
  settings.objects[0].name = "block";
  settings.objects[1].name = "block_2";
  const auto set = [&](const char* key, const nlohmann::ordered_json& value) {
    const auto taken = set_control(settings_of(settings), is_live_control, key, value);
    return taken ? taken->dump() : taken.error().message;
  };
  const Json list = list_controls(settings_of(settings), is_live_control);
  const auto found = std::ranges::find(list, "objects.block.friction",
                                       [](const Json& control) { return control["key"]; });
  ASSERT_NE(found, list.end());
  EXPECT_EQ((*found)["kind"], "number");
  EXPECT_EQ((*found)["low"], 0);
  EXPECT_EQ((*found)["high"], 10);
  EXPECT_EQ((*found)["choices"], Json({"auto"}));
  EXPECT_EQ((*found)["value"], "auto");
  EXPECT_EQ(set("objects.block_2.friction", 0.25), "0.25");
  EXPECT_EQ(settings.objects[0].friction, std::nullopt);
  EXPECT_EQ(settings.objects[1].friction, 0.25);
  EXPECT_EQ(control_values(settings_of(settings), is_live_control)["objects.block_2.friction"],
            0.25);
  EXPECT_EQ(set("objects.block_2.friction", 11),
            "objects.block_2.friction must be a number from 0 to 10 or auto, not 11");
  EXPECT_EQ(set("objects.block_2.friction", "rough"),
            "objects.block_2.friction must be a number from 0 to 10 or auto, not 'rough'");
  EXPECT_EQ(set("objects.blok.friction", 1),
            "there is no setting 'objects.blok.friction'; the nearest one is "
            "'objects.block.friction'");
  EXPECT_EQ(settings.objects[1].friction, 0.25);
  EXPECT_EQ(set("objects.block_2.friction", "auto"), "\"auto\"");
  EXPECT_EQ(settings.objects[1].friction, std::nullopt);

  const Tool tool = small_tool();
  for (SceneObject& object : settings.objects) object.shape = std::make_shared<const Tool>(tool);
  const auto view =
      LiveView::create(tool, {SyntheticStream(1).info()}, "hand", {.objects = settings.objects});
  EXPECT_NE(view->controls().find("objects.block.friction"), std::string::npos)
      << "pages ask before the run begins";
}

TEST(Stages, KeepAllOfAHistogramInFewBars) {
  LatencyHistogram times;
  std::int64_t duration = 40;
  for (int i = 0; i < 3000; ++i) times.record(duration += duration / 200 + 1);
  const Json stage = stage_json("x", times);
  EXPECT_EQ(stage["num"], 3000);
  std::uint64_t num = 0;
  double last = -1;
  for (const Json& bar : stage["histogram"]) {
    EXPECT_GT(bar[0].get<double>(), last);
    last = bar[0];
    EXPECT_GT(bar[1], 0);
    num += bar[1].get<std::uint64_t>();
  }
  EXPECT_EQ(num, 3000u);
  EXPECT_LE(stage["histogram"].size(), 60u);
  EXPECT_EQ(stage_json("x", LatencyHistogram())["histogram"], Json::array());
}

// A run on a simulated clock

constexpr double kRate = 200;

RunSettings path_settings(TimeMode mode = TimeMode::interpolate) {
  RunSettings settings = test::path_settings(kRate);
  settings.time.mode = mode;
  return settings;
}

void record_path(const fs::path& folder, const RunSettings& settings, int num_frames = 12) {
  SyntheticStream stream(num_frames);
  auto device = test::path_device(pressing_pose, kRate);
  const auto outcome = record_run(small_tool(), stream, **device, settings, folder);
  ASSERT_TRUE(outcome) << outcome.error().message;
}

/// The pipeline after the tick of that number, as the run itself had it.
template <class Look>
void play_to(std::size_t tick_number, const RunSettings& settings, int num_frames, Look look) {
  SyntheticStream stream(num_frames);
  const Tool tool = small_tool();
  auto pipeline = Pipeline::create(tool, stream.info(), DeviceInfo{}, settings);
  ASSERT_TRUE(pipeline);
  DepthFrame frame;
  ASSERT_TRUE(*stream.next(frame));
  const double first = frame.timestamp;
  bool has_next = true;
  for (std::size_t k = 0; k <= tick_number; ++k) {
    const double time = static_cast<double>(k) / kRate;
    while (has_next && frame.timestamp - first <= time) {
      pipeline->push(frame, frame.timestamp - first);
      has_next = *stream.next(frame);
    }
    const Pose X_WT = pressing_pose(time);
    pipeline->measure({X_WT.translation, normalized(X_WT.rotation)}, time);
  }
  look(*pipeline);
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

/// Blends between frames: what the states do not show.
TEST(RunView, ASeekGoesIntoAnyPartOfARecording) {
  const TemporaryFolder folder;
  SyntheticStream stream(120);
  auto device = test::path_device(pressing_pose, kRate);
  RunOptions options;
  options.recording.split_bytes = 1;  // another part every second
  ASSERT_TRUE(
      record_run(small_tool(), stream, **device, path_settings(), folder.path() / "run", options));
  ASSERT_GT(recording_parts(folder.path() / "run").size(), 2u);
  auto run = open_recorded_run(folder.path() / "run");
  ASSERT_TRUE(run) << run.error().message;
  const double end = (*run)->duration();
  for (const double time : {end, 0.1, end / 2, 0.3}) {
    const auto query = (*run)->query_at(time);
    ASSERT_TRUE(query) << query.error().message;
    EXPECT_NEAR(query->time, time, 1 / kRate);
    const auto frame = (*run)->read_frame(query->frame);
    ASSERT_TRUE(frame) << frame.error().message;
    EXPECT_EQ(frame->shown.number, (*run)->frame_number(query->frame));
  }
}

TEST(Repetition, GivesTheSameBitsFromAnywhere) {
  const TemporaryFolder folder;
  const RunSettings settings = path_settings(TimeMode::predict);
  record_path(folder.path() / "run", settings);
  auto run = open_recorded_run(folder.path() / "run");
  ASSERT_TRUE(run);
  const auto always = [] { return true; };
  for (const int tick_number : {70, 20, 55}) {
    Repetition repetition(**run);
    const auto query = (*run)->query_at(tick_number / kRate);
    ASSERT_TRUE(query);
    ASSERT_TRUE(*repetition.go_to(*query, (*run)->settings(0), always));
    const Penetration repeated = repetition.measure();
    play_to(static_cast<std::size_t>(tick_number), settings, 12, [&](Pipeline& pipeline) {
      const Penetration& measured = pipeline.contact().penetration;
      EXPECT_GT(measured.volume, 0);
      EXPECT_EQ(repeated.volume, measured.volume);
      EXPECT_EQ(repeated.measure_W.force, measured.measure_W.force);
      EXPECT_EQ(repeated.measure_W.torque, measured.measure_W.torque);
    });
  }
}

// Frames that an abandoned jump has only passed are processed again before they give a force.
TEST(Repetition, GivesTheSameBitsAfterAJumpThatWasGivenUp) {
  const TemporaryFolder folder;
  RunSettings settings = path_settings(TimeMode::latest);
  settings.time.average.kind = DepthAverage::kalman;
  record_path(folder.path() / "run", settings);
  auto run = open_recorded_run(folder.path() / "run");
  ASSERT_TRUE(run);
  const auto always = [] { return true; };
  const auto far = (*run)->query_at(70 / kRate), near = (*run)->query_at(20 / kRate);
  ASSERT_TRUE(far && near);
  Repetition fresh(**run);
  ASSERT_TRUE(*fresh.go_to(*near, (*run)->settings(0), always));
  const Penetration expected = fresh.measure();
  EXPECT_GT(expected.volume, 0);
  for (int num_pushed = 1; num_pushed < 8; ++num_pushed) {
    Repetition repetition(**run);
    int num_left = num_pushed;
    const auto gone = repetition.go_to(*far, (*run)->settings(0), [&] { return num_left-- > 0; });
    ASSERT_TRUE(gone);
    ASSERT_FALSE(*gone);
    ASSERT_TRUE(*repetition.go_to(*near, (*run)->settings(0), always));
    EXPECT_EQ(repetition.measure().volume, expected.volume) << num_pushed;
    EXPECT_EQ(repetition.measure().measure_W.force, expected.measure_W.force) << num_pushed;
  }
}

TEST(Repetition, LooksBackAsFarAsTheTimeOptionsDo) {
  TimeOptions time;
  EXPECT_EQ(num_lead_frames(time), 1);
  time.mode = TimeMode::latest;
  EXPECT_EQ(num_lead_frames(time), 0);
  time.average = {DepthAverage::moving, 8, 0.25, 0.03, 0};
  EXPECT_EQ(num_lead_frames(time), 8);
  time.average.kind = DepthAverage::exponential;
  EXPECT_EQ(num_lead_frames(time), 49);  // 0.75^48.02 is a millionth
  time.average.weight = 1e-9;
  EXPECT_EQ(num_lead_frames(time), kMaxLeadFrames);
  time.average.weight = 1;
  EXPECT_EQ(num_lead_frames(time), 0);
  time.average.kind = DepthAverage::kalman;
  EXPECT_EQ(num_lead_frames(time), kMaxLeadFrames);
  time = {};
  time.memory.kind = DepthMemory::on;
  EXPECT_EQ(num_lead_frames(time), kMaxLeadFrames + 1);
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

// A run on a simulated clock, while it goes on

TEST(LiveView, ARunOnASimulatedClockKeepsPaceAndCanBeHeldAndTurned) {
  const Tool tool = small_tool();
  constexpr int kNumFrames = 900;  // 30 s, in which even a busy machine comes to hold it
  SyntheticStream stream(kNumFrames);
  const TemporaryFolder folder;
  const auto view = LiveView::create(tool, {stream.info()}, "path");
  Watcher watcher(*view);
  RunOptions options;
  options.monitor = &view->monitor();
  options.keep_going = [&] { return !view->wants_end(); };
  options.clock.keeps_pace = true;
  auto device = test::path_device(pressing_pose, kRate);
  std::optional<Result<RunOutcome>> outcome;
  const auto start = std::chrono::steady_clock::now();
  std::thread run([&] {
    outcome = record_run(tool, stream, **device, path_settings(), folder.path() / "run", options);
  });
  ASSERT_TRUE(watcher.until([&] { return watcher.state()["running"] == true; }));
  ASSERT_TRUE(watcher.until([&] { return watcher.contact && watcher.frame && watcher.surface; }));
  watcher.execute({{"command", "pause"}});
  const int held = watcher.state()["frame_number"];
  watcher.execute({{"command", "step"}, {"frames", 2}});
  ASSERT_TRUE(watcher.until([&] { return watcher.state()["frame_number"] == held + 2; }));
  const double time = watcher.state()["time"];
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(watcher.state()["time"], time);
  ASSERT_TRUE(watcher.until([&] { return watcher.contact->time == time; }));
  play_to(static_cast<std::size_t>(std::lround(time * kRate)), path_settings(), kNumFrames,
          [&](Pipeline& pipeline) { expect_same(*watcher.contact, pipeline); });
  watcher.execute({{"command", "set"}, {"key", "contact.method"}, {"value", "graph"}});
  EXPECT_EQ(watcher.state()["settings"]["contact.method"], "graph");
  watcher.execute({{"command", "resume"}});
  EXPECT_TRUE(watcher.until([&] { return watcher.state()["time"] > time + 1; }));
  watcher.execute({{"command", "end"}});
  run.join();
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
  ASSERT_TRUE(*outcome) << outcome->error().message;
  EXPECT_GE(took.count(), static_cast<double>((*outcome)->loop.num_ticks) / kRate + 0.05 - 0.01);
  watcher.poll();
  EXPECT_EQ(watcher.samples.size(), (*outcome)->loop.num_ticks);
  EXPECT_EQ(watcher.state()["running"], false);
  EXPECT_NE(watcher.state()["note"].get<std::string>().find("ended"), std::string::npos);
  const auto replay = replay_run(folder.path() / "run");
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
}

// A live run

/// Every message of the recording in this folder.
template <class Take>
void read_messages(const fs::path& folder, Take take) {
  auto reader = McapReader::open(folder / kRecordingFile);
  ASSERT_TRUE(reader);
  for (;;) {
    const auto message = reader->next();
    if (!message || !*message) return;
    take(reader->channels().at((*message)->channel).topic, std::string((*message)->data));
  }
}

/// A live run in a thread, with a view that can end it.
class LiveRunTest : public testing::Test {
 protected:
  LiveRunTest()
      : tool_(small_tool()),
        stream_(100000),
        view_(LiveView::create(tool_, {stream_.info()}, "hand")),
        watcher_(*view_) {}

  void start(double duration = 120) {
    run_ = std::thread([this, duration] {
      const auto device = pressing_device();
      RunOptions options;
      options.duration = duration;
      options.keep_going = [this] { return !view_->wants_end(); };
      options.monitor = &view_->monitor();
      outcome_ = record_run(tool_, stream_, *device, patient_settings(), folder(), options);
    });
  }
  void join() {
    if (run_.joinable()) run_.join();
  }
  ~LiveRunTest() override { join(); }
  fs::path folder() const { return where_.path() / "live"; }

  TemporaryFolder where_;
  Tool tool_;
  SyntheticStream stream_;
  std::unique_ptr<LiveView> view_;
  Watcher watcher_;
  std::optional<Result<RunOutcome>> outcome_;
  std::thread run_;
};

TEST_F(LiveRunTest, IsSeenAndSeenAgain) {
  EXPECT_EQ(watcher_.state()["running"], false);
  EXPECT_FALSE(watcher_.command({{"command", "pause"}}));
  start();
  // A contact somewhere within the run, and one that is told at once: its time is that of the last
  // ticks that were published, and a busy disk may hold them up.
  double zero = std::numeric_limits<double>::infinity();  // of the run, s, monotonic
  ASSERT_TRUE(watcher_.until([&] {
    if (!watcher_.contact) return false;
    const double begun = monotonic_now() - watcher_.contact->time;
    zero = std::min(zero, begun);
    return watcher_.frame && watcher_.surface && watcher_.contact->time > 0.4 &&
           begun < zero + 0.3 &&
           std::count(watcher_.contact->spheres.states.begin(),
                      watcher_.contact->spheres.states.end(), SphereState::outside) < 190;
  }));
  const auto seen = watcher_.contact;
  const Json state = watcher_.state();
  EXPECT_EQ(state["running"], true);
  EXPECT_EQ(state["fault"], nullptr);
  EXPECT_EQ(state["paused"], false);
  EXPECT_GT(state["ticks"], 0);
  EXPECT_GT(state["frames"], 0);
  EXPECT_EQ(state["settings"]["contact.method"], "field");
  EXPECT_EQ(state["stages"].size(), 7u);
  EXPECT_EQ(watcher_.frame->frame.width, 96);
  EXPECT_EQ(watcher_.surface->points.size(), 96u * 72u);
  watcher_.execute({{"command", "mark"}, {"text", "here"}});
  watcher_.execute({{"command", "end"}});
  join();
  ASSERT_TRUE(*outcome_) << outcome_->error().message;
  const Json end = watcher_.state();
  EXPECT_EQ(end["running"], false);
  EXPECT_GE(end["ticks"], state["ticks"]);
  EXPECT_NE(end["note"].get<std::string>().find("ended"), std::string::npos);
  EXPECT_FALSE(watcher_.command({{"command", "pause"}}));
  watcher_.poll();

  auto view = view_run(folder());
  ASSERT_TRUE(view) << view.error().message;
  double time = -1;
  read_messages(folder(), [&](const std::string& topic, const std::string& message) {
    if (topic != kContactTopic) return;
    const ContactRecord contact = *read_contact(message);
    if (contact.X_WT == seen->X_WT) time = contact.time;
  });
  // The last ticks that were published may have been a little older.
  EXPECT_NEAR(time, seen->time, 0.5);
  Watcher again(**view);
  again.execute({{"command", "pause"}});
  again.execute({{"command", "seek"}, {"time", time}});
  ASSERT_TRUE(again.until([&] { return again.contact && again.contact->time == time; }));
  EXPECT_EQ(again.contact->X_WT, seen->X_WT);
  EXPECT_EQ(again.contact->frame_number, seen->frame_number);
  EXPECT_EQ(again.contact->spheres.states, seen->spheres.states);
  EXPECT_TRUE(same_planes(again.contact->spheres.planes, seen->spheres.planes));
  const auto marks = again.marks();
  EXPECT_TRUE(std::ranges::any_of(marks, [](const Json& mark) { return mark["text"] == "here"; }))
      << marks;
  // The samples are those that were seen, too.
  const auto sample = std::find_if(watcher_.samples.begin(), watcher_.samples.end(),
                                   [](const ViewSample& s) { return s.time > 0.2; });
  ASSERT_NE(sample, watcher_.samples.end());
  const auto same = std::find_if(again.samples.begin(), again.samples.end(),
                                 [&](const ViewSample& s) { return s.time == sample->time; });
  ASSERT_NE(same, again.samples.end());
  EXPECT_EQ(same->F_H_B.force, sample->F_H_B.force);
  EXPECT_EQ(same->X_WT, sample->X_WT);
}

TEST_F(LiveRunTest, IsTurnedAndHeld) {
  start();
  ASSERT_TRUE(watcher_.until([&] { return watcher_.contact && watcher_.frame; }));
  for (const char* method : {"graph", "field", "weighted"}) {
    watcher_.execute({{"command", "set"}, {"key", "contact.method"}, {"value", method}});
    EXPECT_EQ(watcher_.state()["settings"]["contact.method"], method);
  }
  watcher_.execute({{"command", "set"}, {"key", "coupling.damping_ratio"}, {"value", 0.7}});
  EXPECT_EQ(watcher_.state()["revision"], 4);
  EXPECT_FALSE(watcher_.command({{"command", "set"}, {"key", "contact.method"}, {"value", 1}}));
  EXPECT_FALSE(
      watcher_.command({{"command", "set"}, {"key", "surface.min_depth"}, {"value", 900}}));
  EXPECT_FALSE(watcher_.command({{"command", "set"}, {"key", "loop.threads"}, {"value", 1}}));
  EXPECT_FALSE(watcher_.command({{"command", "seek"}, {"time", 1}}));
  EXPECT_FALSE(watcher_.command({{"command", "mark"}}));
  EXPECT_EQ(watcher_.state()["revision"], 4);
  watcher_.execute({{"command", "pause"}});
  EXPECT_EQ(watcher_.state()["paused"], true);
  // Other things may come first for a moment.
  EXPECT_TRUE(watcher_.until(
      [&] { return watcher_.state()["note"].dump().find("held") != std::string::npos; }));
  watcher_.execute({{"command", "step"}, {"frames", 2}});
  EXPECT_EQ(watcher_.state()["paused"], true);
  watcher_.execute({{"command", "resume"}});
  EXPECT_EQ(watcher_.state()["paused"], false);
  watcher_.execute({{"command", "end"}});
  join();
  ASSERT_TRUE(*outcome_) << outcome_->error().message;
  auto run = open_recorded_run(folder());
  ASSERT_TRUE(run) << run.error().message;
  const auto last = (*run)->query_at(1e9);
  ASSERT_TRUE(last);
  EXPECT_EQ(last->revision, 4u);
  EXPECT_EQ((*run)->settings(last->revision).contact.method, MethodKind::weighted);
  EXPECT_EQ((*run)->settings(last->revision).coupling.damping_ratio, 0.7);
}

TEST_F(LiveRunTest, EveryQueryIsFoundAndRepeated) {
  start(1.2);
  join();
  ASSERT_TRUE(*outcome_) << outcome_->error().message;
  std::vector<ContactRecord> contacts;
  std::size_t num_ticks = 0;
  read_messages(folder(), [&](const std::string& topic, const std::string& message) {
    if (topic == kContactTopic) contacts.push_back(*read_contact(message));
    num_ticks += topic == kTickTopic;
  });
  auto run = open_recorded_run(folder());
  ASSERT_TRUE(run) << run.error().message;
  Repetition repetition(**run);
  const auto always = [] { return true; };
  const std::size_t n = contacts.size();
  ASSERT_GT(n, 10u);
  for (const std::size_t i : {n - 1, n / 2, n / 2 + 1, std::size_t(0), n / 3, n - 2, n / 4}) {
    const ContactRecord& recorded = contacts[i];
    const auto query = (*run)->query_at(recorded.time);
    ASSERT_TRUE(query);
    EXPECT_EQ(query->time, recorded.time);
    EXPECT_EQ(query->X_WT, recorded.X_WT);
    ASSERT_TRUE(*repetition.go_to(*query, (*run)->settings(query->revision), always));
    const Penetration repeated = repetition.measure();
    EXPECT_EQ(repeated.volume, recorded.penetration.volume) << i;
    EXPECT_EQ(repeated.measure_W.torque, recorded.penetration.measure_W.torque) << i;
  }
  const auto samples = (*run)->samples(-1, 1e9);
  ASSERT_TRUE(samples);
  EXPECT_EQ(samples->size(), num_ticks);
  for (std::size_t i = 1; i < samples->size(); ++i) {
    ASSERT_GT((*samples)[i].time, (*samples)[i - 1].time);
  }
  for (std::size_t i = 0; i < (*run)->num_frames(); ++i) {
    const auto query = (*run)->query_at((*run)->needed_from(i));
    ASSERT_TRUE(query);
    // The last ones may have come too late to be felt.
    if ((*run)->frame_number(i) <= contacts.back().frame_number) {
      EXPECT_GE(query->frame, i);
    }
    const auto frame = (*run)->read_frame(i);
    ASSERT_TRUE(frame) << frame.error().message;
    EXPECT_EQ(frame->shown.number, (*run)->frame_number(i));
  }
}

TEST_F(LiveRunTest, WhatWasCutOffIsShownAsFarAsItGoes) {
  start(2);
  join();
  ASSERT_TRUE(*outcome_) << outcome_->error().message;
  const fs::path file = folder() / kRecordingFile;
  const auto size = fs::file_size(file);
  fs::resize_file(file, size * 6 / 10);
  auto cut = view_run(folder());
  ASSERT_TRUE(cut) << cut.error().message;
  Watcher watcher(**cut);
  EXPECT_TRUE(watcher.until([&] { return watcher.contact && watcher.frame; }));
  Json state;
  EXPECT_TRUE(watcher.until([&] {  // it is read to its end
    state = watcher.state();
    return state["note"].dump().find("cut off") != std::string::npos;
  })) << state["note"];
  EXPECT_GT(state["duration"], 0.4);
  EXPECT_LT(state["duration"], (*outcome_)->loop.seconds - 0.1);
  watcher.execute({{"command", "seek"}, {"time", 100}});
  EXPECT_TRUE(watcher.until([&] { return watcher.state()["paused"] == true; }));

  // A bit has flipped.
  auto bytes = *read_file(file);
  bytes[bytes.size() - 1000] = static_cast<char>(bytes[bytes.size() - 1000] ^ 4);
  ASSERT_TRUE(write_file_atomically(file, bytes));
  auto damaged = view_run(folder());
  ASSERT_TRUE(damaged) << damaged.error().message;
  Watcher other(**damaged);
  EXPECT_TRUE(other.until([&] { return other.contact && other.frame; }));

  // Nothing is left to be seen.
  fs::resize_file(file, 2000);
  EXPECT_FALSE(view_run(folder()));
  fs::resize_file(file, 0);
  EXPECT_FALSE(view_run(folder()));
}

}  // namespace
}  // namespace palpate
