// Remembered surfaces behind those that have come before them: against the definition in double
// and against exact solids.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <optional>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/contact/contact.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/hull_scenes.h"
#include "tests/test_util/hull_truth.h"

namespace palpate {
namespace {

using test::HullScene;
using test::Random;

std::unique_ptr<ContactQuery> make_query(const Tool& tool, SphereVolumes volumes,
                                         Isa isa = best_isa(), ThreadPool* pool = nullptr) {
  ExecutionOptions execution;
  execution.isa = isa;
  execution.pool = pool;
  return make_contact_query(Place::cpu(), tool, FieldMethod{volumes}, execution).value();
}

Pose random_pose(Random& random) {
  const double x = random.uniform(-0.25, 0.25), y = random.uniform(-0.2, 0.2);
  return {{x, y, random.uniform(0.5, 1.4)}, random.rotation(3.0)};
}

// A hand passes over a table that is 1 m away: a ball of 50 mm radius 0.7 m from the camera.
constexpr double kTableDepth = 1.0, kHandDepth = 0.7, kHandRadius = 0.05, kThickness = 0.06;

test::Ray table_with_hand(std::optional<double> x) {
  return [x](const Vec3d& p, const Vec3d& d) {
    const double table = test::to_wall(p, d, kTableDepth);
    if (!x) return table;
    return std::min(table, test::to_ball(p, d, {*x, 0, kHandDepth}, kHandRadius));
  };
}

DepthFrame frame_of(const Camera& camera, const test::Ray& ray, double noise, Random& random) {
  DepthFrame frame{camera.width, camera.height, 0.0001, {}, 0};
  for (const float z : test::depth_seen(ray, camera, {})) {
    const double seen = z > 0 ? static_cast<double>(z) + noise * random.normal() : 0;
    frame.pixels.push_back(static_cast<std::uint16_t>(std::lround(seen / frame.unit)));
  }
  return frame;
}

TEST(Memory, EqualsItsDefinition) {
  Random random(41);
  for (const auto& [num_cameras, is_joined] :
       {std::pair{1, false}, {1, false}, {1, true}, {2, true}, {3, true}}) {
    const HullScene scene = test::rough_memories(num_cameras, random, is_joined);
    int num_with_force = 0, num_other = 0;
    for (const int num_spheres : {1, 33, 400}) {
      const Tool tool = test::random_tool(num_spheres, 0.06, 3);
      const auto query = make_query(tool, SphereVolumes::own);
      std::vector<SurfaceBlend> without = scene.views;
      for (SurfaceBlend& view : without) {
        view.from.in_front = view.to.in_front = {};
        view.from.remembered = view.to.remembered = {};
        if (!is_joined) view.from.role = view.to.role = SurfaceRole::frame;
      }
      for (int i = 0; i < 40; ++i) {
        const Pose X_WT = i % 2 == 0 ? random_pose(random) : test::pose_in_front(scene, random);
        const Penetration want = test::hull_truth(tool, scene.views, X_WT, SphereVolumes::own);
        const Penetration got = query->measure(scene.views, X_WT).penetration;
        const double scale = tool.sphere_mass().volume;
        num_with_force += want.volume > 0.01 * scale && want.volume < 0.99 * scale;
        num_other +=
            std::abs(query->measure(without, X_WT).penetration.volume - want.volume) > 0.01 * scale;
        EXPECT_NEAR(got.volume, want.volume, 3e-5 * scale);
        EXPECT_NEAR(got.potential, want.potential, 4e-6 * scale);
        EXPECT_NEAR(norm(got.measure_W.force - want.measure_W.force), 0, 2e-4 * scale);
        EXPECT_NEAR(norm(got.measure_W.torque - want.measure_W.torque), 0, 2e-5 * scale);
        if (is_joined && num_spheres > 100) {
          EXPECT_NEAR(got.unseen_volume, want.unseen_volume, 0.02 * scale);
        }
      }
    }
    EXPECT_GT(num_with_force, 10);
    EXPECT_GT(num_other, 10);  // it makes a difference
  }
}

// As with key frames, two of the cameras show only their memory, on the way from one place to
// another. A query keeps nothing of more cameras that it has measured before.
TEST(Memory, OfFramesFromOtherPlacesEqualsItsDefinition) {
  Random random(47);
  const HullScene scene = test::rough_memories(3, random, true),
                  other = test::rough_memories(3, random, true);
  std::vector<SurfaceBlend> views{scene.views[0]};
  for (std::size_t k = 1; k < 3; ++k) {
    views.push_back({other.views[k].to, scene.views[k].to, 0.4});
    for (SurfaceView* const view : {&views[k].from, &views[k].to}) {
      view->role = SurfaceRole::key_frame;
      view->seen_free = view->in_front = {};
      view->X_WC = {random.in_box(0.05), random.rotation(0.1)};
    }
  }
  const Tool tool = test::random_tool(200, 0.06, 3);
  const auto query = make_query(tool, SphereVolumes::own);
  const double scale = tool.sphere_mass().volume;
  int num_with_force = 0, num_other = 0;
  for (int i = 0; i < 60; ++i) {
    const Pose X_WT = i % 2 == 0 ? random_pose(random) : test::pose_in_front(scene, random);
    double last = -1;
    for (const std::size_t num : {3u, 2u, 1u}) {
      const std::span<const SurfaceBlend> some(views.data(), num);
      const Penetration want = test::hull_truth(tool, some, X_WT, SphereVolumes::own);
      const Penetration got = query->measure(some, X_WT).penetration;
      EXPECT_NEAR(got.volume, want.volume, 3e-5 * scale) << num;
      EXPECT_NEAR(norm(got.measure_W.force - want.measure_W.force), 0, 2e-4 * scale) << num;
      num_with_force += want.volume > 0.01 * scale && want.volume < 0.99 * scale;
      num_other += last >= 0 && std::abs(want.volume - last) > 0.01 * scale;
      last = want.volume;
    }
  }
  EXPECT_GT(num_with_force, 20);
  EXPECT_GT(num_other, 10);  // each of them makes a difference
}

TEST(Memory, WrenchIsMinusTheDerivativeOfThePotential) {
  Random random(42);
  for (const int num_cameras : {1, 2}) {
    const HullScene scene = test::rough_memories(num_cameras, random);
    const Tool tool = test::random_tool(150, 0.06, 5);
    for (int i = 0; i < 15; ++i) {
      const Pose X_WT = test::pose_in_front(scene, random);
      const auto truth = [&](const Vec3d& shift) {
        Pose moved = X_WT;
        moved.translation += shift;
        return test::hull_truth(tool, scene.views, moved, SphereVolumes::own, 1e9);
      };
      const Penetration at = truth({});
      for (int axis = 0; axis < 3; ++axis) {
        constexpr double kStep = 1e-6;
        Vec3d step;
        step[axis] = kStep;
        const double force = -(truth(step).potential - truth(-step).potential) / (2 * kStep);
        EXPECT_NEAR(at.measure_W.force[axis], force, 2e-4 * at.volume + 1e-12);
      }
    }
  }
}

TEST(Memory, StiffnessIsMinusTheDerivativeOfTheForce) {
  Random random(43);
  HullScene scene;
  const DepthFrame table = frame_of(test::vga(), table_with_hand({}), 0, random);
  const DepthFrame hand = frame_of(test::vga(), table_with_hand(0), 0, random);
  test::add_memory(scene, test::vga(), {table, table, table, table, hand}, {}, 0.8, false);
  const Tool tool = test::random_tool(300, 0.06, 5);
  const auto query = make_query(tool, SphereVolumes::own);
  std::vector<double> errors;
  for (int i = 0; i < 60; ++i) {
    const Pose X_WT{random.in_box(0.03) + Vec3d{0, 0, i % 2 == 0 ? 0.66 : 0.97},
                    random.rotation(3.0)};
    const ContactResult at = query->measure(scene.views, X_WT, {.stiffness = true});
    ASSERT_TRUE(at.stiffness);
    EXPECT_EQ(query->measure(scene.views, X_WT).penetration.volume, at.penetration.volume);
    if (at.penetration.volume < 0.05 * tool.sphere_mass().volume) continue;
    double largest = 0;
    for (const auto& row : at.stiffness->m) {
      for (int k = 0; k < 3; ++k) largest = std::max(largest, std::abs(row[k]));
    }
    for (int axis = 0; axis < 3; ++axis) {
      constexpr double kStep = 5e-5;
      Pose more = X_WT, less = X_WT;
      more.translation[axis] += kStep;
      less.translation[axis] -= kStep;
      const Vec3d change = query->measure(scene.views, more).penetration.measure_W.force -
                           query->measure(scene.views, less).penetration.measure_W.force;
      for (int k = 0; k < 3; ++k) {
        errors.push_back(std::abs(at.stiffness->m[k][axis] + change[k] / (2 * kStep)) / largest);
      }
    }
  }
  ASSERT_GT(errors.size(), 90u);
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() / 2], 0.01);
}

