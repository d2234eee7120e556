#include "palpate/session/run.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <thread>
#include <vector>

#include "src/io/internal/atomic_file.h"
#include "src/io/internal/mcap_file.h"
#include "src/io/internal/ros_image.h"
#include "src/io/internal/ros_messages.h"
#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_messages.h"
#include "src/session/internal/settings_json.h"
#include "src/session/report/run_series.h"
#include "tests/session/flowing_stream.h"
#include "tests/session/live_hand.h"
#include "tests/session/recorded_messages.h"
#include "tests/session/repeated_run.h"
#include "tests/session/synthetic_stream.h"
#include "tests/test_util/report_data.h"
#include "tests/test_util/wait_for.h"

namespace palpate {
namespace {

using test::messages;
using Message = test::RecordedMessage;
using test::patient_settings;
using test::pressing_device;
using test::rewrite;
using test::small_tool;
using test::SyntheticStream;
using test::TemporaryFolder;
using test::wait_for;

Result<RunOutcome> run_for(double duration, const std::filesystem::path& folder,
                           const RunSettings& settings = patient_settings(),
                           int num_frames = 1000) {
  const Tool tool = small_tool();
  SyntheticStream stream(num_frames);
  const auto device = pressing_device();
  return record_run(tool, stream, *device, settings, folder, {.duration = duration});
}

/// For so long, and until the hand has felt the wall for a while.
Result<RunOutcome> press_for(double duration, DepthSource& stream,
                             const std::filesystem::path& folder, const RunSettings& settings) {
  constexpr int kEnough = 150;
  std::atomic<int> num_ticks = 0, num_contacts = 0;  // with a force
  std::atomic<double> time = 0;
  RunMonitor monitor;
  monitor.observer.on_ticks = [&](std::span<const TickRecord> ticks) {
    for (const TickRecord& tick : ticks) num_ticks += norm(tick.F_H_B.force) > 0 ? 1 : 0;
    time = ticks.back().time;
  };
  monitor.observer.on_contact = [&](const ContactRecord& contact) {
    num_contacts += contact.penetration.volume > 0 ? 1 : 0;
  };
  RunOptions options;
  options.monitor = &monitor;
  options.duration = 120;
  options.keep_going = [&] {
    return time < duration || num_ticks < kEnough || num_contacts < kEnough;
  };
  const auto device = pressing_device();
  return record_run(small_tool(), stream, *device, settings, folder, options);
}

std::string read(const std::filesystem::path& path) { return *read_file(path); }

// Messages

TEST(RunMessages, TicksReadBackToTheSameBits) {
  TickRecord tick;
  tick.number = 18446744073709551615u;
  tick.time = 0.1 + 0.2;
  tick.dt = std::nextafter(0.001, 1.0);
  tick.device = {1e5 / 3, {{1.0 / 3, -0.0, 5e-324}, axis_angle({1, 2, 3}, 0.7)}, {}, 5, true,
                 false};
  tick.step.stretch = std::numeric_limits<double>::quiet_NaN();
  tick.step.energy = -std::numeric_limits<double>::infinity();
  tick.step.stored = 1.0 / 7;
  tick.F_H_B = {{1.7976931348623157e308, 2, 3}, {4, 5, 6}};
  tick.safety = {ForceState::off, Fault::stale_sensor, 12.5, 3, 0.25, 1e-3, 2.5, 77};
  tick.is_force_requested = true;
  tick.is_stopping = true;
  tick.compute_nanoseconds = -12;
  const std::string text = tick_message(tick);
  const auto back = read_tick(text);
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(tick_message(*back), text);
  EXPECT_EQ(back->number, tick.number);
  EXPECT_EQ(back->dt, tick.dt);
  EXPECT_EQ(back->device.X_BH, tick.device.X_BH);
  EXPECT_TRUE(std::signbit(back->device.X_BH.translation.y));
  EXPECT_TRUE(back->device.is_valid);
  EXPECT_FALSE(back->device.has_force);
  EXPECT_EQ(back->step.stored, tick.step.stored);
  EXPECT_TRUE(std::isnan(back->step.stretch));
  EXPECT_EQ(back->step.energy, tick.step.energy);
  EXPECT_EQ(back->safety.fault, Fault::stale_sensor);
  EXPECT_EQ(back->safety.state, ForceState::off);
  EXPECT_EQ(back->safety.num_faults, 3u);
  EXPECT_TRUE(back->is_force_requested);
  EXPECT_EQ(back->safety.num_limited, 77u);
  for (std::size_t size = 0; size < text.size(); size += 17) {
    EXPECT_FALSE(read_tick(text.substr(0, size))) << size;
  }
}

TEST(RunMessages, ContactsReadBackToTheSameBits) {
  ContactRecord contact;
  contact.number = 12;
  contact.cameras.num = 2;
  contact.cameras.of[0] = {3, 1.0 / 7};
  contact.cameras.of[1] = {5, 2.0 / 7};
  contact.penetration = {1e-5 / 3, {{1, 2, 3}, {4, 5, 6}},       0.125, 7, 8,
                         9,        StepStatus::ambiguous_normals};
  contact.contact.is_valid = true;
  for (int i = 0; i < 36; ++i) contact.contact.stiffness.m[i / 6][i % 6] = 1.0 / (i + 3);
  const std::string text = contact_message(contact);
  const auto back = read_contact(text);
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(contact_message(*back), text);
  EXPECT_EQ(back->contact.stiffness.m[4][5], contact.contact.stiffness.m[4][5]);
  EXPECT_EQ(back->penetration.num_points, 9);
}

TEST(RunMessages, DepthFramesAreImages) {
  SyntheticStream stream(1);
  DepthFrame frame;
  ASSERT_TRUE(*stream.next(frame));
  const std::string image = image_message({1'500'000'007, "camera"}, frame);
  const auto back = read_depth_image(image, frame.unit);
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(back->pixels, frame.pixels);
  EXPECT_EQ(back->width, frame.width);
  for (const std::size_t size :
       {std::size_t(0), std::size_t(3), image.size() / 2, image.size() - 1})
    EXPECT_FALSE(read_depth_image(image.substr(0, size), frame.unit)) << size;
}

TEST(RunMessages, PointsOfLargeImagesAreThinned) {
  DepthFrame frame;
  frame.width = 1920;
  frame.height = 1080;
  frame.pixels.assign(1920 * 1080, 1500);
  const std::string message = points_message({}, frame, {1400, 1400, 959.5, 539.5});
  const auto num_points = message.size() / 12;
  EXPECT_LE(num_points, static_cast<std::size_t>(kMaxRecordedPoints));
  EXPECT_GE(num_points, static_cast<std::size_t>(kMaxRecordedPoints / 2));
  frame.pixels.assign(frame.pixels.size(), 65535);
  EXPECT_LT(points_message({}, frame, {1400, 1400, 959.5, 539.5}).size(), 200u);
}

TEST(RunMessages, SettingsOfOtherVersionsAreRefused) {
  RunSetup setup;
  setup.streams = {SyntheticStream(2).info()};
  const std::string message = settings_message(setup);
  ASSERT_TRUE(read_settings(message));
  const auto changed = [&](std::string_view from, std::string_view to) {  // of the same length
    std::string other = message;
    const std::size_t at = other.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return other.replace(at, from.size(), to);
  };
  const auto unreleased = read_settings(changed("palpate.run", "palpate run"));
  ASSERT_FALSE(unreleased);
  EXPECT_EQ(unreleased.error().message,
            "the recording was made by an unreleased version of palpate; record the run again");
  const auto later = read_settings(changed("\"version\":1", "\"version\":7"));
  ASSERT_FALSE(later);
  EXPECT_EQ(
      later.error().message,
      "the recording has format version 7, this program reads 1; use the version that wrote it");
  EXPECT_FALSE(read_settings(changed("palpate.run", "palpate.not")));
}

TEST(RunMessages, SchemasNameEveryTypeOnce) {
  const std::string text = tick_channel().schema;
  EXPECT_EQ(tick_channel().schema_name, "palpate_msgs/msg/Tick");
  for (const char* type :
       {"geometry_msgs/Vector3", "geometry_msgs/Pose", "palpate_msgs/SafetyStatus",
        "palpate_msgs/Penetration", "geometry_msgs/Point"}) {
    const std::size_t first = text.find(std::string("MSG: ") + type + "\n");
    ASSERT_NE(first, std::string::npos) << type;
    EXPECT_EQ(text.find(std::string("MSG: ") + type + "\n", first + 1), std::string::npos) << type;
  }
  EXPECT_NE(text.find("float64 contact_age\n"), std::string::npos);
}

TEST(RunSeries, StaysSmallAndKeepsTheStrongestTick) {
  RunSeries series;
  TickRecord tick;
  for (int i = 0; i < 300000; ++i) {
    tick.time = i;
    tick.F_H_B.force.x = i == 123457 ? 5 : 0.001 * (i % 7);
    series.add(tick);
  }
  EXPECT_LE(series.ticks().size(), std::size_t(1) << 14);
  EXPECT_GT(series.ticks().size(), std::size_t(1) << 12);
  double strongest = 0, last = -1;
  for (const TickRecord& kept : series.ticks()) {
    EXPECT_GT(kept.time, last);
    last = kept.time;
    strongest = std::max(strongest, kept.F_H_B.force.x);
  }
  EXPECT_EQ(strongest, 5);
}

// Settings

class RunSettingsFile : public testing::Test {
 protected:
  Result<RunSettings> load(const std::string& text) {
    const auto path = folder_.path() / "settings.toml";
    std::ofstream(path) << text;
    return load_settings<RunSettings>(path);
  }
  void expect_error(const std::string& text, std::initializer_list<const char*> mentions) {
    const auto loaded = load(text);
    ASSERT_FALSE(loaded) << text;
    for (const char* words : mentions) {
      EXPECT_NE(loaded.error().message.find(words), std::string::npos) << loaded.error().message;
    }
  }

  TemporaryFolder folder_;
};

TEST_F(RunSettingsFile, PrintedDefaultsReadBackToTheSame) {
  RunSettings settings;
  settings.coupling.tool_mass = 0.1 + 0.2;
  settings.coupling.kind = CouplingKind::proxy;
  settings.coupling.X_WB = {{1, -2, 0.125}, {0, 0, 1, 0}};
  settings.safety.dead_man = true;
  settings.contact.volumes = SphereVolumes::own;
  for (const RunSettings& some : {RunSettings{}, settings}) {
    const auto loaded = load(settings_toml(settings_of(some)));
    ASSERT_TRUE(loaded) << loaded.error().message;
    EXPECT_TRUE(has_same_settings(*loaded, some));
    RunSettings from_json;
    const Status read = read_json(settings_of(from_json), to_json(settings_of(some)));
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_TRUE(has_same_settings(from_json, some));
  }
}

TEST_F(RunSettingsFile, SetsWhatItNames) {
  const auto loaded = load(
      "[coupling]\nkind = \"direct\"\nstiffness = 800  # whole numbers are numbers\n"
      "[safety]\nengage_ticks = 20\n[loop]\nreal_time = false\n");
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ(loaded->coupling.kind, CouplingKind::direct);
  EXPECT_EQ(loaded->coupling.stiffness, 800);
  EXPECT_EQ(loaded->safety.engage_ticks, 20);
  EXPECT_FALSE(loaded->wants_real_time);
  EXPECT_EQ(loaded->safety.max_slew, SafetyOptions{}.max_slew);
}

TEST_F(RunSettingsFile, ErrorsNameLineAndRemedy) {
  expect_error("[safety]\n\nmax_slow = 3\n", {"line 3", "'max_slow'", "'max_slew'"});
  expect_error("[safty]\nmax_slew = 3\n", {"line 1", "[safty]", "[safety]"});
  expect_error("stiffness = 3\n", {"line 1", "stiffness"});
  expect_error("[coupling]\nstiffness = -1\n", {"line 2", "from 0 to"});
  expect_error("[coupling]\nstiffness = nan\n", {"line 2", "from 0 to"});
  expect_error("[coupling]\nstiffness = \"much\"\n", {"line 2", "number"});
  expect_error("[coupling]\nkind = \"rigid\"\n", {"line 2", "virtual, direct, proxy, none"});
  expect_error("[safety]\nengage_ticks = 1.5\n", {"line 2", "whole number"});
  expect_error("[safety]\ndead_man = 1\n", {"line 2", "true or false"});
  expect_error("[coupling]\nbase_in_scene = [0, 0, 0]\n", {"line 2", "seven numbers"});
  expect_error("[coupling]\nbase_in_scene = [0, 0, 0, 0, 0, 0, 2]\n", {"quaternion"});
  expect_error("[coupling\n", {"line 1", "not TOML"});
  for (const char* text : {"\n[#oupling]\n", "\n [ .a]\n", "\n[[?]]\n", "\n[ \r\n", "\n[\n"}) {
    expect_error(text, {"line 2", "must be followed by a name"});
  }
  EXPECT_FALSE(load_settings<RunSettings>(folder_.path() / "absent.toml"));
}

// Runs

TEST(LiveRun, AFlowIsFeltAndRepeated) {
  TemporaryFolder folder;
  RunSettings settings = patient_settings();
  settings.coupling.friction.coefficient = 0.4;
  test::FlowingStream stream(100000);
  const auto run = press_for(1.5, stream, folder / "run", settings);
  ASSERT_TRUE(run) << run.error().message;
  const auto replay = replay_run(folder / "run");
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  int num_dragged = 0;
  for (const Message& message : messages(folder / "run")) {
    if (message.channel.topic != kContactTopic) continue;
    const auto contact = read_contact(message.data);
    ASSERT_TRUE(contact);
    num_dragged += norm(contact->contact.patch.ground.velocity_W) > 0.01 ? 1 : 0;
  }
  EXPECT_GT(num_dragged, 10);
}

TEST(LiveRun, IsRecordedAndRepeatedBitForBit) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  for (const CouplingKind kind :
       {CouplingKind::virtual_coupling, CouplingKind::direct, CouplingKind::proxy}) {
    RunSettings settings = patient_settings();
    settings.coupling.kind = kind;
    const auto outcome = test::without_losses([&] {
      SyntheticStream stream(100000);
      return press_for(1.2, stream, run, settings);  // replaces the run before
    });
    ASSERT_TRUE(outcome) << outcome.error().message;
    EXPECT_EQ(outcome->failure, "");
    EXPECT_GT(outcome->loop.num_ticks, 100u);
    EXPECT_TRUE(is_run(run));
    for (const char* file : {"recording.mcap", "summary.json", "wrench.csv"}) {
      EXPECT_TRUE(std::filesystem::is_regular_file(run / file)) << file;
    }
    EXPECT_EQ(std::filesystem::is_regular_file(run / "report.html"), !report_template().empty());
    ASSERT_EQ(outcome->loop.num_lost_records, 0u);
    test::expect_repeats(run, *outcome);
    const std::string csv = read(run / "wrench.csv");
    EXPECT_EQ(static_cast<std::size_t>(std::count(csv.begin(), csv.end(), '\n')),
              outcome->loop.num_ticks + 1);
    const auto summary = nlohmann::json::parse(read(run / "summary.json"));
    EXPECT_EQ(summary["ticks"], outcome->loop.num_ticks);
    EXPECT_GT(summary["peaks"]["volume_m3"], 0.0);
    EXPECT_GT(summary["peaks"]["desired_force_N"], 0.0);
  }
}

TEST(LiveRun, PointMethodsAndPredictionAreRepeatedToo) {
  const TemporaryFolder folder;
  RunSettings settings = patient_settings();
  settings.contact.method = MethodKind::graph;
  settings.time.mode = TimeMode::predict;
  settings.coupling.hold = ContactHold::interpolation;
  SyntheticStream stream(100000);
  const auto outcome = press_for(1, stream, folder.path() / "run", settings);
  ASSERT_TRUE(outcome) << outcome.error().message;
  const auto replay = replay_run(folder.path() / "run");
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  EXPECT_GT(replay->num_contacts, 10u);
}

TEST(LiveRun, ReplayFindsWhatWasChanged) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  SyntheticStream stream(100000);
  ASSERT_TRUE(press_for(0.6, stream, run, patient_settings()));
  const std::vector<Message> recorded = messages(run);

  const auto replay_changed = [&](const char* topic, int number, auto change) {
    std::vector<Message> changed = recorded;
    for (Message& message : changed) {
      if (message.channel.topic == topic && number-- == 0) change(message.data);
    }
    rewrite(run, changed);
    return replay_run(run);
  };
  const auto tick = replay_changed(kTickTopic, 40, [](std::string& text) {
    TickRecord record = *read_tick(text);
    record.F_H_B.force.x += 1e-12;
    text = tick_message(record);
  });
  ASSERT_TRUE(tick) << tick.error().message;
  EXPECT_NE(tick->difference.find("tick 40, wrench_on_hand/force/x: recorded "), std::string::npos)
      << tick->difference;
  const auto contact = replay_changed(kContactTopic, 3, [](std::string& text) {
    ContactRecord record = *read_contact(text);
    record.penetration.potential += 1e-12;
    text = contact_message(record);
  });
  ASSERT_TRUE(contact) << contact.error().message;
  EXPECT_NE(contact->difference.find("contact 4, penetration/potential"), std::string::npos)
      << contact->difference;
  const auto damaged = replay_changed(kTickTopic, 5, [](std::string& text) { text.resize(40); });
  ASSERT_FALSE(damaged);
  EXPECT_NE(damaged.error().message.find("no palpate_msgs/Tick"), std::string::npos);

  // A missing tick ends the repetition without a difference.
  std::vector<Message> without = recorded;
  int ticks = 0;
  std::erase_if(without, [&](const Message& message) {
    return message.channel.topic == kTickTopic && ticks++ == 30;
  });
  rewrite(run, without);
  const auto shorter = replay_run(run);
  ASSERT_TRUE(shorter) << shorter.error().message;
  EXPECT_EQ(shorter->difference, "");
  EXPECT_LE(shorter->num_ticks, 30u);
  EXPECT_NE(shorter->note, "");

  // A recording without ticks has nothing to compare: it is no success.
  std::erase_if(without,
                [](const Message& message) { return message.channel.topic == kTickTopic; });
  rewrite(run, without);
  const auto nothing = replay_run(run);
  ASSERT_FALSE(nothing);
  EXPECT_NE(nothing.error().message.find("has no tick"), std::string::npos);
}

TEST(LiveRun, EndsWithTheSource) {
  const TemporaryFolder folder;
  const auto outcome = run_for(60, folder.path() / "run", patient_settings(), 6);
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_EQ(outcome->failure, "");
  EXPECT_EQ(outcome->loop.ending, "the depth frames have ended");
  EXPECT_EQ(nlohmann::json::parse(outcome->summary_json)["fault"], "none");
  EXPECT_LT(outcome->loop.seconds, 30);
  const auto replay = replay_run(folder.path() / "run");
  ASSERT_TRUE(replay);
  EXPECT_EQ(replay->difference, "");
}

TEST(LiveRun, LeavesNothingWhenItCannotBegin) {
  const TemporaryFolder folder;
  RunSettings settings = patient_settings();
  settings.contact_rate = -1;
  EXPECT_FALSE(run_for(1, folder.path() / "run", settings));
  EXPECT_FALSE(run_for(0, folder.path() / "run"));
  EXPECT_FALSE(run_for(1, folder.path() / "run", patient_settings(), 0));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  EXPECT_FALSE(is_run(folder.path()));
  std::ofstream(folder.path() / "precious.txt") << "mine";
  EXPECT_FALSE(run_for(1, folder.path()));
}

double monotonic_now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

TEST(LiveRun, KilledLosesNoMoreThanTheLastHalfSecond) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  const pid_t child = fork();
  if (child == 0) {
    (void)run_for(120, run, patient_settings(), 100000);
    _exit(0);
  }
  int num_ticks = 0;
  double newest = 0;  // tick in the file, s
  const auto look = [&] {
    num_ticks = 0;
    auto reader = McapReader::open(run / kRecordingFile);
    for (bool goes_on = reader.has_value(); goes_on;) {
      const auto message = reader->next();
      goes_on = message && *message;
      if (!goes_on || reader->channels().at((*message)->channel).topic != kTickTopic) continue;
      newest = read_tick((*message)->data)->device.time;
      ++num_ticks;
    }
  };
  // Age of the newest tick on disk: the loss in a crash. On a busy machine it is larger at some
  // moments, and on a disk that stands still at all moments of a second or two: hence repeated.
  std::vector<double> ages;
  const auto is_mostly_young = [&] {  // at the last 20 moments
    if (ages.size() < 20) return false;
    constexpr double kMost = 0.75;  // s: half a second, and a busy disk
    return std::count_if(ages.end() - 20, ages.end(), [](double a) { return a < kMost; }) > 15;
  };
  const double begin = monotonic_now();
  while ((!is_mostly_young() || num_ticks <= 400) && monotonic_now() - begin < 60) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    const double now = monotonic_now();
    look();
    if (num_ticks > 0) ages.push_back(now - newest);
  }
  kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
  EXPECT_TRUE(is_mostly_young());

