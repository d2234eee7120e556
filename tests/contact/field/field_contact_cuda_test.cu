// The field method on the GPU against the CPU's: over poses, fields, and ways to count.

#include <cstring>
#include <vector>

#include <gtest/gtest.h>

#include "src/contact/cuda/gpu_field.h"
#include "src/contact/field/field_contact_cuda.h"
#include "src/core/internal/stamp.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/cuda_queries.h"
#include "tests/test_util/frozen_field.h"
#include "tests/test_util/gpu.h"

#if defined(PALPATE_EMULATE_CUDA)
#include "src/gpu/internal/emulator.h"
#endif

namespace palpate {
namespace {

using test::FrozenField;
using test::Random;

constexpr SphereVolumes kBoth[] = {SphereVolumes::own, SphereVolumes::represented};
constexpr ContactOptions kOwn{.method = MethodKind::field, .volumes = SphereVolumes::own};

ContactOptions by(SphereVolumes volumes) {
  return {.method = MethodKind::field, .volumes = volumes};
}
constexpr int kWidth = 96, kHeight = 72;

PointCloud rough_wall(std::uint64_t seed, double depth = 0.6) {
  return test::noisy_wall(kWidth, kHeight, 84, depth, 0.002, seed);
}

// A block in front of a wall: silhouettes on all sides.
PointCloud block_before_wall(std::uint64_t seed) {
  return test::stepped_wall(kWidth, kHeight, 84, 0.6, 0.12, 0.002, seed,
                            [](int u, int v) { return u > 30 && u < 60 && v > 24 && v < 51; })
      .cloud;
}

// A tilted wall with a large hole.
PointCloud tilted_wall_with_hole() {
  PointCloud cloud(kWidth, kHeight, Intrinsics{84, 84, 47.5, 35.5});
  const Plane<double> wall{normalized(Vec3d{0.4, -0.3, -1}), -0.55};
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      if (std::abs(u - 50) < 12 && std::abs(v - 30) < 9) continue;
      const Vec3d ray{(u - 47.5) / 84, (v - 35.5) / 84, 1};
      const double z = wall.offset / dot(wall.normal, ray);
      cloud.set(static_cast<std::size_t>(v * kWidth + u), to_float(z * ray), to_float(wall.normal));
    }
  }
  return cloud;
}

Pose random_pose(Random& random) {
  const double x = random.uniform(-0.15, 0.15), y = random.uniform(-0.1, 0.1);
  return {{x, y, random.uniform(0.5, 0.75)}, random.rotation(3.0)};
}

bool same_bits(const Penetration& a, const Penetration& b) {
  return a.volume == b.volume && a.potential == b.potential &&
         std::memcmp(&a.measure_W, &b.measure_W, sizeof a.measure_W) == 0 &&
         a.num_boundary_spheres == b.num_boundary_spheres &&
         a.num_inside_spheres == b.num_inside_spheres && a.status == b.status;
}

void expect_near(const Penetration& got, const Penetration& want, const Tool& tool,
                 SphereVolumes volumes, double tolerance = 1e-5) {
  const double scale = full_volume(tool, volumes);
  // Tolerance relative to the volume: forces on a tool from two sides cancel.
  const double part = tolerance * (want.volume + 1e-4 * scale), lever = 0.1;
  EXPECT_EQ(got.status.bits, 0u);
  EXPECT_NEAR(got.volume, want.volume, part);
  EXPECT_NEAR(got.potential, want.potential, tolerance * (want.potential + 1e-4 * scale));
  EXPECT_LE(norm(got.measure_W.force - want.measure_W.force), part);
  EXPECT_LE(norm(got.measure_W.torque - want.measure_W.torque), lever * part);
  EXPECT_EQ(got.num_boundary_spheres, want.num_boundary_spheres);
  EXPECT_EQ(got.num_inside_spheres, want.num_inside_spheres);
}

struct Scene {
  const char* name;
  PointCloud cloud;
  DepthFieldOptions options;
};