TEST(Memory, GivesTheSameBitsWithAnyThreadsAndInstructionSet) {
  Random random(44);
  ThreadPool pool(3);
  for (const int num_cameras : {1, 3}) {
    const HullScene scene = test::rough_memories(num_cameras, random);
    const Tool tool = test::random_tool(2000, 0.08, 4);
    const auto first = make_query(tool, SphereVolumes::represented, Isa::baseline);
    for (int i = 0; i < 10; ++i) {
      const Pose X_WT = test::pose_in_front(scene, random);
      for (const bool stiffness : {false, true}) {
        const ContactResult want = first->measure(scene.views, X_WT, {.stiffness = stiffness});
        for (const Isa isa : {Isa::avx2, Isa::avx512}) {
          const ContactResult got = make_query(tool, SphereVolumes::represented, isa, &pool)
                                        ->measure(scene.views, X_WT, {.stiffness = stiffness});
          EXPECT_EQ(got.penetration.volume, want.penetration.volume);
          EXPECT_EQ(got.penetration.potential, want.penetration.potential);
          EXPECT_EQ(got.penetration.measure_W.force, want.penetration.measure_W.force);
          EXPECT_EQ(got.penetration.measure_W.torque, want.penetration.measure_W.torque);
          if (stiffness) {
            EXPECT_EQ(std::memcmp(got.stiffness->m, want.stiffness->m, sizeof want.stiffness->m),
                      0);
          }
        }
      }
    }
  }
}

