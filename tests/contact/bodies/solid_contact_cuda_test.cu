// Bodies that sample each other's distance fields, on a GPU against the CPU.
#include "src/contact/bodies/solid_contact_cuda.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include <gtest/gtest.h>

#include "palpate/contact/body_contact.h"
#include "palpate/packing/packing.h"
#include "src/contact/bodies/solid_contact.h"
#include "src/gpu/internal/device_code.cuh"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/body_motion.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

Tool packed(const TriangleMesh& mesh, int num) {
  return Tool::pack(mesh, {.max_spheres = num}).value().with_solid_field();
}

struct Pair {
  explicit Pair(const Tool& a, const Tool& b)
      : cpu(ToolIndex::create(a), ToolIndex::create(b)),
        gpu(std::move(make_solid_contact_cuda(ToolIndex::create(a), ToolIndex::create(b), 0))
                .value()) {}

  SolidContact cpu;
  std::unique_ptr<BodyPairQuery> gpu;
};

// The elements' sums are single precision on both, in another order.
constexpr double kRounding = 2e-6;

void expect_near(const Penetration& got, const Penetration& want, double size) {
  const double tolerance = kRounding * want.volume;
  EXPECT_NEAR(got.volume, want.volume, tolerance);
  EXPECT_NEAR(got.potential, want.potential, kRounding * want.potential);
  EXPECT_LE(norm(got.measure_W.force - want.measure_W.force), tolerance);
  EXPECT_LE(norm(got.measure_W.torque - want.measure_W.torque), tolerance * size);
  EXPECT_EQ(got.num_boundary_spheres, want.num_boundary_spheres);
  EXPECT_EQ(got.num_inside_spheres, want.num_inside_spheres);
  EXPECT_EQ(got.status, want.status);
}
void expect_near(const BodyPenetration& got, const BodyPenetration& want, double size) {
  EXPECT_EQ(got.num_pairs, want.num_pairs);
  expect_near(got.on_a, want.on_a, size);
  expect_near(got.on_b, want.on_b, size);
  ASSERT_EQ(got.stiffness_a.has_value(), want.stiffness_a.has_value());
  if (!want.stiffness_a) return;
  double largest = 0;
  for (int i = 0; i < 3; ++i) largest = std::max(largest, std::abs(want.stiffness_a->m[i][i]));
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column) {
      EXPECT_NEAR(got.stiffness_a->m[row][column], want.stiffness_a->m[row][column],
                  1e-5 * largest);
      EXPECT_NEAR(got.stiffness_b->m[row][column], want.stiffness_b->m[row][column],
                  1e-5 * largest);
    }
  }
}

TEST(SolidContactCuda, EqualsTheCpuOnRandomPoses) {
  PALPATE_GPU_OR_SKIP();
  const Tool torus = packed(make_torus(0.05, 0.02, 24, 16), 700);
  const Tool box = packed(make_box({0.09, 0.07, 0.05}), 500);
  const Tool block = packed(make_box({0.4, 0.4, 0.4}), 200);
  test::Random random(3);
  int num_with_force = 0;
  for (const auto& [a, b] :
       {std::pair{&torus, &box}, std::pair{&box, &block}, std::pair{&block, &torus}}) {
    Pair pair(*a, *b);
    for (int i = 0; i < 12; ++i) {
      const Pose X_WB = test::random_body_pose(random, 0.3);
      const Pose X_WA = X_WB * test::random_body_pose(random, b == &box ? 0.06 : 0.2);
      for (const bool wants_stiffness : {false, true}) {
        const BodyPenetration want = pair.cpu.measure(X_WA, X_WB, wants_stiffness);
        expect_near(pair.gpu->measure(X_WA, X_WB, wants_stiffness), want, 0.1);
        num_with_force += want.on_a.volume > 0;
      }
    }
  }
  EXPECT_GT(num_with_force, 30);
}