std::vector<Scene> scenes() {
  std::vector<Scene> all;
  all.push_back({"rough wall", rough_wall(1), {}});
  all.push_back({"block", block_before_wall(2), {}});
  all.push_back({"tilted, hole", tilted_wall_with_hole(), {.fill_levels = 0}});
  all.push_back({"tilted, filled", tilted_wall_with_hole(), {.unknown = UnknownSpace::solid}});
  all.push_back(
      {"thin block", block_before_wall(3), {.unseen = UnseenSpace::free, .thickness = 0.03}});
  all.push_back(
      {"fading block", block_before_wall(3), {.unseen = UnseenSpace::fade, .thickness = 0.03}});
  all.push_back({"near", rough_wall(4, 0.12), {}});
  return all;
}

// 1 and 33: padding, and spheres so large that they are felt in parts; 3000: several clusters a
// warp.
TEST(FieldContactCuda, EqualsTheCpu) {
  PALPATE_GPU_OR_SKIP();
  for (const int num_spheres : {1, 33, 700, 3000}) {
    const Tool tool = test::random_tool(num_spheres, 0.06, 3);
    test::ContactQueries cpu(tool), gpu = test::cuda_queries(tool);
    Random random(5);
    double most = 0;
    for (const Scene& scene : scenes()) {
      SCOPED_TRACE(scene.name);
      const FrozenField frozen(scene.cloud, scene.options);
      for (int i = 0; i < (num_spheres > 1000 ? 8 : 25) / (test::kIsShort ? 2 : 1); ++i) {
        Pose X_WT = random_pose(random);
        if (scene.name == std::string("near")) X_WT.translation.z -= 0.48;
        for (const SphereVolumes volumes : kBoth) {
          const Penetration want = cpu.measure(frozen.surface(), X_WT, by(volumes));
          expect_near(gpu.measure(frozen.surface(), X_WT, by(volumes)), want, tool, volumes);
          most = std::max(most, want.volume / full_volume(tool, volumes));
        }
      }
    }
    EXPECT_GT(most, 0.5);
  }
}

// A warp with several clusters, and one with a single one, which samples its ball by all lanes.
TEST(FieldContactCuda, ClustersThatLieDeepCountAsOnTheCpu) {
  PALPATE_GPU_OR_SKIP();
  const Tool tool = test::grid_tool();
  test::ContactQueries cpu(tool), gpu = test::cuda_queries(tool);
  const FieldContactCuda alone(ToolIndex::create(tool), FieldMethod{SphereVolumes::represented}, 0,
                               1024);
  Random random(9);
  for (const PointCloud& cloud : {rough_wall(1), block_before_wall(2)}) {
    const FrozenField frozen(cloud);
    for (const double depth : {0.6, 0.615, 0.63, 0.66}) {
      const Pose X_WT{{0.01, -0.01, depth}, random.rotation(3.0)};
      for (const bool stiffness : {false, true}) {
        const ContactOptions options = by(SphereVolumes::represented);
        const ContactResult want =
            cpu.by(options).measure(frozen.surface(), X_WT, {.stiffness = stiffness});
        const ContactResult got =
            gpu.by(options).measure(frozen.surface(), X_WT, {.stiffness = stiffness});
        expect_near(got.penetration, want.penetration, tool, SphereVolumes::represented, 5e-5);
        expect_near(alone.measure(frozen.surface(), X_WT, {.stiffness = stiffness}).penetration,
                    want.penetration, tool, SphereVolumes::represented, 5e-5);
        if (!stiffness) continue;
        double largest = 0;
        for (const auto& row : want.stiffness->m) {
          for (const double k : row) largest = std::max(largest, std::abs(k));
        }
        for (int i = 0; i < 36; ++i) {
          EXPECT_NEAR(got.stiffness->m[i / 6][i % 6], want.stiffness->m[i / 6][i % 6],
                      2e-3 * largest);
        }
      }
    }
  }
}