// Parts of balls that are far from all contact have the same values whether all of their vector
// are.
TEST(Memory, BallsInPartsHaveTheSameBitsWithAnyInstructionSet) {
  Random random(77);
  const HullScene scene = test::rough_memories(1, random);
  const Tool tool = test::random_tool(33, 0.07, 3);
  const auto first = make_query(tool, SphereVolumes::represented, Isa::baseline);
  const auto avx2 = make_query(tool, SphereVolumes::represented, Isa::avx2);
  const auto avx512 = make_query(tool, SphereVolumes::represented, Isa::avx512);
  int num_felt = 0;
  for (int i = 0; i < 2000; ++i) {
    const Pose X_WT{random.in_box(0.25) + Vec3d{0, 0, 0.8}, random.rotation(3.0)};
    const ContactWants wants{.stiffness = i % 2 == 0};
    const ContactResult want = first->measure(scene.views, X_WT, wants);
    num_felt += want.penetration.volume > 0;
    for (const auto& query : {avx2.get(), avx512.get()}) {
      const ContactResult got = query->measure(scene.views, X_WT, wants);
      EXPECT_EQ(got.penetration.volume, want.penetration.volume) << i;
      EXPECT_EQ(got.penetration.potential, want.penetration.potential) << i;
      EXPECT_EQ(got.penetration.measure_W.force, want.penetration.measure_W.force) << i;
      EXPECT_EQ(got.penetration.measure_W.torque, want.penetration.measure_W.torque) << i;
    }
  }
  EXPECT_GT(num_felt, 100);
}

