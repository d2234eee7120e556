// All parts of a run in one thread, on the clock of the test.
#include "src/run/internal/pipeline.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/run/live_loop_fixtures.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

using test::box_tool;
using test::device_info;
using test::patient_settings;
using test::WallSource;

/// The tool 5 cm before the wall, then pressed 12 mm towards it, which is 10 mm in.
DeviceState state_at(double time) {
  DeviceState state;
  state.time = time;
  state.X_BH.translation.z = 0.037 * std::min(1.0, 2 * time);
  state.is_valid = true;
  return state;
}

/// Runs `num_ticks` ticks of a millisecond, with frames at 30 Hz.
std::vector<TickRecord> run(Pipeline& pipeline, int num_ticks, int first = 0,
                            std::vector<ContactRecord>* contacts = nullptr) {
  WallSource source({});
  DepthFrame frame;
  std::vector<TickRecord> ticks;
  int num_frames = 0;
  for (int k = 0; k < first + num_ticks; ++k) {
    const double time = 1e-3 * k;
    for (; num_frames / 30.0 <= time; ++num_frames) {
      EXPECT_TRUE(source.next(frame).value());
      if (k >= first) pipeline.push(frame, num_frames / 30.0);
    }
    if (k < first) continue;
    ticks.push_back(pipeline.tick(state_at(time)));
    if (contacts != nullptr) contacts->push_back(pipeline.contact());
  }
  return ticks;
}

Result<Pipeline> make(const RunSettings& settings) {
  const WallSource source({});
  return Pipeline::create(box_tool(), source.info(), device_info(), settings);
}

// A tool without coupling is where the hand is, and its contact is that of a query there.
TEST(Pipeline, WithoutCouplingMeasuresWhereTheToolIs) {
  RunSettings settings = patient_settings();
  settings.coupling.kind = CouplingKind::none;
  auto pipeline = make(settings);
  ASSERT_TRUE(pipeline) << pipeline.error().message;
  std::vector<ContactRecord> contacts;
  const auto ticks = run(*pipeline, 800, 0, &contacts);
  const double scale = 8 / (full_volume(box_tool(), settings.contact) / 8);
  for (std::size_t k = 0; k < ticks.size(); ++k) {
    const TickRecord& tick = ticks[k];
    EXPECT_NEAR(tick.step.X_WT.translation.z,
                0.45 + state_at(1e-3 * static_cast<double>(k)).X_BH.translation.z, 1e-15);
    EXPECT_EQ(contacts[k].X_WT, tick.step.X_WT);
    EXPECT_EQ(tick.contact_age, 0);
    EXPECT_EQ(tick.contact_number, k + 1);
    EXPECT_DOUBLE_EQ(tick.step.contact_W.force.z, scale * tick.penetration.measure_W.force.z);
    EXPECT_EQ(tick.F_H_B.force, Vec3d{});
    EXPECT_EQ(tick.safety.gain, 1);
  }
  // A cube of 5 cm, 12 mm in: its spheres fill some of that.
  EXPECT_GT(ticks.back().penetration.volume, 0.5 * 0.012 * 0.05 * 0.05);
  EXPECT_LT(ticks.back().penetration.volume, 1.1 * 0.012 * 0.05 * 0.05);
}

// A hand feels the contact of the tick before, and the surface holds the tool back.
TEST(Pipeline, AHandFeelsTheWallAndTheToolStaysBehind) {
  auto pipeline = make(patient_settings());
  ASSERT_TRUE(pipeline);
  const auto ticks = run(*pipeline, 1500);
  EXPECT_EQ(ticks.front().contact_number, 0u);
  for (std::size_t k = 1; k < ticks.size(); ++k) {
    ASSERT_EQ(ticks[k].contact_number, k);
    ASSERT_NEAR(ticks[k].contact_age, 1e-3, 1e-12);
  }
  const TickRecord& last = ticks.back();
  EXPECT_EQ(last.safety.fault, Fault::none);
  EXPECT_LT(last.F_H_B.force.z, -0.5);
  EXPECT_GT(last.step.stretch, 1e-4);
  EXPECT_LT(last.step.X_WT.translation.z, last.step.X_WT_hand.translation.z);
}

