// The query on a GPU (or by the emulator): against brute force in double, as the CPU is held to it,
// and against the CPU.
#include "src/contact/backends.h"

#include <algorithm>
#include <cstdlib>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#if defined(PALPATE_EMULATE_CUDA)
#include "src/gpu/internal/emulator.h"
#endif
#include "eval/studies/method_queries.h"
#include "tests/test_util/contact_checks.h"
#include "tests/test_util/field_probe.h"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

using test::all_continuities;
using test::all_options;
using test::all_options_with_edges;
using test::l_shape;
using test::Random;
using test::random_pose;
using test::same_bits;

#if defined(PALPATE_EMULATE_CUDA)
constexpr bool kIsEmulated = true;
#else
constexpr bool kIsEmulated = false;
#endif
// The emulator and compute-sanitizer are slow: fewer poses are tested there.
const bool kIsShort = kIsEmulated || std::getenv("PALPATE_SHORT_TESTS") != nullptr;

std::unique_ptr<eval::MethodQueries> make_cuda_query(const Tool& tool) {
  return std::make_unique<eval::MethodQueries>(test::cuda_queries(tool));
}

std::unique_ptr<eval::MethodQueries> make_cpu_query(const Tool& tool) {
  return std::make_unique<eval::MethodQueries>(Backend::cpu, tool);
}

struct Case {
  int num_spheres;
  double half_side, noise;
  int num_poses;
};

TEST(ContactQueryCuda, EqualsBruteForceOnRandomPoses) {
  PALPATE_GPU_OR_SKIP();
  Random random(7);
  for (const Case& c :
       {Case{40, 0.05, 0.0, 600}, Case{300, 0.04, 0.0015, 350}, Case{1500, 0.1, 0.003, 50}}) {
    const Tool tool = test::random_tool(c.num_spheres, c.half_side, 11);
    const PointCloud cloud = test::noisy_wall(160, 120, 140, 0.6, c.noise, 5);
    const auto query = make_cuda_query(tool);
    for (int i = 0; i < c.num_poses / (kIsShort ? 20 : 1); ++i) {
      const Pose X_WT = random_pose(random, 0.6, c.half_side);
      test::expect_equals_truth(tool, cloud.view(), X_WT, *query);
      if (HasFailure()) FAIL() << "spheres " << c.num_spheres << ", pose " << i;
    }
  }
}

TEST(ContactQueryCuda, EqualsBruteForceOnUnorganizedClouds) {
  PALPATE_GPU_OR_SKIP();
  Random random(3);
  const Tool tool = test::random_tool(200, 0.05, 2);
  PointCloud cloud(5003, 1);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3d p = random.in_box(0.08);
    cloud.set(i, to_float(p + Vec3d{3, -2, -5}), to_float(random.direction()));
  }
  const auto query = make_cuda_query(tool);
  for (int i = 0; i < (kIsShort ? 3 : 20); ++i) {
    const Pose X_WT{Vec3d{3, -2, -5} + random.in_box(0.05), random.rotation(3)};
    test::expect_equals_truth(tool, cloud.view(), X_WT, *query);
  }
}

TEST(ContactQueryCuda, EqualsBruteForceAtEdges) {
  PALPATE_GPU_OR_SKIP();
  Random random(13);
  for (const Case& c : {Case{60, 0.05, 0.0, 300}, Case{400, 0.05, 0.0015, 120}}) {
    const Tool tool = test::random_tool(c.num_spheres, c.half_side, 11);
    const test::CloudWithEdges scene = l_shape(c.noise, 5);
    const auto query = make_cuda_query(tool);
    for (int i = 0; i < c.num_poses / (kIsShort ? 40 : 1); ++i) {
      const Pose X_WT = random_pose(random, 0.62, c.half_side);
      test::expect_equals_truth(tool, scene.view(), X_WT, *query, all_options_with_edges());
      if (HasFailure()) FAIL() << "spheres " << c.num_spheres << ", pose " << i;
    }
  }
}

TEST(ContactQueryCuda, EqualsBruteForceWithContinuity) {
  PALPATE_GPU_OR_SKIP();
  Random random(17);
  const Tool tool = test::random_tool(150, 0.05, 12);
  const test::CloudWithEdges scene = l_shape(0.0015, 6);
  const auto query = make_cuda_query(tool);
  for (int i = 0; i < (kIsShort ? 2 : 60); ++i) {
    const Pose X_WT = random_pose(random, 0.62, 0.05);
    test::expect_equals_truth(tool, scene.view(), X_WT, *query, all_continuities());
    if (HasFailure()) FAIL() << "pose " << i;
  }
}

TEST(ContactQueryCuda, EqualsBruteForceByOtherPriorities) {
  PALPATE_GPU_OR_SKIP();
  Random random(29);
  const Tool tool = test::random_tool(150, 0.05, 12);
  const test::CloudWithEdges scene = l_shape(0.0015, 6);
  const auto query = make_cuda_query(tool);
  for (int i = 0; i < (kIsShort ? 3 : 60); ++i) {
    const Pose X_WT = random_pose(random, 0.62, 0.05);
    test::expect_equals_truth(tool, scene.view(), X_WT, *query, test::all_other_priorities());
    if (HasFailure()) FAIL() << "pose " << i;
  }
}

