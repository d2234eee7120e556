// Runs with cameras that stand anywhere or move, and with several of them.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <map>
#include <mutex>

#include "src/run/internal/pipeline.h"
#include "tests/run/live_loop_fixtures.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/posed_wall.h"

namespace palpate {
namespace {

using test::beside_wall;
using test::box_tool;
using test::device_info;
using test::patient_settings;
using test::PosedWall;

constexpr double kTick = 1e-3;

/// The tool itself, 10 mm in the wall.
RunSettings settings_of_path() {
  RunSettings settings = patient_settings();
  settings.coupling.kind = CouplingKind::none;
  settings.coupling.X_WB = {};
  return settings;
}
DeviceState pressed(double time) {
  DeviceState state;
  state.time = time;
  state.X_BH = {{0.005, -0.003, 0.485}, axis_angle({1, 2, 3}, 0.2)};
  state.is_valid = true;
  return state;
}

/// Cameras with their frames on a clock of the test.
struct Rig {
  explicit Rig(std::vector<PosedWall> walls) : sources(std::move(walls)) {
    for (const PosedWall& source : sources) infos.push_back(source.info());
  }
  Result<Pipeline> make(const RunSettings& settings) const {
    return Pipeline::create(box_tool(), infos, device_info(), settings);
  }
  /// All frames up to this time.
  void push(Pipeline& pipeline, double time) {
    num_pushed.resize(sources.size());
    for (std::size_t k = 0; k < sources.size(); ++k) {
      for (; num_pushed[k] / infos[k].rate <= time; ++num_pushed[k]) {
        ASSERT_TRUE(sources[k].next(frame).value());
        pipeline.push(frame, frame.timestamp, k);
      }
    }
  }