// While nothing hides anything it measures what one camera measures without a memory.
TEST(Memory, WithNothingInFrontItIsOneCamera) {
  Random random(45);
  HullScene scene;
  const Camera camera{160, 120, {140, 140, 79.5, 59.5}};
  const DepthFrame frame = test::random_frame(camera.width, camera.height, random, false);
  test::add_memory(scene, camera, {frame, frame}, {}, 0.5, false);
  SurfaceView plain = scene.views[0].to;
  test::set_apart(plain);
  const Tool tool = test::random_tool(400, 0.06, 5);
  const auto query = make_query(tool, SphereVolumes::own);
  int num_with_force = 0;
  for (int i = 0; i < 40; ++i) {
    Pose X_WT = random_pose(random);
    if (i % 10 == 0) X_WT.translation.z = 0.04 * random.uniform(-1, 1);  // at the eye
    const Penetration got = query->measure(scene.views, X_WT).penetration;
    const Penetration want = query->measure(plain, X_WT).penetration;
    num_with_force += want.volume > 0;
    EXPECT_NEAR(got.volume, want.volume, 1e-5 * tool.sphere_mass().volume);
    EXPECT_NEAR(norm(got.measure_W.force - want.measure_W.force), 0,
                1e-4 * tool.sphere_mass().volume);
  }
  EXPECT_GT(num_with_force, 10);
}

/// The share of a ball that is in the table or in the slab behind the hand's surface, along its
/// normal, by exact rays.
double exact_share(double x, const Vec3d& center, double radius) {
  int num = 0, num_solid = 0;
  const Vec3d hand{x, 0, kHandDepth};
  test::for_points_in_ball(center, radius, [&](const Vec3d& p) {
    const Vec3d ray = (1 / p.z) * p, seen = test::to_ball({}, ray, hand, kHandRadius) * ray;
    const double depth = seen.z < 10 ? dot(seen - p, seen - hand) / kHandRadius : -1;
    ++num;
    num_solid += p.z > kTableDepth || (depth > 0 && depth < kThickness);
  });
  return static_cast<double>(num_solid) / num;
}

TEST(Memory, AHandPassesOverATable) {
  const Camera camera{320, 240, {262.5, 262.5, 159.5, 119.5}};
  const Tool tool = test::ball_tool(0.03, 1500);
  const auto query = make_query(tool, SphereVolumes::represented);
  const double whole = tool.mesh_mass().volume;
  for (const double noise : {0.0, 0.0015}) {
    Random random(46);
    ThreadPool pool(1);
    TimeOptions with, without;
    with.memory = {.kind = DepthMemory::on, .thickness = kThickness};
    const auto make = [&](const TimeOptions& time) {
      return SurfaceTimeline::create(test::stream_of(camera), {.time = time}).value();
    };
    SurfaceTimeline remembers = make(with), forgets = make(without);
    double time = 0;
    const auto push = [&](std::optional<double> x) {
      const DepthFrame frame = frame_of(camera, table_with_hand(x), noise, random);
      remembers.push(frame, time, pool);
      forgets.push(frame, time, pool);
      time += 1.0 / 30;
    };
    const auto felt = [&](SurfaceTimeline& timeline, const Vec3d& at) {
      SurfaceBlend view = timeline.at(time);
      view.progress = 1;
      return query->measure({&view, 1}, {at, {}}).penetration.volume / whole;
    };
    for (int i = 0; i < 5; ++i) push(std::nullopt);
    double column = 0, worst_error = 0;
    for (int i = 0; i <= 30; ++i) {
      const double x = -0.3 + 0.02 * i;
      push(x);
      const Vec3d behind{x * 0.87 / kHandDepth, 0, 0.87};  // along the hand's ray
      column = std::max(column, felt(forgets, behind));
      EXPECT_LT(felt(remembers, behind), 0.01) << "hand at " << x;
      EXPECT_LT(felt(remembers, {0, 0, 0.9}), 0.01) << "hand at " << x;
      // In the hand, at its back and at the table: what exact rays say.
      for (const Vec3d& p : {Vec3d{x, 0, 0.67},
                             {x, 0, 0.73},
                             {x + 0.05, 0, 0.7},
                             {0, 0, 0.99},
                             {x + 0.04, 0.01, 0.98}}) {
        const double error = std::abs(felt(remembers, p) - exact_share(x, p, 0.03));
        worst_error = std::max(worst_error, error);
      }
    }
    EXPECT_GT(column, 0.99);
    EXPECT_LT(worst_error, 0.06);
    // It leaves: nothing is left of it after one frame, anywhere on its way.
    push(std::nullopt);
    for (int i = 0; i <= 30; ++i) {
      const double x = -0.3 + 0.02 * i;
      for (const double z : {0.65, 0.7, 0.8, 0.95}) EXPECT_EQ(felt(remembers, {x, 0, z}), 0);
      EXPECT_NEAR(felt(remembers, {x, 0, 0.99}), felt(forgets, {x, 0, 0.99}), 1e-4);
    }
  }
}