  bool was_cut_off = false;
  double last = 0;
  for (const Message& message : messages(run, &was_cut_off)) {
    if (message.channel.topic == kTickTopic) last = read_tick(message.data)->device.time;
  }
  EXPECT_TRUE(was_cut_off);
  EXPECT_GE(last, newest);
  const auto replay = replay_run(run);
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  EXPECT_GT(replay->num_ticks, 100u);
  EXPECT_NE(replay->note.find("cut off"), std::string::npos);
}

/// A stream that stalls until that is noticed, as a camera with a loose plug.
class StallingStream final : public SyntheticStream {
 public:
  StallingStream(int num_frames, const std::atomic<bool>& is_noticed)
      : SyntheticStream(num_frames), is_noticed_(is_noticed) {}
  Result<bool> next(DepthFrame& frame) override {
    if (++num_ == 15) wait_for([&] { return is_noticed_.load(); });
    return SyntheticStream::next(frame);
  }

 private:
  const std::atomic<bool>& is_noticed_;
  int num_ = 0;
};

TEST(LiveRun, GoesOnAfterAFaultThatPassesAndIsRepeated) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  RunSettings settings = patient_settings();
  settings.safety.max_sensor_age = 0.5;
  settings.safety.recover_seconds = 0.1;
  settings.safety.max_recoveries = 60;  // frames are late on a busy machine, too
  std::atomic<bool> has_fault = false, is_back = false;
  StallingStream stream(100000, has_fault);
  const auto device = pressing_device();
  std::vector<std::string> said;
  RunMonitor monitor;
  std::atomic<RunLoop*> loop = nullptr;
  monitor.on_loop = [&](RunLoop* now) { loop = now; };
  monitor.observer.on_ticks = [&](std::span<const TickRecord> ticks) {
    for (const TickRecord& tick : ticks) {
      // The hand is still in contact, so it has to query.
      if (has_fault && tick.safety.state == ForceState::waiting && loop) {
        loop.load()->request_force();
      }
      has_fault = has_fault || tick.safety.fault == Fault::stale_sensor;
      is_back = is_back || (has_fault && tick.safety.is_engaged() && tick.safety.gain > 0.5);
    }
  };
  RunOptions options;
  options.monitor = &monitor;
  options.say = [&](double, std::string_view text) { said.emplace_back(text); };
  const double deadline = monotonic_now() + 300;
  options.keep_going = [&] { return !is_back && monotonic_now() < deadline; };
  const auto outcome = record_run(small_tool(), stream, *device, settings, run, options);
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_TRUE(is_back);
  EXPECT_EQ(outcome->failure, "");
  EXPECT_GT(outcome->loop.num_faults, 0u);
  ASSERT_GE(said.size(), 3u);
  const auto fault = std::ranges::find(said, describe(Fault::stale_sensor));
  ASSERT_NE(fault, said.end());
  EXPECT_NE(std::find(fault, said.end(), "the force comes up"), said.end());
  const auto summary = nlohmann::json::parse(outcome->summary_json);
  EXPECT_EQ(summary["fault"], "none");
  ASSERT_FALSE(summary["faults"].empty());
  EXPECT_EQ(summary["faults"][0]["fault"], "stale_sensor");
  EXPECT_GT(summary["faults"][0]["seconds"], 0.1);
  EXPECT_EQ(summary["faults"][0]["meaning"], describe(Fault::stale_sensor));
  test::expect_repeats(run, *outcome);
}