TEST(Pipeline, TheSameCallsGiveTheSameBits) {
  auto once = make(patient_settings());
  RunSettings threaded = patient_settings();
  threaded.num_threads = 2;
  auto again = make(threaded);
  ASSERT_TRUE(once && again);
  const auto a = run(*once, 300), b = run(*again, 300);
  for (std::size_t k = 0; k < a.size(); ++k) {
    ASSERT_EQ(a[k].F_H_B.force, b[k].F_H_B.force) << k;
    ASSERT_EQ(a[k].step.X_WT, b[k].step.X_WT) << k;
  }
}

// The objects push as the surface does: here there is a second box behind the first tick's tool.
TEST(Pipeline, ObjectsAreFeltByAHandToo) {
  RunSettings settings = patient_settings();
  const auto shape = std::make_shared<const Tool>(box_tool());
  settings.objects.push_back({shape, Pose{{0, 0.045, 0.45}, {}}});
  auto pipeline = make(settings);
  ASSERT_TRUE(pipeline);
  const auto ticks = run(*pipeline, 200);
  EXPECT_GT(ticks.back().objects.volume, 0);
  EXPECT_GT(ticks.back().num_object_pairs, 0);
  EXPECT_LT(ticks.back().F_H_B.force.y, -0.01);
}

// Unchanged parts stay; other surfaces take effect from the next frame on.
TEST(Pipeline, ChangesAreTakenBetweenTicks) {
  auto pipeline = make(patient_settings());
  ASSERT_TRUE(pipeline);
  run(*pipeline, 700);
  RunSettings other = patient_settings();
  other.contact.method = MethodKind::graph;
  other.coupling.kind = CouplingKind::direct;
  ASSERT_TRUE(pipeline->change(other));
  EXPECT_EQ(pipeline->revision(), 1u);
  EXPECT_EQ(pipeline->frame_revision(), 0u);
  const Pose X_WT = pipeline->contact().X_WT;
  const TickRecord& next = pipeline->tick(state_at(0.7));
  EXPECT_EQ(next.revision, 1u);
  EXPECT_LT(norm(next.step.X_WT.translation - X_WT.translation), 1e-3);
  EXPECT_EQ(pipeline->contact().revision, 0u);
  WallSource source({});
  DepthFrame frame;
  ASSERT_TRUE(source.next(frame).value());
  pipeline->push(frame, 0.7005);
  pipeline->tick(state_at(0.701));
  EXPECT_EQ(pipeline->contact().revision, 1u);
  EXPECT_GT(pipeline->contact().penetration.num_points, 0);

  other.safety.max_slew = 1;
  const Status refused = pipeline->change(other);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("safety.max_slew"), std::string::npos);
}

// The tool stays where it is, as in a hand, and its contact is measured where the tick has it.
TEST(Pipeline, WithoutCouplingAChangeOfScaleMeasuresWhereTheToolStays) {
  RunSettings settings = patient_settings();
  settings.coupling.kind = CouplingKind::none;
  auto pipeline = make(settings);
  ASSERT_TRUE(pipeline);
  run(*pipeline, 800);
  const Pose before = pipeline->contact().X_WT;
  settings.coupling.motion_scale = 2;
  ASSERT_TRUE(pipeline->change(settings));
  DeviceState state = state_at(0.8);
  for (int k = 800; k < 810; ++k) {
    state.time = 1e-3 * k;
    const TickRecord& tick = pipeline->tick(state);
    EXPECT_EQ(pipeline->contact().X_WT, tick.step.X_WT) << k;
    EXPECT_LT(norm(tick.step.X_WT.translation - before.translation), 1e-15) << k;
    EXPECT_GT(tick.penetration.volume, 0);
    DeviceState moved = state;
    moved.time += 5e-4;
    moved.X_BH.translation.y += 1e-4;
    const Vec3d way = pipeline->tick(moved).step.X_WT.translation - before.translation;
    EXPECT_LT(norm(way - Vec3d{0, 2e-4, 0}), 1e-15) << k;
  }
}

