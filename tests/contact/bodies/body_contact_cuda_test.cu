// Bodies on a GPU against the CPU.
#include "src/contact/bodies/body_contact_cuda.h"

#include <cmath>
#include <cstring>
#include <limits>

#include <gtest/gtest.h>

#include "palpate/contact/body_contact.h"
#include "palpate/packing/packing.h"
#include "src/gpu/internal/device_code.cuh"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

using test::Random;

std::unique_ptr<BodyPairQuery> on_gpu(const Tool& a, const Tool& b) {
  return std::move(make_body_contact_cuda(ToolIndex::create(a), ToolIndex::create(b), 0)).value();
}

Pose random_pose(Random& random, double reach) {
  const Quaternion q = random.rotation(3.0);
  return {random.in_box(reach), q};
}

Tool tool_of(std::vector<Sphere> spheres) {
  SpherePacking packing;
  packing.spheres = std::move(spheres);
  const std::size_t num = packing.spheres.size();
  // Neither graph nor represented volumes matter here, and building them takes long.
  std::vector<std::pair<int, int>> chain;
  for (int i = 1; i < static_cast<int>(num); ++i) chain.emplace_back(i - 1, i);
  Tool::StoredParts parts;
  parts.graph = LeafGraph(num, chain, 0, 1);
  parts.represented.volumes.assign(num, 1.0f / static_cast<float>(num));
  parts.represented.balls = packing.spheres;
  const InnerSphereTree tree(packing.spheres);
  parts.tree_nodes.assign(tree.nodes().begin(), tree.nodes().end());
  return Tool::restore(make_box({1, 1, 1}), std::move(packing), std::move(parts), "").value();
}

Tool packed(const TriangleMesh& mesh, int num) {
  return Tool::pack(mesh, {.max_spheres = num}).value();
}

void expect_near(const Penetration& got, const Penetration& want) {
  const double tolerance = 1e-12 * want.volume;
  EXPECT_NEAR(got.volume, want.volume, tolerance);
  EXPECT_LE(norm(got.measure_W.force - want.measure_W.force), tolerance);
  EXPECT_LE(norm(got.measure_W.torque - want.measure_W.torque), tolerance);
  EXPECT_EQ(got.num_boundary_spheres, want.num_boundary_spheres);
  EXPECT_EQ(got.status, want.status);
}
void expect_near(const BodyPenetration& got, const BodyPenetration& want) {
  EXPECT_EQ(got.num_pairs, want.num_pairs);
  expect_near(got.on_a, want.on_a);
  expect_near(got.on_b, want.on_b);
}

void expect_same_bits(const BodyPenetration& got, const BodyPenetration& want) {
  EXPECT_EQ(got.num_pairs, want.num_pairs);
  for (const auto& [g, w] : {std::pair{&got.on_a, &want.on_a}, std::pair{&got.on_b, &want.on_b}}) {
    EXPECT_EQ(g->volume, w->volume);
    EXPECT_EQ(std::memcmp(&g->measure_W, &w->measure_W, sizeof(VolumeWrench)), 0);
    EXPECT_EQ(g->num_boundary_spheres, w->num_boundary_spheres);
  }
}

TEST(BodyContactCuda, EqualsTheCpuOnRandomPoses) {
  PALPATE_GPU_OR_SKIP();
  struct Case {
    int num_a, num_b, num_poses;
    double half_a, half_b;
  };
  Random random(3);
  std::int64_t num_pairs = 0;
  for (const Case& c : {Case{1, 1, 10, 0.05, 0.05}, Case{1, 300, 10, 0.05, 0.05},
                        Case{300, 7, 10, 0.05, 0.01}, Case{500, 300, 10, 0.05, 0.08}}) {
    const Tool a = test::random_tool(c.num_a, c.half_a, 5);
    const Tool b = test::random_tool(c.num_b, c.half_b, 6);
    BodyContact on_cpu(a, b);
    const auto query = on_gpu(a, b);
    for (int i = 0; i < c.num_poses; ++i) {
      const Pose X_WB = random_pose(random, 0.3);
      const Pose X_WA = X_WB * random_pose(random, 0.7 * (c.half_a + c.half_b));
      const BodyPenetration want = on_cpu.measure(X_WA, X_WB);
      expect_near(query->measure(X_WA, X_WB), want);
      num_pairs += want.num_pairs;
    }
  }
  EXPECT_GT(num_pairs, 1000);
}

// More groups of clusters than a warp has lanes for at once, spheres of very different sizes.
TEST(BodyContactCuda, EqualsTheCpuOnPackings) {
  PALPATE_GPU_OR_SKIP();
  const Tool box = packed(make_box({0.1, 0.1, 0.1}), 3000);
  const Tool torus = packed(make_torus(0.07, 0.03, 24, 16), 1000);
  BodyContact on_cpu(torus, box);
  const auto query = on_gpu(torus, box);
  for (const double x : {0.0, 0.06, 0.12}) {
    const Pose X_WA{{x, 0.3, 0.02}, axis_angle({1, 2, 3}, 0.7)}, X_WB{{0, 0.3, 0}, {}};
    const BodyPenetration want = on_cpu.measure(X_WA, X_WB);
    ASSERT_GT(want.num_pairs, 100);
    expect_near(query->measure(X_WA, X_WB), want);
  }
}

