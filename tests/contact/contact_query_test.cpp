// The query against brute force in double, on every instruction set present.
#include "palpate/contact/contact.h"

#include <type_traits>
#include <utility>

#include <gtest/gtest.h>

#include "palpate/contact/body_contact.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/contact_checks.h"

namespace palpate {
namespace {

using test::all_continuities;
using test::all_options;
using test::all_options_with_edges;
using test::all_other_priorities;
using test::ContactQueries;
using test::expect_equals_truth;
using test::l_shape;
using test::Random;
using test::random_pose;
using test::same_bits;

class EveryIsa : public testing::TestWithParam<Isa> {
 protected:
  void SetUp() override {
    if (GetParam() > best_isa()) {
      GTEST_SKIP() << "SKIPPED: this processor has no " << isa_name(GetParam());
    }
  }
};

TEST_P(EveryIsa, EqualsBruteForceOnRandomPoses) {
  Random random(7);
  struct Case {
    int num_spheres;
    double half_side, noise;
    int num_poses;
  };
  // 1,000 poses in all; every method sees every pose.
  for (const Case& c :
       {Case{40, 0.05, 0.0, 600}, Case{300, 0.04, 0.0015, 350}, Case{1500, 0.1, 0.003, 50}}) {
    const Tool tool = test::random_tool(c.num_spheres, c.half_side, 11);
    const PointCloud cloud = test::noisy_wall(160, 120, 140, 0.6, c.noise, 5);
    ContactQueries queries(tool, {GetParam()});
    for (int i = 0; i < c.num_poses; ++i) {
      const Pose X_WT = random_pose(random, 0.6, c.half_side);
      expect_equals_truth(tool, cloud.view(), X_WT, queries);
      if (HasFailure()) FAIL() << "spheres " << c.num_spheres << ", pose " << i;
    }
  }
}

TEST_P(EveryIsa, EqualsBruteForceOnUnorganizedClouds) {
  Random random(3);
  const Tool tool = test::random_tool(200, 0.05, 2);
  PointCloud cloud(5003, 1);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3d p = random.in_box(0.08);
    cloud.set(i, to_float(p + Vec3d{3, -2, -5}), to_float(random.direction()));
  }
  ContactQueries queries(tool, {GetParam()});
  for (int i = 0; i < 20; ++i) {
    const Pose X_WT{Vec3d{3, -2, -5} + random.in_box(0.05), random.rotation(3)};
    expect_equals_truth(tool, cloud.view(), X_WT, queries);
  }
}

TEST_P(EveryIsa, EqualsBruteForceAtEdges) {
  Random random(13);
  for (const auto& [num_spheres, noise, num_poses] :
       {std::tuple{60, 0.0, 300}, std::tuple{400, 0.0015, 120}}) {
    const Tool tool = test::random_tool(num_spheres, 0.05, 11);
    const test::CloudWithEdges scene = l_shape(noise, 5);
    ContactQueries queries(tool, {GetParam()});
    for (int i = 0; i < num_poses; ++i) {
      Pose X_WT = random_pose(random, 0.62, 0.05);
      expect_equals_truth(tool, scene.view(), X_WT, queries, all_options_with_edges());
      if (HasFailure()) FAIL() << "spheres " << num_spheres << ", pose " << i;
    }
  }
}

TEST_P(EveryIsa, EqualsBruteForceWithContinuity) {
  Random random(17);
  const Tool tool = test::random_tool(150, 0.05, 12);
  const test::CloudWithEdges scene = l_shape(0.0015, 6);
  ContactQueries queries(tool, {GetParam()});
  for (int i = 0; i < 60; ++i) {
    const Pose X_WT = random_pose(random, 0.62, 0.05);
    expect_equals_truth(tool, scene.view(), X_WT, queries, all_continuities());
    if (HasFailure()) FAIL() << "pose " << i;
  }
}

TEST_P(EveryIsa, EqualsBruteForceByOtherPriorities) {
  Random random(29);
  for (const auto& [num_spheres, half_side, noise] :
       {std::tuple{60, 0.05, 0.0}, std::tuple{250, 0.08, 0.0015}}) {
    const Tool tool = test::random_tool(num_spheres, half_side, 12);
    const test::CloudWithEdges scene = l_shape(noise, 6);
    ContactQueries queries(tool, {GetParam()});
    for (int i = 0; i < 40; ++i) {
      const Pose X_WT = random_pose(random, 0.62, half_side);
      expect_equals_truth(tool, scene.view(), X_WT, queries, all_other_priorities());
      if (HasFailure()) FAIL() << "spheres " << num_spheres << ", pose " << i;
    }
  }
}

TEST_P(EveryIsa, GivesTheBitsOfTheBaseline) {
  Random random(9);
  const Tool tool = test::random_tool(800, 0.08, 4);
  const PointCloud cloud = test::noisy_wall(320, 240, 280, 0.7, 0.0015, 8);
  ContactQueries wide(tool, {GetParam()});
  ContactQueries narrow(tool, {Isa::baseline});
  for (int i = 0; i < 50; ++i) {
    const Pose X_WT = random_pose(random, 0.7, 0.08);
    for (const ContactOptions& options : all_options()) {
      EXPECT_TRUE(same_bits(wide.measure({cloud.view()}, X_WT, options),
                            narrow.measure({cloud.view()}, X_WT, options)));
    }
  }
  const test::CloudWithEdges scene = l_shape(0.0015, 5);
  for (int i = 0; i < 20; ++i) {
    const Pose X_WT = random_pose(random, 0.62, 0.08);
    for (const auto& all : {all_options_with_edges(), all_continuities(), all_other_priorities()}) {
      for (const ContactOptions& options : all) {
        EXPECT_TRUE(same_bits(wide.measure({scene.view()}, X_WT, options),
                              narrow.measure({scene.view()}, X_WT, options)));
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Isas, EveryIsa, testing::Values(Isa::baseline, Isa::avx2, Isa::avx512),
                         [](const auto& isa) { return isa_name(isa.param); });

TEST(ContactQuery, SameBitsForAnyThreadCountAndOrder) {
  Random random(21);
  const Tool tool = test::random_tool(1200, 0.08, 6);
  const PointCloud cloud = test::noisy_wall(320, 240, 280, 0.7, 0.0015, 8);
  std::vector<Pose> poses;
  for (int i = 0; i < 30; ++i) poses.push_back(random_pose(random, 0.65, 0.08));
  const test::CloudWithEdges scene = l_shape(0.0015, 5);
  std::vector<std::pair<ContactOptions, PointCloudView>> cases;
  for (const ContactOptions& options : all_options()) cases.emplace_back(options, cloud.view());
  for (const auto& all : {all_options_with_edges(), all_continuities()}) {
    for (const ContactOptions& options : all) {
      if (options.volumes == SphereVolumes::own) cases.emplace_back(options, scene.view());
    }
  }
  for (const ContactOptions& options : all_other_priorities()) {
    cases.emplace_back(options, scene.view());
  }
  for (const auto& [options, view] : cases) {
    std::vector<Penetration> expected;
    ContactQueries one(tool);
    for (const Pose& pose : poses) expected.push_back(one.measure({view}, pose, options));
    for (int num_threads : {1, 2, 3, 5}) {
      ThreadPool pool(num_threads);
      ContactQueries queries(tool, {best_isa(), &pool});
      for (std::size_t i = poses.size(); i-- > 0;) {
        EXPECT_TRUE(same_bits(queries.measure({view}, poses[i], options), expected[i]));
      }
    }
  }
}

TEST(ContactQuery, DoesNotAllocate) {
  Random random(1);
  const Tool tool = test::random_tool(500, 0.08, 6);
  const test::CloudWithEdges scene = l_shape(0.0015, 5);
  ThreadPool pool(2);
  for (ThreadPool* threads : {static_cast<ThreadPool*>(nullptr), &pool}) {
    ContactQueries queries(tool, {best_isa(), threads});
    std::vector<SphereState> states(tool.spheres().size());
    std::vector<Plane<float>> planes(states.size());
    std::vector<ContactOptions> all;
    for (const MethodKind method :
         {MethodKind::weighted, MethodKind::simplified, MethodKind::graph}) {
      for (const Edges edges : {Edges::none, Edges::cut}) {
        for (const Continuity continuity : {Continuity::none, Continuity::both}) {
          all.push_back({.method = method,
                         .volumes = SphereVolumes::represented,
                         .edges = edges,
                         .continuity = continuity});
          queries.by(all.back());
        }
      }
    }
    for (const ContactOptions& options : all_other_priorities()) {
      all.push_back(options);
      queries.by(all.back());
    }
    const test::AllocationCounter counter;
    for (int i = 0; i < 100; ++i) {
      const Pose X_WT = random_pose(random, 0.65, 0.08);
      for (const ContactOptions& options : all) {
        const ContactQuery& query = queries.by(options);
        (void)query.measure({scene.view()}, X_WT);
        (void)query.measure({scene.view()}, X_WT, {.states = states, .planes = planes});
      }
    }
    EXPECT_EQ(counter.count(), 0u);
  }
}

TEST(ContactQuery, NothingTouchedGivesZero) {
  const Tool tool = test::random_tool(50, 0.05, 6);
  const PointCloud cloud = test::noisy_wall(64, 48, 60, 0.7, 0, 8);
  ContactQueries queries(tool);
  for (const ContactOptions& options : all_options()) {
    // Without a cloud, in front of the wall, behind the camera.
    EXPECT_EQ(queries.measure({}, {{0, 0, 0.7}, {}}, options).volume, 0);
    for (double z : {0.3, -0.5, 0.0}) {
      const Penetration result = queries.measure({cloud.view()}, {{0, 0, z}, {}}, options);
      EXPECT_EQ(result.volume, 0);
      EXPECT_EQ(result.num_boundary_spheres, 0);
      EXPECT_EQ(norm(result.measure_W.force), 0);
    }
  }
}

TEST(ContactQuery, RepresentedVolumesOfAnImmersedToolAreTheMesh) {
  const Tool tool = test::random_tool(300, 0.05, 6);
  // A wall in front of the tool, and one point that makes contact.
  PointCloud cloud(1, 1);
  std::size_t first = 0;  // the sphere nearest to the camera
  for (std::size_t s = 1; s < tool.spheres().size(); ++s) {
    if (tool.spheres()[s].center.z - tool.spheres()[s].radius <
        tool.spheres()[first].center.z - tool.spheres()[first].radius) {
      first = s;
    }
  }
  const Sphere& sphere = tool.spheres()[first];
  cloud.set(0, sphere.center - Vec3f{0, 0, 0.99999f * sphere.radius}, {0, 0, -1});
  ContactQueries queries(tool);
  for (ContactOptions options : all_options()) {
    const Penetration result = queries.measure({cloud.view()}, {}, options);
    ASSERT_EQ(result.num_boundary_spheres, 1);
    if (result.num_inside_spheres + 1 < static_cast<int>(tool.spheres().size())) {
      EXPECT_EQ(options.method, MethodKind::graph);  // it may not reach all of them
      continue;
    }
    const double full = full_volume(tool, options);
    EXPECT_NEAR(result.volume, full, 2e-6 * full);
  }
  EXPECT_NEAR(full_volume(tool, SphereVolumes::represented), 1e-3, 1e-12);
}

TEST(ContactQuery, SimplifiedTakesTheNearestBySquareAndGaussianToo) {
  Random random(3);
  const Tool tool = test::random_tool(300, 0.05, 6);
  const PointCloud cloud = test::noisy_wall(160, 120, 140, 0.6, 0.0015, 5);
  ContactQueries queries(tool);
  int num_others = 0;
  for (int i = 0; i < 20; ++i) {
    const Pose X_WT = random_pose(random, 0.6, 0.05);
    const auto by = [&](Priority priority) {
      return queries.measure({cloud.view()}, X_WT,
                             {.method = MethodKind::simplified, .priority = priority});
    };
    const Penetration nearest = by(Priority::distance);
    EXPECT_TRUE(same_bits(by(Priority::square), nearest));
    EXPECT_TRUE(same_bits(by(Priority::gaussian), nearest));
    num_others += !same_bits(by(Priority::agreement), nearest);
    num_others += !same_bits(by(Priority::path), nearest);
  }
  EXPECT_GT(num_others, 10);
}

TEST(ContactQuery, PathsOfTooManySpheresAreRefused) {
  const Tool tool = test::block_of_spheres(17);
  const auto refused =
      make_contact_query(Place::cpu(), tool, WeightedMethod{.priority = Priority::path});
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("4913"), std::string::npos) << refused.error().message;
  EXPECT_TRUE(make_contact_query(Place::cpu(), tool, WeightedMethod{}));
}

TEST(ContactQuery, NonFinitePoseIsReportedAndMeasuresNothing) {
  const Tool tool = test::random_tool(50, 0.05, 6);
  const PointCloud cloud = test::noisy_wall(64, 48, 60, 0.7, 0, 8);
  ContactQueries queries(tool);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Penetration result =
      queries.measure({cloud.view()}, {{0, nan, 0.7}, {}}, {MethodKind::simplified});
  EXPECT_EQ(result.status, StepStatus::non_finite_pose);
  EXPECT_EQ(result.volume, 0);
}

// A query that was given nothing, or a surface of the kind that its method does not use, says so:
// a zero force that means "I do not know" would be taken for free space.
TEST(ContactQuery, WithoutASurfaceItSaysSo) {
  const Tool tool = test::random_tool(20, 0.05, 6);
  const PointCloud cloud = test::noisy_wall(64, 48, 60, 0.7, 0, 8);
  DepthField field = DepthField::create(64, 48).value();
  ThreadPool pool(1);
  field.update(cloud.view(), pool);
  const Pose X_WT{{0, 0, 0.7}, {}};
  for (const MethodKind method :
       {MethodKind::weighted, MethodKind::simplified, MethodKind::graph, MethodKind::field}) {
    const bool uses_field = method == MethodKind::field;
    ContactQueries queries(tool);
    const SurfaceView only_cloud{cloud.view()}, only_field{{}, field.view()};
    const SurfaceView& other = uses_field ? only_cloud : only_field;
    EXPECT_EQ(queries.measure({}, X_WT, {method}).status, StepStatus::no_surface);
    EXPECT_EQ(queries.measure(other, X_WT, {method}).status, StepStatus::no_surface);
    EXPECT_TRUE(queries.measure(other, X_WT, {method}).status.is_unmeasured());
    const Penetration measured = queries.measure({cloud.view(), field.view()}, X_WT, {method});
    EXPECT_FALSE(measured.status.has(StepStatus::no_surface));
    EXPECT_GT(measured.volume, 0);
  }
}

TEST(ContactQuery, EdgesWantACloudThatTellsThem) {
  const Tool tool = test::random_tool(20, 0.05, 6);
  const test::CloudWithEdges scene = test::l_shape(0, 3);
  ContactQueries queries(tool);
  const Pose X_WT{{0, 0, 0.6}, {}};
  ContactOptions options{MethodKind::simplified};
  const Penetration without = queries.measure({scene.cloud.view()}, X_WT, options);
  EXPECT_FALSE(without.status.has(StepStatus::no_edge_vectors));
  options.edges = Edges::cut;
  const Penetration missed = queries.measure({scene.cloud.view()}, X_WT, options);
  EXPECT_TRUE(missed.status.has(StepStatus::no_edge_vectors));
  EXPECT_EQ(missed.volume, without.volume);
  EXPECT_FALSE(
      queries.measure({scene.view()}, X_WT, options).status.has(StepStatus::no_edge_vectors));
}

// Images of 4096 x 4096 pixels have twice as many as 2^40 counts each leave room for.
TEST(ContactQuery, SixteenMillionPointsInOneSphere) {
  SpherePacking packing;
  packing.spheres = {{{0, 0, 0}, 0.5f}};
  const Tool tool =
      Tool::build(make_box({1, 1, 1}), std::move(packing), {.gap_rule = GapRule::absolute}).value();
  constexpr int kNum = 1 << 24;
  const std::vector<float> x(kNum, 0.125f), zero(kNum, 0.0f), one(kNum, 1.0f);
  PointCloudView cloud;
  cloud.width = kNum;
  cloud.height = 1;
  cloud.x = x.data();
  cloud.y = cloud.z = cloud.ny = cloud.nz = zero.data();
  cloud.nx = one.data();
  ContactQueries queries(tool);
  const Penetration result = queries.measure({cloud}, {}, {MethodKind::simplified});
  EXPECT_EQ(result.num_points, kNum);
  EXPECT_EQ(result.status, ContactStatus{});
  const double cap = cap_volume(0.5, -0.125);
  EXPECT_NEAR(result.volume, cap, 1e-12);
  EXPECT_NEAR(result.measure_W.force.x, cap, 1e-12);
}

// A tool that does not live as long as what looks at it is refused by the compiler.
template <class T>
concept CanMakeQuery = requires(T&& tool) {
  make_contact_query(Place::cpu(), std::forward<T>(tool));
};
template <class A, class B>
concept CanMakePair = std::is_constructible_v<BodyContact, A, B> && requires(A&& a, B&& b) {
  make_body_pair_query(Place::cpu(), std::forward<A>(a), std::forward<B>(b));
};
template <class T>
concept CanBeABody = requires(BodyWorld& world, T&& tool) {
  world.add_tool(std::forward<T>(tool), nullptr);
  world.add_object(std::forward<T>(tool), Pose{});
};
static_assert(CanMakeQuery<const Tool&> && CanMakeQuery<Tool&>);
static_assert(!CanMakeQuery<Tool> && !CanMakeQuery<const Tool>);
static_assert(CanMakePair<const Tool&, Tool&>);
static_assert(!CanMakePair<Tool, Tool&> && !CanMakePair<Tool&, Tool> && !CanMakePair<Tool, Tool>);
static_assert(CanBeABody<Tool&> && !CanBeABody<Tool>);

TEST(ContactQuery, OpposedNormalsAreAmbiguousAndLendNoPlane) {
  const Tool tool = test::random_tool(1, 0.05, 6);
  const Vec3f c = tool.spheres()[0].center;
  PointCloud cloud(2, 1);
  cloud.set(0, c, {0, 0, 1});
  cloud.set(1, c, {0, 0, -1});
  ContactQueries queries(tool);
  const Penetration result = queries.measure({cloud.view()}, {}, {MethodKind::simplified});
  EXPECT_EQ(result.num_boundary_spheres, 1);
  EXPECT_EQ(result.status, StepStatus::ambiguous_normals);
  EXPECT_EQ(result.volume, 0);
}

TEST(ContactQuery, PointOnTheRimCountsAsInside) {
  SpherePacking packing;
  packing.spheres = {{{0, 0, 0}, 0.25f}};  // |p - c| = r exactly, in binary
  const Tool tool =
      Tool::build(make_box({1, 1, 1}), std::move(packing), {.gap_rule = GapRule::absolute}).value();
  PointCloud cloud(2, 1);
  cloud.set(0, {0.25f, 0, 0}, {1, 0, 0});
  cloud.set(1, {std::nextafter(0.25f, 1.0f), 0, 0}, {1, 0, 0});
  for (Isa isa : {Isa::baseline, Isa::avx2, Isa::avx512}) {
    ContactQueries queries(tool, {isa});
    EXPECT_EQ(queries.measure({cloud.view()}, {}, {MethodKind::simplified}).num_points, 1);
  }
}

TEST(ContactQuery, CudaIsRefusedByNameWhereThereIsNone) {
  if (find_gpus()) GTEST_SKIP() << "SKIPPED: there is a GPU";
  const Tool tool = test::random_tool(5, 0.05, 6);
  const auto query = make_contact_query(Place::cuda(), tool);
  ASSERT_FALSE(query.has_value());
  EXPECT_EQ(query.error().code, Errc::unavailable);
}

}  // namespace
}  // namespace palpate