  std::vector<PosedWall> sources;
  std::vector<DepthStreamInfo> infos;
  std::vector<int> num_pushed;
  DepthFrame frame;
};

/// Measures the pressed tool with one camera in front of the wall, at the origin.
Penetration seen_from_front() {
  Rig rig({PosedWall(Pose{})});
  Pipeline pipeline = rig.make(settings_of_path()).value();
  rig.push(pipeline, 0);
  return pipeline.tick(pressed(0)).penetration;
}

void expect_as_from_front(const Penetration& got, double share) {
  static const Penetration want = seen_from_front();
  EXPECT_NEAR(got.volume, want.volume, share * want.volume);
  const Vec3d &a = got.measure_W.force, &b = want.measure_W.force;
  EXPECT_LT(norm(a - b), share * norm(b));
  EXPECT_LT(norm(got.measure_W.torque - want.measure_W.torque), share * norm(b) * 0.05);
}

TEST(SeveralCameras, OneThatStandsElsewhereFeelsTheSameWall) {
  // Known in closed form: the first moments of a wall are those of a half space.
  EXPECT_NEAR(normalized(seen_from_front().measure_W.force).z, -1, 1e-4);
  for (const double angle : {-0.5, -0.2, 0.3, 0.6}) {
    Rig rig({PosedWall(beside_wall(angle))});
    Pipeline pipeline = rig.make(settings_of_path()).value();
    rig.push(pipeline, 0);
    expect_as_from_front(pipeline.tick(pressed(0)).penetration, 0.01);
  }
}

TEST(SeveralCameras, OneThatMovesFeelsAWallThatStandsStill) {
  Rig rig({PosedWall([](double time) { return beside_wall(0.6 * std::sin(2 * time)); })});
  ASSERT_TRUE(rig.infos[0].is_moving);
  Pipeline pipeline = rig.make(settings_of_path()).value();
  double last = 0;
  for (int i = 0; i < 1500; ++i) {
    rig.push(pipeline, i * kTick);
    const TickRecord& tick = pipeline.tick(pressed(i * kTick));
    expect_as_from_front(tick.penetration, 0.01);
    // Frames replace each other without a step.
    if (i > 0) {
      EXPECT_NEAR(tick.penetration.volume, last, 1e-3 * last);
    }
    last = tick.penetration.volume;
  }
}

TEST(SeveralCameras, AreJoinedEachWithItsOwnRate) {
  Rig rig({PosedWall(beside_wall(0.5), 30), PosedWall(beside_wall(-0.4), 11),
           PosedWall([](double time) { return beside_wall(0.2 * std::sin(3 * time)); }, 60)});
  Pipeline pipeline = rig.make(settings_of_path()).value();
  for (int i = 0; i < 500; ++i) {
    const double time = i * kTick;
    rig.push(pipeline, time);
    const TickRecord& tick = pipeline.tick(pressed(time));
    expect_as_from_front(tick.penetration, 0.015);
    const CameraBlends& cameras = pipeline.contact().cameras;
    ASSERT_EQ(cameras.num, 3u);
    int newest = 0;
    double oldest = 1e9;
    for (int k = 0; k < 3; ++k) {
      EXPECT_EQ(cameras.of[k].camera_frame, rig.num_pushed[static_cast<std::size_t>(k)] - 1);
      newest += rig.num_pushed[static_cast<std::size_t>(k)];
      oldest = std::min(oldest, (rig.num_pushed[static_cast<std::size_t>(k)] - 1) /
                                    rig.infos[static_cast<std::size_t>(k)].rate);
    }
    EXPECT_EQ(pipeline.contact().frame_number, static_cast<std::uint64_t>(newest - 1));
    EXPECT_NEAR(tick.sensor_age, time - oldest, 1e-12);
    const auto answer =
        pipeline.query().measure(pipeline.cameras(), pipeline.contact().X_WT).penetration;
    EXPECT_EQ(answer.volume, tick.penetration.volume);
  }
}

TEST(SeveralCameras, OneThatHasShownNothingYetAbstains) {
  Rig rig({PosedWall(beside_wall(0.5)), PosedWall(beside_wall(-0.4))});
  Pipeline pipeline = rig.make(settings_of_path()).value();
  ASSERT_TRUE(rig.sources[1].next(rig.frame).value());
  pipeline.push(rig.frame, 0, 1);
  const TickRecord tick = pipeline.tick(pressed(0));
  EXPECT_EQ(pipeline.contact().cameras.of[0].camera_frame, -1);
  EXPECT_EQ(pipeline.contact().cameras.of[1].camera_frame, 0);
  expect_as_from_front(tick.penetration, 0.01);
}

// Surfaces of some cameras by the old settings and of others by the new ones would be no scene.
TEST(SeveralCameras, ChangeTheirSurfacesTogether) {
  Rig rig({PosedWall(beside_wall(0.5), 30), PosedWall(beside_wall(-0.4), 10)});
  RunSettings settings = settings_of_path();
  Pipeline pipeline = rig.make(settings).value();
  rig.push(pipeline, 0);
  pipeline.tick(pressed(0));
  settings.binning = 2;
  ASSERT_TRUE(pipeline.change(settings));
  std::int64_t before = 0;
  for (int i = 1; i < 300; ++i) {
    rig.push(pipeline, i * kTick);
    pipeline.tick(pressed(i * kTick));
    const ContactRecord& contact = pipeline.contact();
    const bool have_both = rig.num_pushed[0] > 1 && rig.num_pushed[1] > 1;
    EXPECT_EQ(contact.revision, have_both ? 1u : 0u);
    EXPECT_EQ(contact.cameras.of[0].camera_frame, have_both ? rig.num_pushed[0] - 1 : 0);
    expect_as_from_front(contact.penetration, 0.03);
    before = std::max(before, contact.cameras.of[0].camera_frame);
  }
  EXPECT_GT(before, 5);
}

TEST(SeveralCameras, AllocateNothing) {
  Rig rig({PosedWall(beside_wall(0.5)),
           PosedWall([](double time) { return beside_wall(0.2 * std::sin(3 * time)); })});
  Pipeline pipeline = rig.make(settings_of_path()).value();
  rig.push(pipeline, 0.1);
  pipeline.tick(pressed(0.1));
  const test::AllocationCounter counter;
  for (int i = 0; i < 20; ++i) pipeline.tick(pressed(0.1 + i * kTick));
  EXPECT_EQ(counter.count(), 0u);
}

TEST(SeveralCameras, AreRefusedWhereTheyCannotBeJoined) {
  const auto why_not = [](const std::vector<DepthStreamInfo>& infos, const RunSettings& settings) {
    const auto made = Pipeline::create(box_tool(), infos, device_info(), settings);
    return made ? std::string() : made.error().message;
  };
  const DepthStreamInfo still = PosedWall(Pose{}).info();
  DepthStreamInfo moving = still;
  moving.is_moving = true;
  RunSettings settings = settings_of_path();
  EXPECT_EQ(why_not({still, moving}, settings), "");
  EXPECT_NE(why_not({}, settings).find("1 to 16 cameras"), std::string::npos);
  EXPECT_NE(why_not(std::vector(17, still), settings).find("not 17"), std::string::npos);
  settings.contact.method = MethodKind::graph;
  EXPECT_NE(why_not({still, still}, settings).find("method field"), std::string::npos);
  EXPECT_EQ(why_not({moving}, settings), "");
  settings = settings_of_path();
  settings.time.mode = TimeMode::predict;
  EXPECT_EQ(why_not({still, still}, settings), "");
  EXPECT_NE(why_not({still, moving}, settings).find("static camera"), std::string::npos);
  settings.time = {};
  settings.time.average.kind = DepthAverage::exponential;
  EXPECT_NE(why_not({moving}, settings).find("static camera"), std::string::npos);
}

/// Frames and contacts that a live loop publishes.
struct Records {
  RunObserver observer() {
    RunObserver all;
    all.on_frame = [this](const FrameRecord& frame, const DepthFrame& image) {
      frames.push_back(frame);
      EXPECT_EQ(frame.X_WC, image.X_WC);
    };
    all.on_contact = [this](const ContactRecord& contact) {
      const std::lock_guard lock(mutex);
      contacts.push_back(contact);
    };
    return all;
  }
  std::size_t num_contacts() {
    const std::lock_guard lock(mutex);
    return contacts.size();
  }