TEST(FieldContactCuda, OutOfViewBehindTheCameraAndFarAwayAsTheCpu) {
  PALPATE_GPU_OR_SKIP();
  const Tool tool = test::random_tool(1500, 0.06, 6);
  test::ContactQueries cpu(tool), gpu = test::cuda_queries(tool);
  for (const UnknownSpace unknown : {UnknownSpace::free, UnknownSpace::solid}) {
    const FrozenField scene(rough_wall(7), {.unknown = unknown});
    for (const Vec3d& p : {Vec3d{0, 0, -3},
                           {0, 0, 0},
                           {0, 0, 0.03},
                           {0, 0, 0.3},
                           {0, 0, 5},
                           {0.5, 0, 0.6},
                           {0, -0.6, 0.7},
                           {3, 4, 1},
                           {1e6, 0, 1}}) {
      SCOPED_TRACE(testing::Message() << p.x << " " << p.y << " " << p.z);
      const Penetration want = cpu.measure(scene.surface(), {p, {}}, kOwn);
      expect_near(gpu.measure(scene.surface(), {p, {}}, kOwn), want, tool, SphereVolumes::own);
    }
    for (const Vec3d& p : {Vec3d{1e9, 0, 1}, {0, 1e30, 1e30}, {0, 0, 1e300}}) {
      gpu.measure(scene.surface(), {p, {}}, kOwn);  // any numbers, but nothing read out of bounds
    }
  }
}

TEST(FieldContactCuda, NoFieldGivesNothingAndSaysSo) {
  PALPATE_GPU_OR_SKIP();
  const Tool tool = test::random_tool(50, 0.05, 8);
  const FrozenField scene(rough_wall(9));
  test::ContactQueries gpu = test::cuda_queries(tool);
  const Pose X_WT{{0, 0, 0.65}, {}};
  const auto expect_nothing = [&] {
    Penetration nothing;
    nothing.status = StepStatus::no_surface;
    EXPECT_TRUE(same_bits(gpu.measure({}, X_WT, kOwn), nothing));
    const auto whole = test::whole_contact(gpu.by(kOwn), {}, X_WT);
    EXPECT_EQ(whole.stiffness.value_or(Stiffness{}).m[0][0], 0);
    EXPECT_EQ(whole.states[0], SphereState::outside);
  };
  expect_nothing();
  EXPECT_GT(gpu.measure(scene.surface(), X_WT, kOwn).volume, 0);
  expect_nothing();
}

TEST(FieldContactCuda, StiffnessAndDescriptionEqualTheCpu) {
  PALPATE_GPU_OR_SKIP();
  const Tool tool = test::random_tool(300, 0.06, 10);
  test::ContactQueries cpu(tool), gpu = test::cuda_queries(tool);
  Random random(11);
  for (const Scene& scene : scenes()) {
    SCOPED_TRACE(scene.name);
    const FrozenField frozen(scene.cloud, scene.options);
    for (int i = 0; i < 6; ++i) {
      const Pose X_WT = random_pose(random);
      const SphereVolumes volumes = kBoth[i % 2];
      const auto on_cpu = test::whole_contact(cpu.by(by(volumes)), frozen.surface(), X_WT),
                 on_gpu = test::whole_contact(gpu.by(by(volumes)), frozen.surface(), X_WT);
      const Stiffness &want = *on_cpu.stiffness, &got = *on_gpu.stiffness;
      double largest[2][2] = {};  // of the four parts of the matrix
      for (int row = 0; row < 6; ++row) {
        for (int column = 0; column < 6; ++column) {
          double& most = largest[row / 3][column / 3];
          most = std::max(most, std::abs(want.m[row][column]));
        }
      }
      for (int row = 0; row < 6; ++row) {
        for (int column = 0; column < 6; ++column) {
          // Second derivatives jump between pixels: the CPU's single precision puts an element
          // that is just there into the other one.
          EXPECT_NEAR(got.m[row][column], want.m[row][column], 1e-3 * largest[row / 3][column / 3]);
        }
      }
      const VolumeMoments &m = on_cpu.moments, &n = on_gpu.moments;
      EXPECT_NEAR(n.polar, m.polar, 1e-4 * m.polar + 1e-15);
      for (int k = 0; k < 9; ++k) {
        const double scale = full_volume(tool, volumes) * 0.1;
        EXPECT_NEAR(n.first[k / 3][k % 3], m.first[k / 3][k % 3], 1e-4 * scale);
      }
      const auto &planes = on_gpu.planes, &want_planes = on_cpu.planes;
      EXPECT_EQ(on_gpu.states, on_cpu.states);
      // The GPU finds them in double precision.
      for (std::size_t k = 0; k < planes.size(); ++k) {
        // A sphere that is no longer pushed has no direction.
        if (scene.options.unseen == UnseenSpace::fade && on_gpu.states[k] == SphereState::inside) {
          continue;
        }
        EXPECT_NEAR(norm(planes[k].normal - want_planes[k].normal), 0, 4e-4) << k;
        EXPECT_NEAR(planes[k].offset, want_planes[k].offset, 1e-5) << k;
      }
    }
  }
}