/// A larger scene for comparisons with the CPU alone.
struct Comparison {
  Tool tool = test::random_tool(1200, 0.08, 6);
  test::CloudWithEdges scene = l_shape(0.0015, 5);
  DepthField field = std::move(DepthField::create(160, 120)).value();
  std::vector<Pose> poses;
  std::vector<ContactOptions> options{{.method = MethodKind::field},
                                      {.method = MethodKind::field, .volumes = SphereVolumes::own}};

  explicit Comparison(int num_poses) {
    ThreadPool pool(1);
    field.update(scene.view(), pool);
    Random random(4);
    for (int i = 0; i < num_poses; ++i) poses.push_back(random_pose(random, 0.62, 0.08));
    for (const auto& all : {all_options(), all_options_with_edges(), all_continuities(),
                            test::all_other_priorities()}) {
      options.insert(options.end(), all.begin(), all.end());
    }
  }

  void show_to(eval::MethodQueries& query) const {
    query.set_cloud(scene.view());
    query.set_field(field.view());
  }

  /// Calls visit(pose, options) for each option at each pose; by the emulator for some of them.
  template <class Visit>
  void for_each(const Visit& visit) const {
    for (std::size_t p = 0; p < poses.size(); ++p) {
      for (std::size_t o = 0; o < options.size(); ++o) {
        if (kIsShort && o > 1 && (o + p) % poses.size() != 0) continue;
        visit(poses[p], options[o]);
      }
    }
  }
};

TEST(ContactQueryCuda, EqualsTheCpu) {
  PALPATE_GPU_OR_SKIP();
  const Comparison comparison(kIsShort ? 6 : 10);
  const auto cuda = make_cuda_query(comparison.tool), cpu = make_cpu_query(comparison.tool);
  comparison.show_to(*cuda);
  comparison.show_to(*cpu);
  int num_in_contact = 0;
  comparison.for_each([&](const Pose& X_WT, const ContactOptions& options) {
    SCOPED_TRACE(testing::Message() << "method " << static_cast<int>(options.method)
                                    << ", priority " << static_cast<int>(options.priority)
                                    << ", edges " << static_cast<int>(options.edges)
                                    << ", continuity " << static_cast<int>(options.continuity));
    const Penetration got = cuda->query(X_WT, options), want = cpu->query(X_WT, options);
    EXPECT_EQ(got.num_boundary_spheres, want.num_boundary_spheres);
    EXPECT_EQ(got.num_points, want.num_points);
    EXPECT_EQ(got.num_inside_spheres, want.num_inside_spheres);
    EXPECT_EQ(got.status, want.status);
    const double scale = std::max(want.volume, 1e-12), reach = 0.1;
    EXPECT_NEAR(got.volume, want.volume, 1e-5 * scale);
    EXPECT_NEAR(got.potential, want.potential, 1e-5 * scale * reach);
    EXPECT_LE(norm(got.measure_W.force - want.measure_W.force), 1e-5 * scale);
    EXPECT_LE(norm(got.measure_W.torque - want.measure_W.torque), 1e-5 * scale * reach);
    const auto states = cuda->states(), want_states = cpu->states();
    EXPECT_TRUE(std::equal(states.begin(), states.end(), want_states.begin()));
    const auto planes = cuda->planes(), want_planes = cpu->planes();
    // The GPU computes planes of the field in double precision.
    const bool is_field = options.method == MethodKind::field;
    const float tolerance = is_field ? 4e-4f : 1e-5f, far = is_field ? 4e-5f : 1e-5f;
    int num_wrong = 0;
    for (std::size_t i = 0; i < planes.size(); ++i) {
      num_wrong += norm(planes[i].normal - want_planes[i].normal) > tolerance ||
                   std::abs(planes[i].offset - want_planes[i].offset) > far;
    }
    EXPECT_EQ(num_wrong, 0);
    num_in_contact += want.volume > 0;
  });
  EXPECT_GT(num_in_contact, 20);
}