  std::vector<FrameRecord> frames;
  std::mutex mutex;
  std::vector<ContactRecord> contacts;
};

TEST(SeveralCameras, OneThatEndsIsNamed) {
  PosedWall first(beside_wall(0.5), 60);
  PosedWall second([](double) { return beside_wall(-0.4); }, 60, 0.5, 12);
  test::ScriptedDevice device({.hand = [](double) { return pressed(0).X_BH.translation; }});
  auto loop =
      RunLoop::create(box_tool(), DepthSources({&first, &second}), device, settings_of_path());
  ASSERT_TRUE(loop) << loop.error().message;
  ASSERT_TRUE((*loop)->start());
  EXPECT_TRUE(test::wait_for([&] { return !(*loop)->is_running(); }));
  (*loop)->stop();
  EXPECT_TRUE((*loop)->status());
  EXPECT_EQ((*loop)->report().ending, "the depth frames of camera_2 (a wall) have ended");
}

TEST(SeveralCameras, AreFeltLive) {
  PosedWall left(beside_wall(0.5), 60), right(beside_wall(-0.4), 25);
  PosedWall moving([](double time) { return beside_wall(0.2 * std::sin(3 * time)); }, 40);
  const DepthSources sources({&left, &right, &moving});
  test::ScriptedDevice device({.hand = [](double) { return pressed(0).X_BH.translation; }});
  RunSettings settings = settings_of_path();
  settings.coupling.X_HT.rotation = pressed(0).X_BH.rotation;
  Records reported;
  auto made = RunLoop::create(box_tool(), sources, device, settings, reported.observer());
  ASSERT_TRUE(made) << made.error().message;
  RunLoop& loop = **made;
  ASSERT_TRUE(loop.start());
  ASSERT_TRUE(test::wait_for([&] { return reported.num_contacts() > 300; }));
  settings.binning = 2;
  ASSERT_TRUE(loop.change(settings));
  const std::size_t at_change = reported.num_contacts();
  ASSERT_TRUE(test::wait_for([&] { return reported.num_contacts() > at_change + 300; }));
  loop.stop();
  EXPECT_TRUE(loop.status()) << loop.status().error().message;

  // A busy machine may have lost some, which it counts.
  const bool has_all = loop.report().num_lost_records == 0;
  std::uint64_t next = 0;
  std::vector<std::uint64_t> next_of(3);
  std::vector<std::map<std::uint64_t, std::uint32_t>> revisions(3);  // of each camera's surfaces
  for (const FrameRecord& frame : reported.frames) {
    ASSERT_LT(frame.camera, 3u);
    std::uint64_t& next_here = next_of[frame.camera];
    if (has_all) {
      EXPECT_EQ(frame.number, next);
      EXPECT_EQ(frame.camera_frame, next_here);
    }
    EXPECT_GE(frame.number, next);
    EXPECT_GE(frame.camera_frame, next_here);
    next = frame.number + 1;
    next_here = frame.camera_frame + 1;
    revisions[frame.camera][frame.camera_frame] = frame.revision;
  }
  std::vector<std::int64_t> last(3);
  for (const ContactRecord& contact : reported.contacts) {
    ASSERT_EQ(contact.cameras.num, 3u);
    for (std::size_t k = 0; k < 3; ++k) {
      const std::int64_t frame = contact.cameras.of[k].camera_frame;
      EXPECT_GE(frame, last[k]);
      last[k] = frame;
      // Never one camera in the new way and another one in the old.
      const auto found = revisions[k].find(static_cast<std::uint64_t>(frame));
      if (found != revisions[k].end()) {
        EXPECT_EQ(found->second, contact.revision);
      }
    }
    if (contact.penetration.volume > 0) expect_as_from_front(contact.penetration, 0.03);
  }
  for (std::size_t k = 0; k < 3; ++k) EXPECT_GT(last[k], 3);
  EXPECT_EQ(reported.contacts.back().revision, 1u);
}

}  // namespace
}  // namespace palpate
