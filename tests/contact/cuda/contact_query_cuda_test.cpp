// The query on a GPU (or by the emulator): against brute force in double, as the CPU is held to it,
// and against the CPU.
#include "src/contact/backends.h"

#include <algorithm>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#if defined(PALPATE_EMULATE_CUDA)
#include "src/gpu/internal/emulator.h"
#endif
#include "tests/test_util/contact_checks.h"
#include "tests/test_util/cuda_queries.h"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

using test::all_continuities;
using test::all_options;
using test::all_options_with_edges;
using test::kIsEmulated;
using test::kIsShort;
using test::l_shape;
using test::Random;
using test::random_pose;
using test::same_bits;

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
    test::ContactQueries queries = test::cuda_queries(tool);
    for (int i = 0; i < c.num_poses / (kIsShort ? 20 : 1); ++i) {
      const Pose X_WT = random_pose(random, 0.6, c.half_side);
      test::expect_equals_truth(tool, cloud.view(), X_WT, queries);
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
  test::ContactQueries queries = test::cuda_queries(tool);
  for (int i = 0; i < (kIsShort ? 3 : 20); ++i) {
    const Pose X_WT{Vec3d{3, -2, -5} + random.in_box(0.05), random.rotation(3)};
    test::expect_equals_truth(tool, cloud.view(), X_WT, queries);
  }
}

TEST(ContactQueryCuda, EqualsBruteForceAtEdges) {
  PALPATE_GPU_OR_SKIP();
  Random random(13);
  for (const Case& c : {Case{60, 0.05, 0.0, 300}, Case{400, 0.05, 0.0015, 120}}) {
    const Tool tool = test::random_tool(c.num_spheres, c.half_side, 11);
    const test::CloudWithEdges scene = l_shape(c.noise, 5);
    test::ContactQueries queries = test::cuda_queries(tool);
    for (int i = 0; i < c.num_poses / (kIsShort ? 40 : 1); ++i) {
      const Pose X_WT = random_pose(random, 0.62, c.half_side);
      test::expect_equals_truth(tool, scene.view(), X_WT, queries, all_options_with_edges());
      if (HasFailure()) FAIL() << "spheres " << c.num_spheres << ", pose " << i;
    }
  }
}

TEST(ContactQueryCuda, EqualsBruteForceWithContinuity) {
  PALPATE_GPU_OR_SKIP();
  Random random(17);
  const Tool tool = test::random_tool(150, 0.05, 12);
  const test::CloudWithEdges scene = l_shape(0.0015, 6);
  test::ContactQueries queries = test::cuda_queries(tool);
  for (int i = 0; i < (kIsShort ? 2 : 60); ++i) {
    const Pose X_WT = random_pose(random, 0.62, 0.05);
    test::expect_equals_truth(tool, scene.view(), X_WT, queries, all_continuities());
    if (HasFailure()) FAIL() << "pose " << i;
  }
}

TEST(ContactQueryCuda, EqualsBruteForceByOtherPriorities) {
  PALPATE_GPU_OR_SKIP();
  Random random(29);
  const Tool tool = test::random_tool(150, 0.05, 12);
  const test::CloudWithEdges scene = l_shape(0.0015, 6);
  test::ContactQueries queries = test::cuda_queries(tool);
  for (int i = 0; i < (kIsShort ? 3 : 60); ++i) {
    const Pose X_WT = random_pose(random, 0.62, 0.05);
    test::expect_equals_truth(tool, scene.view(), X_WT, queries, test::all_other_priorities());
    if (HasFailure()) FAIL() << "pose " << i;
  }
}

/// A larger scene for comparisons with the CPU alone.
struct Comparison {
  Tool tool = test::random_tool(kIsShort ? 500 : 1200, 0.08, 6);
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