TEST(ContactQueryCuda, EqualsTheCpuBetweenTwoFrames) {
  PALPATE_GPU_OR_SKIP();
  const Comparison comparison(4);
  DepthField other = std::move(DepthField::create(160, 120)).value();
  ThreadPool pool(1);
  other.update(l_shape(0.0015, 6).view(), pool);
  SurfaceBlend moment;
  moment.from = {comparison.scene.view(), comparison.field.view()};
  moment.to = {comparison.scene.view(), other.view()};
  moment.progress = 0.3;
  eval::MethodQueries cuda = std::move(*make_cuda_query(comparison.tool)),
                      cpu = std::move(*make_cpu_query(comparison.tool));
  cuda.set_blend(moment);
  cpu.set_blend(moment);
  for (const MethodKind method : {MethodKind::field, MethodKind::simplified}) {
    for (const Pose& X_WT : comparison.poses) {
      const Penetration got = cuda.query(X_WT, {.method = method});
      const Penetration want = cpu.query(X_WT, {.method = method});
      EXPECT_NEAR(got.volume, want.volume, 1e-5 * want.volume);
      EXPECT_LE(norm(got.measure_W.force - want.measure_W.force), 1e-5 * want.volume);
      const Stiffness k = cuda.stiffness(), want_k = cpu.stiffness();
      double largest = 0, error = 0;
      for (int row = 0; row < 6; ++row) {
        for (int column = 0; column < 6; ++column) {
          largest = std::max(largest, std::abs(want_k.m[row][column]));
          error = std::max(error, std::abs(k.m[row][column] - want_k.m[row][column]));
        }
      }
      EXPECT_LE(error, 5e-3 * largest);  // second derivatives jump between pixels and at corners
    }
  }
}

TEST(ContactQueryCuda, SameBitsOnEveryRun) {
  PALPATE_GPU_OR_SKIP();
  const Comparison comparison(kIsShort ? 3 : 20);
  std::vector<Penetration> first;
  for (const std::uint32_t order : {0u, 1u, 2u}) {
#if defined(PALPATE_EMULATE_CUDA)
    emulator::set_order(order);
#endif
    const auto query = make_cuda_query(comparison.tool);
    comparison.show_to(*query);
    std::size_t i = 0;
    comparison.for_each([&](const Pose& X_WT, const ContactOptions& options) {
      const Penetration got = query->query(X_WT, options);
      if (order == 0) {
        first.push_back(got);
      } else {
        EXPECT_TRUE(same_bits(got, first[i]));
      }
      ++i;
    });
  }
#if defined(PALPATE_EMULATE_CUDA)
  emulator::set_order(0);
#endif
}

TEST(ContactQueryCuda, MeasuresNothingWithoutCloudOrFinitePose) {
  PALPATE_GPU_OR_SKIP();
  const Tool tool = test::random_tool(40, 0.05, 1);
  const auto query = make_cuda_query(tool);
  for (const MethodKind method :
       {MethodKind::weighted, MethodKind::simplified, MethodKind::graph, MethodKind::field}) {
    const Penetration nothing = query->query({}, {.method = method});
    EXPECT_EQ(nothing.volume, 0);
    EXPECT_EQ(nothing.status, StepStatus::no_surface);
    const Penetration undefined = query->query({{NAN, 0, 0}, {}}, {.method = method});
    EXPECT_EQ(undefined.volume, 0);
    EXPECT_EQ(undefined.status, StepStatus::non_finite_pose);
    for (const SphereState state : query->states()) EXPECT_EQ(state, SphereState::outside);
  }
}

TEST(ContactQueryCuda, SeesThatAHostCloudHasChanged) {
  PALPATE_GPU_OR_SKIP();
  const Tool tool = test::random_tool(100, 0.05, 1);
  const auto query = make_cuda_query(tool);
  const ContactOptions options{.method = MethodKind::simplified};
  PointCloud cloud = test::noisy_wall(160, 120, 140, 0.6, 0, 5);
  query->set_cloud(cloud.view());
  const Pose X_WT{{0, 0, 0.6}, {}};
  EXPECT_GT(query->query(X_WT, options).num_points, 0);
  std::fill_n(cloud.channel(2), cloud.size(), NAN);
  query->set_cloud(cloud.view());
  EXPECT_EQ(query->query(X_WT, options).num_points, 0);
}

TEST(ContactQueryCuda, SaysThatThereIsNoSuchGpu) {
  if (kIsEmulated) GTEST_SKIP() << "SKIPPED: the emulator has any GPU";
  const Tool tool = test::random_tool(40, 0.05, 1);
  const auto query = make_contact_query_cuda(ToolIndex::create(tool), FieldMethod{}, {.gpu = 99});
  ASSERT_FALSE(query);
  EXPECT_EQ(query.error().code, Errc::unavailable);
}

#if defined(PALPATE_EMULATE_CUDA)
TEST(ContactQueryCuda, ALostGpuMeasuresNothingAndSaysSo) {
  const Tool tool = test::random_tool(100, 0.05, 1);
  const Comparison comparison(1);
  const auto query = make_cuda_query(comparison.tool);
  comparison.show_to(*query);
  EXPECT_EQ(query->query(comparison.poses[0], {}).status.bits, 0u);
  emulator::lose_gpu(true);
  for (const MethodKind method : {MethodKind::field, MethodKind::simplified}) {
    const Penetration lost = query->query(comparison.poses[0], {.method = method});
    EXPECT_EQ(lost.status, StepStatus::backend_failed);
    EXPECT_EQ(lost.volume, 0);
  }
  emulator::lose_gpu(false);
  EXPECT_NE(query->query(comparison.poses[0], {}).status.bits, 0u) << "a failure stays";
}
#endif

}  // namespace
}  // namespace palpate
