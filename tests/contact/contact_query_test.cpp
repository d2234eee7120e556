// The query against brute force in double, on every instruction set present.
#include "palpate/contact/contact_query.h"

#include <cstring>
#include <map>

#include <gtest/gtest.h>

#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/contact_truth.h"

namespace palpate {
namespace {

using test::Random;

std::vector<ContactOptions> all_options() {
  std::vector<ContactOptions> all;
  for (SphereVolumes volumes : {SphereVolumes::own, SphereVolumes::represented}) {
    for (InsideMethod method : {InsideMethod::weighted, InsideMethod::simplified}) {
      all.push_back({method, Priority::distance, InsideVolume::full, volumes});
      all.push_back({method, Priority::count, InsideVolume::full, volumes});
    }
    all.push_back({InsideMethod::graph, Priority::distance, InsideVolume::full, volumes});
    all.push_back({InsideMethod::graph, Priority::distance, InsideVolume::cap, volumes});
  }
  return all;
}

std::vector<ContactOptions> all_options_with_edges() {
  std::vector<ContactOptions> all;
  for (Edges edges : {Edges::centre, Edges::strict, Edges::cut}) {
    for (ContactOptions options : all_options()) {
      options.edges = edges;
      all.push_back(options);
    }
  }
  return all;
}

// Every way to smooth, with and without edges.
std::vector<ContactOptions> all_continuities() {
  std::vector<ContactOptions> all;
  for (Continuity continuity : {Continuity::kernel, Continuity::entry, Continuity::both}) {
    for (Edges edges : {Edges::none, Edges::strict, Edges::cut}) {
      for (ContactOptions options : all_options()) {
        options.edges = edges;
        options.continuity = continuity;
        all.push_back(options);
      }
    }
  }
  return all;
}

// A foreground of the shape of an L, so that edges look in all directions and turn both ways.
test::CloudWithEdges l_shape(double noise, std::uint64_t seed) {
  return test::stepped_wall(160, 120, 140, 0.6, 0.12, noise, seed, [](int u, int v) {
    return u > 50 && v > 30 && (u < 80 || v > 65) && u + v < 190;
  });
}

std::unique_ptr<ContactQuery> make_query(const Tool& tool, Isa isa = best_isa(),
                                         ThreadPool* pool = nullptr) {
  return std::move(make_contact_query(Backend::cpu, tool, {isa, pool})).value();
}

// A pose that puts the tool into the wall by a random share of its size.
Pose random_pose(Random& random, double wall_depth, double half_side) {
  const Quaternion q = random.rotation(3.0);
  const double x = random.uniform(-0.1, 0.1), y = random.uniform(-0.1, 0.1);
  const double z = wall_depth + random.uniform(-1.7, 1.7) * half_side;
  return {{x, y, z}, q};
}

void expect_near_relative(double got, double want, double scale, const char* what) {
  EXPECT_NEAR(got, want, 1e-5 * scale) << what;
}

void expect_equals_truth(const test::Truth& truth, const Pose& X_WT, const ContactOptions& options,
                         ContactQuery& query) {
  const Penetration got = query.query(X_WT, options);
  const Penetration& want = truth.penetration;
  EXPECT_EQ(got.num_boundary_spheres, want.num_boundary_spheres);
  EXPECT_EQ(got.num_points, want.num_points);
  EXPECT_EQ(got.num_inside_spheres, want.num_inside_spheres);
  expect_near_relative(got.volume, want.volume, want.volume, "volume");
  const double force = norm(want.measure_W.force), torque = norm(want.measure_W.torque);
  // A torque may cancel out; then its scale is that of its parts.
  const double torque_scale = std::max(torque, want.volume * 1e-2);
  const double force_scale = std::max(force, want.volume * 1e-1);
  for (int axis = 0; axis < 3; ++axis) {
    expect_near_relative(got.measure_W.force[axis], want.measure_W.force[axis], force_scale,
                         "force");
    expect_near_relative(got.measure_W.torque[axis], want.measure_W.torque[axis], torque_scale,
                         "torque");
  }
  const std::span<const SphereState> states = query.states();
  int num_wrong = 0;
  for (std::size_t s = 0; s < states.size(); ++s) num_wrong += states[s] != truth.states[s];
  EXPECT_EQ(num_wrong, 0);
}

void expect_equals_truth(const Tool& tool, const PointCloudView& cloud, const Pose& X_WT,
                         ContactQuery& query,
                         const std::vector<ContactOptions>& all = all_options()) {
  const test::ToolTruth tool_truth(tool);
  std::map<Continuity, test::BoundaryTruth> touched;
  query.set_cloud(cloud);
  for (const ContactOptions& options : all) {
    SCOPED_TRACE(testing::Message() << "method " << static_cast<int>(options.method)
                                    << ", priority " << static_cast<int>(options.priority)
                                    << ", inside " << static_cast<int>(options.inside)
                                    << ", volumes " << static_cast<int>(options.counted())
                                    << ", edges " << static_cast<int>(options.edges)
                                    << ", continuity " << static_cast<int>(options.continuity));
    if (!touched.contains(options.continuity)) {
      touched[options.continuity] =
          test::boundary_truth(tool_truth.spheres, cloud, X_WT, options.continuity);
    }
    expect_equals_truth(test::contact_truth(tool_truth, touched[options.continuity], X_WT, options),
                        X_WT, options, query);
  }
}

bool same_bits(const Penetration& a, const Penetration& b) {
  return std::memcmp(&a.volume, &b.volume, sizeof a.volume) == 0 &&
         std::memcmp(&a.measure_W, &b.measure_W, sizeof a.measure_W) == 0 &&
         a.num_boundary_spheres == b.num_boundary_spheres &&
         a.num_inside_spheres == b.num_inside_spheres && a.num_points == b.num_points;
}

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
    const auto query = make_query(tool, GetParam());
    for (int i = 0; i < c.num_poses; ++i) {
      const Pose X_WT = random_pose(random, 0.6, c.half_side);
      expect_equals_truth(tool, cloud.view(), X_WT, *query);
      if (HasFailure()) FAIL() << "spheres " << c.num_spheres << ", pose " << i;
    }
  }
}