  SurfaceView surface() const { return {scene.view(), field.view()}; }

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
  test::ContactQueries cuda = test::cuda_queries(comparison.tool), cpu(comparison.tool);
  const SurfaceView surface = comparison.surface();
  int num_in_contact = 0;
  comparison.for_each([&](const Pose& X_WT, const ContactOptions& options) {
    SCOPED_TRACE(testing::Message() << "method " << static_cast<int>(options.method)
                                    << ", priority " << static_cast<int>(options.priority)
                                    << ", edges " << static_cast<int>(options.edges)
                                    << ", continuity " << static_cast<int>(options.continuity));
    const Penetration got = cuda.measure(surface, X_WT, options),
                      want = cpu.measure(surface, X_WT, options);
    EXPECT_EQ(got.num_boundary_spheres, want.num_boundary_spheres);
    EXPECT_EQ(got.num_points, want.num_points);
    EXPECT_EQ(got.num_inside_spheres, want.num_inside_spheres);
    EXPECT_EQ(got.status, want.status);
    const double scale = std::max(want.volume, 1e-12), reach = 0.1;
    EXPECT_NEAR(got.volume, want.volume, 1e-5 * scale);
    EXPECT_NEAR(got.potential, want.potential, 1e-5 * scale * reach);
    EXPECT_LE(norm(got.measure_W.force - want.measure_W.force), 1e-5 * scale);
    EXPECT_LE(norm(got.measure_W.torque - want.measure_W.torque), 1e-5 * scale * reach);
    const auto whole = test::whole_contact(cuda.by(options), surface, X_WT),
               whole_want = test::whole_contact(cpu.by(options), surface, X_WT);
    EXPECT_EQ(whole.states, whole_want.states);
    const auto &planes = whole.planes, &want_planes = whole_want.planes;
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
  const SurfaceView from = comparison.surface(), to{comparison.scene.view(), other.view()};
  test::ContactQueries cuda = test::cuda_queries(comparison.tool), cpu(comparison.tool);
  for (const MethodKind method : {MethodKind::field, MethodKind::simplified}) {
    for (const Pose& X_WT : comparison.poses) {
      const ContactQuery &on_gpu = cuda.by({.method = method}),
                         &on_cpu = cpu.by({.method = method});
      const Penetration got = on_gpu.measure(from, to, 0.3, X_WT).penetration;
      const Penetration want = on_cpu.measure(from, to, 0.3, X_WT).penetration;
      EXPECT_NEAR(got.volume, want.volume, 1e-5 * want.volume);
      EXPECT_LE(norm(got.measure_W.force - want.measure_W.force), 1e-5 * want.volume);
      const auto stiffness_by = [&](const ContactQuery& query) {
        return query.measure(from, to, 0.3, X_WT, {.stiffness = true})
            .stiffness.value_or(Stiffness{});
      };
      const Stiffness k = stiffness_by(on_gpu), want_k = stiffness_by(on_cpu);
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
    test::ContactQueries queries = test::cuda_queries(comparison.tool);
    std::size_t i = 0;
    comparison.for_each([&](const Pose& X_WT, const ContactOptions& options) {
      const Penetration got = queries.measure(comparison.surface(), X_WT, options);
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
  test::ContactQueries queries = test::cuda_queries(tool);
  for (const MethodKind method :
       {MethodKind::weighted, MethodKind::simplified, MethodKind::graph, MethodKind::field}) {
    const Penetration nothing = queries.measure({}, {}, {.method = method});
    EXPECT_EQ(nothing.volume, 0);
    EXPECT_EQ(nothing.status, StepStatus::no_surface);
    const Pose nowhere{{NAN, 0, 0}, {}};
    const Penetration undefined = queries.measure({}, nowhere, {.method = method});
    EXPECT_EQ(undefined.volume, 0);
    EXPECT_EQ(undefined.status, StepStatus::non_finite_pose);
    const auto whole = test::whole_contact(queries.by({.method = method}), {}, nowhere);
    for (const SphereState state : whole.states) EXPECT_EQ(state, SphereState::outside);
  }
}

TEST(ContactQueryCuda, SeesThatAHostCloudHasChanged) {
  PALPATE_GPU_OR_SKIP();
  const Tool tool = test::random_tool(100, 0.05, 1);
  test::ContactQueries queries = test::cuda_queries(tool);
  const ContactOptions options{.method = MethodKind::simplified};
  PointCloud cloud = test::noisy_wall(160, 120, 140, 0.6, 0, 5);
  const Pose X_WT{{0, 0, 0.6}, {}};
  EXPECT_GT(queries.measure({cloud.view()}, X_WT, options).num_points, 0);
  std::fill_n(cloud.channel(2), cloud.size(), NAN);
  EXPECT_EQ(queries.measure({cloud.view()}, X_WT, options).num_points, 0);
}

TEST(ContactQueryCuda, SaysThatThereIsNoSuchGpu) {
  if (kIsEmulated) GTEST_SKIP() << "SKIPPED: the emulator has any GPU";
  const Tool tool = test::random_tool(40, 0.05, 1);
  const auto query = make_contact_query_cuda(ToolIndex::create(tool), FieldMethod{}, 99);
  ASSERT_FALSE(query);
  EXPECT_EQ(query.error().code, Errc::unavailable);
}

#if defined(PALPATE_EMULATE_CUDA)
TEST(ContactQueryCuda, ALostGpuMeasuresNothingAndSaysSo) {
  const Tool tool = test::random_tool(100, 0.05, 1);
  const Comparison comparison(1);
  test::ContactQueries queries = test::cuda_queries(comparison.tool);
  const auto measure = [&](const ContactOptions& options) {
    return queries.measure(comparison.surface(), comparison.poses[0], options);
  };
  EXPECT_EQ(measure({}).status.bits, 0u);
  emulator::lose_gpu(true);
  for (const MethodKind method : {MethodKind::field, MethodKind::simplified}) {
    const Penetration lost = measure({.method = method});
    EXPECT_EQ(lost.status, StepStatus::backend_failed);
    EXPECT_EQ(lost.volume, 0);
  }
  emulator::lose_gpu(false);
  EXPECT_NE(measure({}).status.bits, 0u) << "a failure stays";
}
#endif

}  // namespace
}  // namespace palpate