TEST(FieldContactCuda, GivesTheSameBitsWhereverTheFieldIsAndWhateverWasAskedBefore) {
  PALPATE_GPU_OR_SKIP();
  const Tool tool = test::random_tool(900, 0.06, 12);
  const FrozenField scene(block_before_wall(13));
  DepthFieldView stamped = scene.field.view(), unstamped = stamped;
  stamped.stamp = next_stamp();
  unstamped.stamp = 0;
  gpu::Stream stream(0, gpu::Priority::low);
  GpuFields fields(0);
  const DepthFieldView on_gpu = fields.on_gpu(stamped, stream);
  ASSERT_TRUE(stream.wait());
  ASSERT_EQ(on_gpu.gpu, 0);
  Random random(14);
  test::ContactQueries one = test::cuda_queries(tool), other = test::cuda_queries(tool);
  for (int i = 0; i < 12; ++i) {
    const Pose X_WT = random_pose(random);
    const SurfaceView on_host{{}, i % 2 == 0 ? stamped : unstamped};
    other.measure(on_host, random_pose(random), kOwn);
    const ContactOptions options = by(SphereVolumes::represented);
    EXPECT_TRUE(
        same_bits(one.measure({{}, on_gpu}, X_WT, options), other.measure(on_host, X_WT, options)));
  }
}

#if defined(PALPATE_EMULATE_CUDA)
TEST(FieldContactCuda, GivesTheSameBitsInAnyOrderOfThreads) {
  const Tool tool = test::random_tool(1500, 0.06, 15);
  const FrozenField scene(rough_wall(16));
  test::ContactQueries gpu = test::cuda_queries(tool);
  const ContactQuery& query = gpu.by(by(SphereVolumes::represented));
  const Pose X_WT{{0.02, 0, 0.6}, axis_angle({1, 2, 3}, 0.7)};
  const auto stiffness_again = [&] {
    return *query.measure(scene.surface(), X_WT, {.stiffness = true}).stiffness;
  };
  const Penetration want = query.measure(scene.surface(), X_WT).penetration;
  const Stiffness stiffness = stiffness_again();
  EXPECT_GT(want.volume, 0);
  for (const std::uint32_t seed : {1u, 2u, 3u}) {
    emulator::set_order(seed);
    EXPECT_TRUE(same_bits(query.measure(scene.surface(), X_WT).penetration, want));
    const Stiffness again = stiffness_again();
    EXPECT_EQ(std::memcmp(&again, &stiffness, sizeof again), 0);
  }
  emulator::set_order(0);
}
#endif