TEST(LiveRun, NoOtherRunTakesItsFolder) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  std::string refused;
  RunOptions options;
  options.keep_going = [&] {
    const auto other = run_for(0.1, run);
    refused = other ? "it was not refused" : other.error().message;
    return false;
  };
  SyntheticStream stream(100000);
  const auto device = pressing_device();
  const auto outcome = record_run(small_tool(), stream, *device, patient_settings(), run, options);
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_NE(refused.find("another program is writing a run to"), std::string::npos) << refused;
  EXPECT_EQ(outcome->not_kept, "");
  EXPECT_EQ(replay_run(run)->difference, "");
  EXPECT_TRUE(run_for(0.1, run));  // now it may be replaced
}

// A disk that stands still for longer than the queue of frames holds: losses are reported in the
// terminal, the summary and the replay, and the rest is the same to the bit.
TEST(LiveRun, WhatIsLostIsCountedAndTold) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  std::atomic<std::uint64_t> num_frames = 0;
  std::atomic<RunLoop*> loop = nullptr;
  RunMonitor monitor;
  monitor.on_loop = [&](RunLoop* now) { loop = now; };
  monitor.observer.on_frame = [&](const FrameRecord& frame, const DepthFrame&) {
    num_frames = frame.number;
    if (frame.number != 20) return;
    wait_for([&] {  // for twice as many as the queue holds
      RunLoop* const now = loop;
      return now != nullptr && now->report().num_frames > 20 + 64;
    });
  };
  RunOptions options;
  options.monitor = &monitor;
  options.keep_going = [&] { return num_frames < 150; };
  SyntheticStream stream(100000, 100);
  const auto device = pressing_device();
  const auto outcome = record_run(small_tool(), stream, *device, patient_settings(), run, options);
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_EQ(outcome->failure, "");
  EXPECT_GT(outcome->loop.num_lost_records, 0u);
  const std::string told = std::to_string(outcome->loop.num_lost_records) + " records were lost";
  EXPECT_TRUE(std::ranges::any_of(outcome->warnings, [&](const std::string& warning) {
    return warning.find(told) != std::string::npos;
  }));
  const auto summary = nlohmann::json::parse(read(run / "summary.json"));
  EXPECT_EQ(summary["lost_records"], outcome->loop.num_lost_records);
  const auto replay = replay_run(run);
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  EXPECT_NE(replay->note.find("was not recorded"), std::string::npos) << replay->note;
  EXPECT_GT(replay->num_contacts, 10u);
}