TEST_P(EveryIsa, EqualsBruteForceOnUnorganisedClouds) {
  Random random(3);
  const Tool tool = test::random_tool(200, 0.05, 2);
  PointCloud cloud(5003, 1);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3d p = random.in_box(0.08);
    cloud.set(i, to_float(p + Vec3d{3, -2, -5}), to_float(random.direction()));
  }
  const auto query = make_query(tool, GetParam());
  for (int i = 0; i < 20; ++i) {
    const Pose X_WT{Vec3d{3, -2, -5} + random.in_box(0.05), random.rotation(3)};
    expect_equals_truth(tool, cloud.view(), X_WT, *query);
  }
}

TEST_P(EveryIsa, EqualsBruteForceAtEdges) {
  Random random(13);
  for (const auto& [num_spheres, noise, num_poses] :
       {std::tuple{60, 0.0, 300}, std::tuple{400, 0.0015, 120}}) {
    const Tool tool = test::random_tool(num_spheres, 0.05, 11);
    const test::CloudWithEdges scene = l_shape(noise, 5);
    const auto query = make_query(tool, GetParam());
    for (int i = 0; i < num_poses; ++i) {
      Pose X_WT = random_pose(random, 0.62, 0.05);
      expect_equals_truth(tool, scene.view(), X_WT, *query, all_options_with_edges());
      if (HasFailure()) FAIL() << "spheres " << num_spheres << ", pose " << i;
    }
  }
}