// As many spheres of B as fill more than 32 groups of 512, in a row; one of A touches the last.
TEST(BodyContactCuda, ReachesTheLastGroup) {
  PALPATE_GPU_OR_SKIP();
  std::vector<Sphere> row;
  for (int i = 0; i < 33 * 512 + 5; ++i)
    row.push_back({{1e-4f * static_cast<float>(i), 0, 0}, 4e-5f});
  const Tool b = tool_of(row), a = tool_of({{{0, 0, 0}, 0.0003f}});
  BodyContact on_cpu(a, b);
  const auto query = on_gpu(a, b);
  for (const double x : {0.0, 0.8, 1e-4 * 33 * 512}) {
    const BodyPenetration want = on_cpu.measure({{x, 1e-5, 0}, {}}, {});
    ASSERT_GT(want.num_pairs, 2);
    expect_near(query->measure({{x, 1e-5, 0}, {}}, {}), want);
  }
}

// Touching in the last bit or not, and far from the origin: the same pairs as in double.
TEST(BodyContactCuda, DecidesCloseCallsLikeTheCpu) {
  PALPATE_GPU_OR_SKIP();
  std::vector<Sphere> grid;
  for (int i = 0; i < 400; ++i) {
    grid.push_back(
        {{0.25f * static_cast<float>(i % 20), 0.25f * static_cast<float>(i / 20), 0}, 0.125f});
  }
  const Tool a = tool_of(grid), b = tool_of(grid);
  BodyContact on_cpu(a, b);
  const auto query = on_gpu(a, b);
  for (const double far : {0.0, 3.0, 1e3}) {
    for (const double bit : {-1e-7, -1e-16, 0.0, 1e-16, 1e-7}) {
      const Pose X_WA{{far, far, far}, {}}, X_WB{{far, far, far + 0.25 * (1 + bit)}, {}};
      expect_near(query->measure(X_WA, X_WB), on_cpu.measure(X_WA, X_WB));
    }
  }
  const BodyPenetration same = query->measure({}, {});
  EXPECT_EQ(same.num_pairs, 400) << "every sphere on itself, but its neighbors only touch";
  EXPECT_EQ(norm(same.on_a.measure_W.force), 0);
}

TEST(BodyContactCuda, NonFiniteAndFarPoses) {
  PALPATE_GPU_OR_SKIP();
  const Tool a = test::random_tool(20, 0.05, 5);
  BodyContact on_cpu(a, a);
  const auto query = on_gpu(a, a);
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    expect_near(query->measure({{bad, 0, 0}, {}}, {}), on_cpu.measure({{bad, 0, 0}, {}}, {}));
    expect_near(query->measure({}, {{}, {0, 0, bad, 1}}), on_cpu.measure({}, {{}, {0, 0, bad, 1}}));
  }
  for (const double far : {1.0, 1e30, 1e300}) {
    EXPECT_EQ(query->measure({{far, 0, 0}, {}}, {{0, far, 0}, {}}).on_a.volume, 0);
  }
  EXPECT_GT(query->measure({}, {}).on_a.volume, 0);
}

TEST(BodyContactCuda, SameBitsEveryTime) {
  PALPATE_GPU_OR_SKIP();
  const Tool a = test::random_tool(400, 0.05, 5), b = test::random_tool(300, 0.08, 6);
  const Pose X_WA{{0.03, 0.02, 0.05}, axis_angle({1, 2, 3}, 0.7)}, X_WB{{0, 0.01, 0}, {}};
  const auto query = on_gpu(a, b);
  const BodyPenetration want = query->measure(X_WA, X_WB);
  ASSERT_GT(want.num_pairs, 100);
  (void)query->measure({{0.02, 0, 0}, {}}, X_WB);
  expect_same_bits(query->measure(X_WA, X_WB), want);
#if defined(PALPATE_EMULATE_CUDA)
  for (const std::uint32_t order : {1u, 2u, 3u}) {
    emulator::set_order(order);
    expect_same_bits(query->measure(X_WA, X_WB), want);
    emulator::set_order(0);
  }
#else
  const test::AllocationCounter counter;
  (void)query->measure(X_WA, X_WB);
  EXPECT_EQ(counter.count(), 0u);
#endif
}

TEST(BodyContactCuda, MeasuresTheBodiesOfAWorld) {
  PALPATE_GPU_OR_SKIP();
  const Tool tool = test::random_tool(120, 0.05, 1), object = test::random_tool(150, 0.05, 2);
  BodyWorld world(BodyMethod::spheres), want(BodyMethod::spheres);
  for (BodyWorld* w : {&world, &want}) {
    w->add_tool(tool, nullptr);
    w->add_object(object, {{0.03, 0, 0}, {}});
    w->add_tool(tool, nullptr);
    w->set_pose(2, {{0, 0.04, 0.01}, axis_angle({1, 0, 0}, 1)});
  }
  const Status failed = world.measure_pairs_by([](const auto&, const auto&) {
    return Error{Errc::unavailable, "no"};
  });
  EXPECT_FALSE(failed);
  const Status done = world.measure_pairs_by(
      [](const auto& a, const auto& b) { return make_body_contact_cuda(a, b, 0); });
  ASSERT_TRUE(done) << done.error().message;
  world.measure(SurfaceView{});
  want.measure(SurfaceView{});
  for (int body = 0; body < 3; ++body) {
    ASSERT_GT(want.measured(body).num_pairs, 0);
    EXPECT_EQ(world.measured(body).num_pairs, want.measured(body).num_pairs);
    expect_near(world.measured(body).bodies, want.measured(body).bodies);
  }
}

}  // namespace
}  // namespace palpate