TEST(LiveRun, GoesOnWhenTheDiskIsFull) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  const pid_t child = fork();
  if (child == 0) {
    signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{800'000, 800'000};  // a second of ticks
    setrlimit(RLIMIT_FSIZE, &limit);
    // Until the recording has paused, and half a second of ticks more.
    std::atomic<double> paused = 0, now = 0;
    RunMonitor monitor;
    monitor.observer.on_ticks = [&](std::span<const TickRecord> ticks) { now = ticks.back().time; };
    RunOptions options;
    options.monitor = &monitor;
    options.duration = 120;
    options.say = [&](double time, std::string_view text) {
      if (text.find("the recording pauses") != std::string_view::npos) paused = time;
    };
    options.keep_going = [&] { return paused == 0 || now < paused + 0.5; };
    SyntheticStream stream(100000);
    const auto device = pressing_device();
    const auto outcome =
        record_run(small_tool(), stream, *device, patient_settings(), run, options);
    const bool has_reported =
        outcome && outcome->not_kept.find("nothing was recorded from") != std::string::npos;
    const bool has_gone_on = outcome && outcome->loop.seconds > paused && paused > 0;
    _exit(has_reported && has_gone_on && outcome->failure.empty() ? 0 : 1);
  }
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  const auto replay = replay_run(run);
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
}

}  // namespace
}  // namespace palpate