// Two cameras side by side, both of which remember the table, and a hand that both see.
TEST(Memory, AHandPassesBeforeTwoCameras) {
  const Camera camera{320, 240, {262.5, 262.5, 159.5, 119.5}};
  const Tool tool = test::ball_tool(0.03, 1500);
  const auto query = make_query(tool, SphereVolumes::represented);
  const double whole = tool.mesh_mass().volume;
  const Pose eyes[] = {test::look_at({-0.03, 0, 0}, {0, 0, 1}),
                       test::look_at({0.03, 0, 0}, {0, 0, 1})};
  for (const double noise : {0.0, 0.0015}) {
    Random random(56);
    ThreadPool pool(1);
    DepthFieldOptions joined;
    joined.one_of_several = true;
    std::vector<SurfaceTimeline> remember, forget;
    for (int k = 0; k < 2; ++k) {
      for (const DepthMemory kind : {DepthMemory::on, DepthMemory::off}) {
        TimeOptions time;
        time.memory = {.kind = kind, .thickness = kThickness};
        (kind == DepthMemory::on ? remember : forget)
            .push_back(
                SurfaceTimeline::create(test::stream_of(camera), {.field = joined, .time = time})
                    .value());
      }
    }
    double time = 0;
    // Only the second camera sees a small ball when there is one.
    const auto push = [&](std::optional<double> x, std::optional<Vec3d> ball = {}) {
      const test::Ray scene = [&](const Vec3d& p, const Vec3d& d) {
        const double t = table_with_hand(x)(p, d);
        return ball ? std::min(t, test::to_ball(p, d, *ball, 0.03)) : t;
      };
      for (std::size_t k = 0; k < 2; ++k) {
        DepthFrame frame{camera.width, camera.height, 0.0001, {}, 0};
        for (const float z : test::depth_seen(scene, camera, eyes[k])) {
          const double seen = z > 0 ? static_cast<double>(z) + noise * random.normal() : 0;
          frame.pixels.push_back(static_cast<std::uint16_t>(std::lround(seen / frame.unit)));
        }
        frame.X_WC = eyes[k];
        remember[k].push(frame, time, pool);
        forget[k].push(frame, time, pool);
      }
      time += 1.0 / 30;
    };
    const auto measured = [&](std::vector<SurfaceTimeline>& timelines, const Vec3d& at) {
      std::vector<SurfaceBlend> views;
      for (SurfaceTimeline& timeline : timelines) {
        views.push_back(timeline.at(time));
        views.back().progress = 1;
      }
      return query->measure(views, {at, {}}).penetration;
    };
    const auto felt = [&](std::vector<SurfaceTimeline>& timelines, const Vec3d& at) {
      return measured(timelines, at).volume / whole;
    };
    for (int i = 0; i < 5; ++i) push(std::nullopt);
    double column = 0, worst = 0;
    for (int i = 0; i <= 20; ++i) {
      const double x = -0.2 + 0.02 * i;
      push(x);
      const Vec3d behind{x * 0.83 / kHandDepth, 0, 0.83};
      column = std::max(column, felt(forget, behind));
      worst = std::max(worst, felt(remember, behind));
      EXPECT_LT(measured(remember, behind).unseen_volume, 0.01 * whole);
      // Visible surfaces are as without a memory: hand and table.
      for (const Vec3d& p : {Vec3d{x, 0, 0.66}, {x + 0.25, 0, 0.99}, {x - 0.25, 0.05, 0.98}}) {
        EXPECT_NEAR(felt(remember, p), felt(forget, p), 2e-3) << x;
      }
      // The table behind the hand is where it was.
      const Vec3d at_table{x / kHandDepth, 0, 0.99};
      EXPECT_NEAR(felt(remember, at_table), cap_volume(0.03, 0.01) / sphere_volume(0.03), 0.03)
          << x;
    }
    EXPECT_GT(column, 0.9);
    EXPECT_LT(worst, 0.01);
    // A ball that the hand hides from the first camera is felt where the second one sees it.
    const double x = -0.12;
    const Vec3d ball = eyes[0].translation + 1.3 * (Vec3d{x, 0, kHandDepth} - eyes[0].translation);
    push(x, ball);
    double least = 1;
    for (int i = 0; i < 9; ++i) {
      const Vec3d out =
          rotate(axis_angle({0, 1, 0}, 0.1 * (i - 4)), normalized(eyes[1].translation - ball));
      const Vec3d p = ball + 0.04 * out;
      if (norm(cross(p - eyes[1].translation,
                     normalized(Vec3d{x, 0, kHandDepth} - eyes[1].translation))) < 0.1) {
        continue;  // not seen by the second one either
      }
      const std::vector<SurfaceBlend> second{{remember[1].at(time).to, remember[1].at(time).to, 1}};
      const double alone = query->measure(second, {p, {}}).penetration.volume / whole;
      least = std::min(least, felt(remember, p) / alone);
      EXPECT_GT(alone, 0.05);
    }
    EXPECT_GT(least, 0.95);
    // It leaves: nothing is left of it after one frame.
    push(std::nullopt);
    for (int i = 0; i <= 20; ++i) {
      const double at = -0.2 + 0.02 * i;
      for (const double z : {0.65, 0.7, 0.8, 0.95}) EXPECT_EQ(felt(remember, {at, 0, z}), 0);
      EXPECT_EQ(felt(remember, {at, 0, 0.99}), felt(forget, {at, 0, 0.99}));
    }
  }
}