TEST(SolidContactCuda, NonFiniteAndFarPoses) {
  PALPATE_GPU_OR_SKIP();
  const Tool cube = packed(make_box({0.1, 0.1, 0.1}), 50);
  Pair pair(cube, cube);
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    expect_near(pair.gpu->measure({{bad, 0, 0}, {}}, {}), pair.cpu.measure({{bad, 0, 0}, {}}, {}),
                0.1);
    expect_near(pair.gpu->measure({}, {{}, {0, 0, bad, 1}}),
                pair.cpu.measure({}, {{}, {0, 0, bad, 1}}), 0.1);
  }
  for (const double far : {1.0, 1e30, 1e300}) {
    EXPECT_EQ(pair.gpu->measure({{far, 0, 0}, {}}, {{0, far, 0}, {}}).on_a.volume, 0);
  }
  expect_near(pair.gpu->measure({}, {}), pair.cpu.measure({}, {}), 0.1);
}

TEST(SolidContactCuda, SameBitsEveryTime) {
  PALPATE_GPU_OR_SKIP();
  const Tool torus = packed(make_torus(0.05, 0.02, 24, 16), 700);
  const Tool box = packed(make_box({0.09, 0.07, 0.05}), 500);
  Pair pair(torus, box);
  const Pose X_WA{{0.03, 0.02, 0.01}, axis_angle({1, 2, 3}, 0.7)};
  const BodyPenetration want = pair.gpu->measure(X_WA, {}, true);
  ASSERT_GT(want.num_pairs, 100);
  const auto expect_same_bits = [&](const BodyPenetration& got) {
    EXPECT_EQ(got.on_a.volume, want.on_a.volume);
    EXPECT_EQ(std::memcmp(&got.on_a.measure_W, &want.on_a.measure_W, sizeof(VolumeWrench)), 0);
    EXPECT_EQ(std::memcmp(&got.on_b.measure_W, &want.on_b.measure_W, sizeof(VolumeWrench)), 0);
    EXPECT_EQ(std::memcmp(got.stiffness_b->m, want.stiffness_b->m, sizeof(Stiffness)), 0);
  };
  (void)pair.gpu->measure({{0.02, 0, 0}, {}}, {});
  expect_same_bits(pair.gpu->measure(X_WA, {}, true));
#if defined(PALPATE_EMULATE_CUDA)
  for (const std::uint32_t order : {1u, 2u, 3u}) {
    emulator::set_order(order);
    expect_same_bits(pair.gpu->measure(X_WA, {}, true));
    emulator::set_order(0);
  }
#else
  const test::AllocationCounter counter;
  (void)pair.gpu->measure(X_WA, {}, true);
  EXPECT_EQ(counter.count(), 0u);
#endif
}

TEST(SolidContactCuda, MeasuresTheBodiesOfAWorld) {
  PALPATE_GPU_OR_SKIP();
  const Tool tool = packed(make_box({0.1, 0.08, 0.06}), 200);
  BodyWorld world, want;
  for (BodyWorld* w : {&world, &want}) {
    w->add_tool(tool, nullptr);
    w->add_object(tool, {{0.03, 0, 0}, {}});
    w->add_tool(tool, nullptr);
    w->set_pose(2, {{0, 0.04, 0.01}, axis_angle({1, 0, 0}, 1)});
    w->set_wants(2, {.stiffness = true});
  }
  const Status done = world.measure_pairs_by(
      [](const auto& a, const auto& b) { return make_solid_contact_cuda(a, b, 0); });
  ASSERT_TRUE(done) << done.error().message;
  world.measure(SurfaceView{});
  want.measure(SurfaceView{});
  for (int body = 0; body < 3; ++body) {
    ASSERT_GT(want.measured(body).num_pairs, 0);
    EXPECT_EQ(world.measured(body).num_pairs, want.measured(body).num_pairs);
    expect_near(world.measured(body).bodies, want.measured(body).bodies, 0.1);
    EXPECT_EQ(world.measured(body).bodies_stiffness.has_value(), body == 2);
  }
}

}  // namespace
}  // namespace palpate