TEST_P(EveryIsa, EqualsBruteForceWithContinuity) {
  Random random(17);
  const Tool tool = test::random_tool(150, 0.05, 12);
  const test::CloudWithEdges scene = l_shape(0.0015, 6);
  const auto query = make_query(tool, GetParam());
  for (int i = 0; i < 60; ++i) {
    const Pose X_WT = random_pose(random, 0.62, 0.05);
    expect_equals_truth(tool, scene.view(), X_WT, *query, all_continuities());
    if (HasFailure()) FAIL() << "pose " << i;
  }
}

TEST_P(EveryIsa, GivesTheBitsOfTheBaseline) {
  Random random(9);
  const Tool tool = test::random_tool(800, 0.08, 4);
  const PointCloud cloud = test::noisy_wall(320, 240, 280, 0.7, 0.0015, 8);
  const auto wide = make_query(tool, GetParam());
  const auto narrow = make_query(tool, Isa::baseline);
  wide->set_cloud(cloud.view());
  narrow->set_cloud(cloud.view());
  for (int i = 0; i < 50; ++i) {
    const Pose X_WT = random_pose(random, 0.7, 0.08);
    for (const ContactOptions& options : all_options()) {
      EXPECT_TRUE(same_bits(wide->query(X_WT, options), narrow->query(X_WT, options)));
    }
  }
  const test::CloudWithEdges scene = l_shape(0.0015, 5);
  wide->set_cloud(scene.view());
  narrow->set_cloud(scene.view());
  for (int i = 0; i < 20; ++i) {
    const Pose X_WT = random_pose(random, 0.62, 0.08);
    for (const auto& all : {all_options_with_edges(), all_continuities()}) {
      for (const ContactOptions& options : all) {
        EXPECT_TRUE(same_bits(wide->query(X_WT, options), narrow->query(X_WT, options)));
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
  for (const auto& [options, view] : cases) {
    std::vector<Penetration> expected;
    const auto one = make_query(tool);
    one->set_cloud(view);
    for (const Pose& pose : poses) expected.push_back(one->query(pose, options));
    for (int num_threads : {1, 2, 3, 5}) {
      ThreadPool pool(num_threads);
      const auto query = make_query(tool, best_isa(), &pool);
      query->set_cloud(view);
      for (std::size_t i = poses.size(); i-- > 0;) {
        EXPECT_TRUE(same_bits(query->query(poses[i], options), expected[i]));
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
    const auto query = make_query(tool, best_isa(), threads);
    const test::AllocationCounter counter;
    for (int i = 0; i < 100; ++i) {
      query->set_cloud(scene.view());
      const Pose X_WT = random_pose(random, 0.65, 0.08);
      for (InsideMethod method :
           {InsideMethod::weighted, InsideMethod::simplified, InsideMethod::graph}) {
        for (Edges edges : {Edges::none, Edges::cut}) {
          for (Continuity continuity : {Continuity::none, Continuity::both}) {
            (void)query->query(X_WT, {method, Priority::distance, InsideVolume::cap,
                                      SphereVolumes::represented, edges, continuity});
          }
        }
        (void)query->states();
        (void)query->planes();
      }
    }
    EXPECT_EQ(counter.count(), 0u);
  }
}

TEST(ContactQuery, NothingTouchedGivesZero) {
  const Tool tool = test::random_tool(50, 0.05, 6);
  const PointCloud cloud = test::noisy_wall(64, 48, 60, 0.7, 0, 8);
  const auto query = make_query(tool);
  for (const ContactOptions& options : all_options()) {
    // Before any cloud, in front of the wall, behind the camera.
    EXPECT_EQ(query->query({{0, 0, 0.7}, {}}, options).volume, 0);
    query->set_cloud(cloud.view());
    for (double z : {0.3, -0.5, 0.0}) {
      const Penetration result = query->query({{0, 0, z}, {}}, options);
      EXPECT_EQ(result.volume, 0);
      EXPECT_EQ(result.num_boundary_spheres, 0);
      EXPECT_EQ(norm(result.measure_W.force), 0);
    }
    query->set_cloud({});
  }
}

TEST(ContactQuery, RepresentedVolumesOfAnImmersedToolAreTheMesh) {
  const Tool tool = test::random_tool(300, 0.05, 6);
  // A wall in front of the tool, and one point that makes contact.
  PointCloud cloud(1, 1);
  std::size_t first = 0;  // the sphere nearest to the camera
  for (std::size_t s = 1; s < tool.spheres().size(); ++s) {
    if (tool.spheres()[s].centre.z - tool.spheres()[s].radius <
        tool.spheres()[first].centre.z - tool.spheres()[first].radius) {
      first = s;
    }
  }
  const Sphere& sphere = tool.spheres()[first];
  cloud.set(0, sphere.centre - Vec3f{0, 0, 0.99999f * sphere.radius}, {0, 0, -1});
  const auto query = make_query(tool);
  query->set_cloud(cloud.view());
  for (ContactOptions options : all_options()) {
    const Penetration result = query->query({}, options);
    ASSERT_EQ(result.num_boundary_spheres, 1);
    if (result.num_inside_spheres + 1 < static_cast<int>(tool.spheres().size())) {
      EXPECT_EQ(options.method, InsideMethod::graph);  // it may not reach all of them
      continue;
    }
    const double full = full_volume(tool, options);
    EXPECT_NEAR(result.volume, full, 2e-6 * full);
  }
  EXPECT_NEAR(full_volume(tool, SphereVolumes::represented), 1e-3, 1e-12);
}

TEST(ContactQuery, NonFinitePoseIsReportedAndMeasuresNothing) {
  const Tool tool = test::random_tool(50, 0.05, 6);
  const PointCloud cloud = test::noisy_wall(64, 48, 60, 0.7, 0, 8);
  const auto query = make_query(tool);
  query->set_cloud(cloud.view());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Penetration result = query->query({{0, nan, 0.7}, {}}, {InsideMethod::simplified});
  EXPECT_EQ(result.status, static_cast<std::uint32_t>(StepStatus::non_finite_pose));
  EXPECT_EQ(result.volume, 0);
}

TEST(ContactQuery, OpposedNormalsAreAmbiguousAndLendNoPlane) {
  const Tool tool = test::random_tool(1, 0.05, 6);
  const Vec3f c = tool.spheres()[0].centre;
  PointCloud cloud(2, 1);
  cloud.set(0, c, {0, 0, 1});
  cloud.set(1, c, {0, 0, -1});
  const auto query = make_query(tool);
  query->set_cloud(cloud.view());
  const Penetration result = query->query({}, {InsideMethod::simplified});
  EXPECT_EQ(result.num_boundary_spheres, 1);
  EXPECT_EQ(result.status, static_cast<std::uint32_t>(StepStatus::ambiguous_normals));
  EXPECT_EQ(result.volume, 0);
}

TEST(ContactQuery, PointOnTheRimCountsAsInside) {
  SpherePacking packing;
  packing.spheres = {{{0, 0, 0}, 0.25f}};  // |p - c| = r exactly, in binary
  const Tool tool =
      Tool::build(make_box({1, 1, 1}), std::move(packing), GapRule::absolute, "").value();
  PointCloud cloud(2, 1);
  cloud.set(0, {0.25f, 0, 0}, {1, 0, 0});
  cloud.set(1, {std::nextafter(0.25f, 1.0f), 0, 0}, {1, 0, 0});
  for (Isa isa : {Isa::baseline, Isa::avx2, Isa::avx512}) {
    const auto query = make_query(tool, isa);
    query->set_cloud(cloud.view());
    EXPECT_EQ(query->query({}, {InsideMethod::simplified}).num_points, 1);
  }
}

TEST(ContactQuery, CudaIsRefusedByName) {
  const Tool tool = test::random_tool(5, 0.05, 6);
  const auto query = make_contact_query(Backend::cuda, tool);
  ASSERT_FALSE(query.has_value());
  EXPECT_EQ(query.error().code, Errc::unavailable);
}

}  // namespace
}  // namespace palpate