// A field that changes where it lies is copied again when its stamp changes, and not before.
TEST(FieldContactCuda, CopiesAFieldOncePerStamp) {
  PALPATE_GPU_OR_SKIP();
  const Tool tool = test::random_tool(100, 0.05, 17);
  ThreadPool pool(1);
  FrozenField changing(rough_wall(18, 0.6)), fixed(rough_wall(19, 0.62));
  const PointCloud later = rough_wall(20, 0.64);
  test::ContactQueries gpu = test::cuda_queries(tool);
  const Pose X_WT{{0, 0, 0.62}, {}};
  const auto measure = [&](DepthFieldView view, std::uint64_t stamp) {
    view.stamp = stamp;
    return gpu.measure({{}, view}, X_WT, kOwn).volume;
  };
  const std::uint64_t a = next_stamp(), b = next_stamp(), c = next_stamp();
  const double old = measure(changing.field.view(), a);
  EXPECT_NE(measure(fixed.field.view(), b), old);
  changing.field.update(later.view(), pool);
  EXPECT_EQ(measure(changing.field.view(), a), old) << "two fields are kept";
  const double now = measure(changing.field.view(), c);
  EXPECT_LT(now, old);
  // Without stamps nothing is known to be the same.
  EXPECT_EQ(measure(changing.field.view(), 0), now);
  changing.field.update(changing.cloud.view(), pool);
  EXPECT_EQ(measure(changing.field.view(), 0), old);
  // A larger field, then a small one again.
  const FrozenField large(test::noisy_wall(160, 120, 140, 0.6, 0.002, 21));
  EXPECT_GT(measure(large.field.view(), next_stamp()), 0);
  EXPECT_EQ(measure(changing.field.view(), 0), old);
}

TEST(FieldContactCuda, BlendsTwoFieldsAsTwoMeasuresWould) {
  PALPATE_GPU_OR_SKIP();
  const Tool tool = test::random_tool(1500, 0.06, 22);
  const FrozenField from(block_before_wall(23)), to(rough_wall(24, 0.63));
  test::ContactQueries cpu(tool), gpu = test::cuda_queries(tool);
  Random random(25);
  for (int i = 0; i < 10; ++i) {
    const Pose X_WT = random_pose(random);
    for (const double t : {0.0, 0.3, 1.0}) {
      const SphereVolumes volumes = kBoth[i % 2];
      const ContactQuery &on_cpu = cpu.by(by(volumes)), &on_gpu = gpu.by(by(volumes));
      const ContactWants wants{.stiffness = true};
      const Penetration got = on_gpu.measure(from.surface(), to.surface(), t, X_WT).penetration;
      const Stiffness stiffness =
          *on_gpu.measure(from.surface(), to.surface(), t, X_WT, wants).stiffness;
      const ContactResult at_a = on_cpu.measure(from.surface(), X_WT, wants),
                          at_b = on_cpu.measure(to.surface(), X_WT, wants);
      const Stiffness &of_a = *at_a.stiffness, &of_b = *at_b.stiffness;
      const Penetration& a = at_a.penetration;
      Penetration want = at_b.penetration;
      want.volume = (1 - t) * a.volume + t * want.volume;
      want.potential = (1 - t) * a.potential + t * want.potential;
      want.measure_W.force = (1 - t) * a.measure_W.force + t * want.measure_W.force;
      want.measure_W.torque = (1 - t) * a.measure_W.torque + t * want.measure_W.torque;
      expect_near(got, want, tool, volumes);
      const double k = (1 - t) * of_a.m[2][2] + t * of_b.m[2][2];
      EXPECT_NEAR(stiffness.m[2][2], k, 5e-4 * std::abs(k) + 1e-7);
    }
  }
  const Pose X_WT{{0, 0, 0.62}, {}};
  const Penetration whole = gpu.by(kOwn).measure(to.surface(), {}, 0.0, X_WT).penetration;
  EXPECT_NEAR(whole.volume, gpu.measure(to.surface(), X_WT, kOwn).volume, 1e-6 * whole.volume);
  EXPECT_EQ(whole.num_inside_spheres, 0);
}

}  // namespace
}  // namespace palpate