TEST(Memory, DescribesItsSpheres) {
  Random random(47);
  const Tool tool = test::random_tool(200, 0.06, 5);
  const auto query = make_query(tool, SphereVolumes::own);
  std::vector<SphereState> states(200);
  std::vector<Plane<float>> planes(200);
  std::vector<std::int8_t> deciders(200);
  int num_cut = 0, num_decided[4] = {};
  for (int i = 0; i < 40; ++i) {
    const int num_cameras = i % 2 == 0 ? 1 : 3;
    const HullScene scene = test::rough_memories(num_cameras, random);
    const Pose X_WT = test::pose_in_front(scene, random);
    query->measure(scene.views, X_WT, {.states = states, .planes = planes, .deciders = deciders});
    int num_wrong = 0;
    for (std::size_t s = 0; s < states.size(); ++s) {
      const double r = tool.spheres()[s].radius;
      const Vec3d c_T = to_double(tool.spheres()[s].center);
      const test::HullTruth want = test::hull_of(scene.views, X_WT * c_T, r);
      if (std::abs(std::abs(want.at.phi) - r) < 1e-5) continue;
      EXPECT_EQ(states[s], test::state_at(want.at.phi, r));
      num_cut += states[s] == SphereState::boundary;
      if (num_cameras == 1) {
        EXPECT_EQ(deciders[s], 0);
      } else if (states[s] == SphereState::outside) {
        EXPECT_EQ(deciders[s], kNoCamera);
      } else {
        ++num_decided[deciders[s] + 1];
        num_wrong += deciders[s] != want.decider;
      }
    }
    EXPECT_LE(num_wrong, 2);  // cameras that almost agree
  }
  EXPECT_GT(num_cut, 20);
  for (const int num : num_decided) EXPECT_GT(num, 5);
}

TEST(Memory, QueriesAllocateNothing) {
  Random random(48);
  const HullScene scene = test::rough_memories(1, random);
  const Tool tool = test::random_tool(500, 0.06, 5);
  const auto query = make_query(tool, SphereVolumes::own);
  const test::AllocationCounter counter;
  query->measure(scene.views, {{0, 0, 0.9}, {}}, {.stiffness = true});
  EXPECT_EQ(counter.count(), 0);
}

}  // namespace
}  // namespace palpate