// A tick whose time is none: the others have theirs.
TEST(Pipeline, OneTickWithoutATimeIsOneTick) {
  for (const CouplingKind kind : {CouplingKind::virtual_coupling, CouplingKind::none}) {
    for (const int lost : {0, 100}) {
      RunSettings settings = patient_settings();
      settings.coupling.kind = kind;
      auto pipeline = make(settings);
      ASSERT_TRUE(pipeline);
      WallSource source({});
      DepthFrame frame;
      ASSERT_TRUE(source.next(frame).value());
      pipeline->push(frame, 0);
      TickRecord last;
      for (int k = 0; k < 2000; ++k) {
        DeviceState state = state_at(2e-4 * k);  // at the wall after 1.7 s: a fault is over by then
        state.time = k == lost ? std::nan("") : 1e-3 * k;
        last = pipeline->tick(state);
        if (k == lost) continue;
        ASSERT_GT(last.dt, 0) << k;
        ASSERT_LT(std::abs(last.time - 1e-3 * k), 1.1e-3) << k;
        ASSERT_LT(
            norm(last.step.X_WT_hand.translation - Vec3d{0, 0, 0.45} - state.X_BH.translation),
            1e-12)
            << k;
      }
      EXPECT_EQ(last.contact_number,
                pipeline->contact().number - (kind == CouplingKind::none ? 0 : 1));
      EXPECT_TRUE(last.safety.is_engaged());
      EXPECT_GT(last.penetration.volume, 0);
    }
  }
}

// Notes about a setting that is changed for weeks do not fill the memory.
TEST(Pipeline, NotesOfManyChangesHaveABound) {
  auto pipeline = make(patient_settings());
  ASSERT_TRUE(pipeline);
  RunSettings other = patient_settings();
  for (int i = 0; i < 20; ++i) {
    other.coupling.stiffness = 5000 + i % 2;
    ASSERT_TRUE(pipeline->change(other));
  }
  const std::size_t num = pipeline->notes().size();
  EXPECT_GE(num, 1u);
  EXPECT_LE(num, 4u);  // each once
  for (int i = 0; i < 300; ++i) {
    other.coupling.stiffness = 1500 + 10 * i;
    ASSERT_TRUE(pipeline->change(other));
  }
  EXPECT_EQ(pipeline->notes().size(), kMaxNotes);
}

// Fewer spheres: the forces of the coarser tool, about the same point.
TEST(Pipeline, FewerSpheresAreThoseOfThePrefixAboutTheSamePoint) {
  const WallSource source({});
  RunSettings settings = patient_settings();
  settings.num_spheres = 20;
  const auto index = ToolIndex::create(box_tool());
  const auto part = make_contact_part(index, settings, {}).value();
  const Tool prefix = box_tool().prefix(20).value();
  settings.num_spheres = 0;
  const auto expected = make_contact_part(ToolIndex::create(prefix), settings, {}).value();

  auto surfaces = make_surfaces(source.info(), settings).value();
  WallSource frames({});
  DepthFrame frame;
  ASSERT_TRUE(frames.next(frame).value());
  ThreadPool pool;
  surfaces.push(frame, 0, pool);
  ContactRecord few, same;
  few.X_WT = same.X_WT = {{0.002, -0.001, 0.49}, axis_angle({1, 2, 3}, 0.4)};
  const SurfaceBlend camera = surfaces.at(0);
  part->measure({&camera, 1}, false, few);
  expected->measure({&camera, 1}, false, same);
  ASSERT_GT(few.penetration.volume, 0);
  const VolumeWrench &a = few.penetration.measure_W, &b = same.penetration.measure_W;
  EXPECT_NEAR(few.penetration.volume, same.penetration.volume, 1e-6 * same.penetration.volume);
  EXPECT_LT(norm(a.force - b.force), 1e-6 * norm(b.force));
  // From the center of mass of the prefix to that of the tool.
  const Vec3d shift_W = rotate(few.X_WT.rotation, prefix.sphere_mass().center_of_mass -
                                                      box_tool().sphere_mass().center_of_mass);
  ASSERT_GT(norm(shift_W), 1e-6);
  EXPECT_LT(norm(a.torque - (b.torque + cross(shift_W, b.force))),
            1e-4 * norm(cross(shift_W, b.force)) + 1e-6 * norm(b.torque));
}

TEST(Pipeline, ATickAllocatesNothing) {
  auto pipeline = make(patient_settings());
  ASSERT_TRUE(pipeline);
  run(*pipeline, 600);
  const test::AllocationCounter counter;
  for (int k = 600; k < 620; ++k) pipeline->tick(state_at(1e-3 * k));
  EXPECT_EQ(counter.count(), 0u);
}

}  // namespace
}  // namespace palpate
