#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <utility>

#include <gtest/gtest.h>

#include "palpate/contact/body_contact.h"
#include "src/cloud/internal/frame_noise.h"
#include "src/contact/backends.h"
#include "src/contact/batch/field_batch.h"
#include "src/contact/batch/field_batch_cuda.h"
#include "src/core/internal/stamp.h"
#include "src/field/internal/pinhole_cloud.h"
#include "src/field/timeline/batch_frames.h"
#include "src/field/timeline/frame_slots.h"
#include "tests/backends/backend_features.h"
#include "tests/cloud/depth_scenes.h"
#include "tests/field/device_views.h"
#include "tests/field/rough_images.h"
#include "tests/test_util/contact_checks.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/cuda_queries.h"
#include "tests/test_util/gpu.h"

namespace palpate::test {
namespace {

constexpr double kHalfSide = 0.06, kWallDepth = 0.6;
constexpr double kReach = 2 * kHalfSide;  // lever arms, and the scale of potentials
/// Tolerance of a measure whose single-precision terms are summed in another order.
constexpr double kMeasure = 1e-5;
/// The stiffness of the CPU is computed in single precision.
constexpr double kStiffness = 1e-4;
/// Deviations by the noise of the depth, which a GPU adds up in integers.
constexpr double kDeviations = 1e-4;
/// Sums in double precision.
constexpr double kExact = 1e-10;

Tool test_tool() { return random_tool(150, kHalfSide, 6); }

/// A bumpy wall with a step all around.
CloudWithEdges wall(std::uint64_t seed) {
  return stepped_wall(80, 60, 70, kWallDepth, 0.12, 0.0015, seed, [](int u, int v) {
    return u > 20 && v > 12 && (u < 42 || v > 30) && u + v < 100;
  });
}

DepthField field_of(const PointCloudView& cloud) {
  DepthField field = std::move(DepthField::create(cloud.width, cloud.height)).value();
  ThreadPool pool(1);
  field.update(cloud, pool);
  return field;
}

std::vector<Pose> poses(int num) {
  Random random(8);
  std::vector<Pose> all;
  for (int i = 0; i < num; ++i) {
    const Quaternion q = random.rotation(3);
    const double x = random.uniform(-0.06, 0.06), y = random.uniform(-0.06, 0.06);
    all.push_back({{x, y, kWallDepth + random.uniform(-0.7, 0.7) * kHalfSide}, q});
  }
  return all;
}

void expect_near(const Penetration& got, const Penetration& want, double allowed) {
  EXPECT_EQ(got.num_boundary_spheres, want.num_boundary_spheres);
  EXPECT_EQ(got.num_inside_spheres, want.num_inside_spheres);
  EXPECT_EQ(got.num_points, want.num_points);
  EXPECT_EQ(got.status, want.status);
  const double scale = allowed * want.volume;
  EXPECT_NEAR(got.volume, want.volume, scale);
  EXPECT_NEAR(got.potential, want.potential, scale * kReach);
  EXPECT_LE(norm(got.measure_W.force - want.measure_W.force), scale);
  EXPECT_LE(norm(got.measure_W.torque - want.measure_W.torque), scale * kReach);
}

void expect_near(const Stiffness& got, const Stiffness& want, double allowed) {
  double largest = 0, error = 0;
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column) {
      // Turns by lengths, so that all entries are of one kind.
      const double unit = std::pow(kReach, row / 3 + column / 3);
      largest = std::max(largest, std::abs(want.m[row][column]) / unit);
      error = std::max(error, std::abs(got.m[row][column] - want.m[row][column]) / unit);
    }
  }
  EXPECT_GT(largest, 0);
  EXPECT_LE(error, allowed * largest);
}

/// One tool at a surface, a wall unless another is set, by both.
struct Pair {
  Tool tool = test_tool();
  CloudWithEdges scene = wall(5);
  DepthField field = field_of(scene.view());
  ContactQueries cpu{tool}, cuda = cuda_queries(tool);
  SurfaceView surface{scene.view(), field.view()};

  /// Compares a few poses; visit(whole contact on the GPU, on the CPU) compares the rest.
  template <class Visit>
  void compare(const std::vector<ContactOptions>& all, double allowed, const Visit& visit) {
    double volume = 0;
    for (const ContactOptions& options : all) {
      for (const Pose& X_WT : poses(3)) {
        const Penetration want = cpu.measure(surface, X_WT, options);
        expect_near(cuda.measure(surface, X_WT, options), want, allowed);
        volume += want.volume;
        visit(whole_contact(cuda.by(options), surface, X_WT),
              whole_contact(cpu.by(options), surface, X_WT));
      }
    }
    EXPECT_GT(volume, 0);
  }
  void compare(const std::vector<ContactOptions>& all, double allowed) {
    compare(all, allowed, [](const WholeContact&, const WholeContact&) {});
  }
};

Feature by(std::string name, std::vector<ContactOptions> options) {
  return {std::move(name), kMeasure,
          [options = std::move(options)](double allowed) { Pair().compare(options, allowed); }};
}

const std::vector<MethodKind> kPointMethods{MethodKind::weighted, MethodKind::simplified,
                                            MethodKind::graph};
const std::vector<MethodKind> kAllMethods{MethodKind::field, MethodKind::weighted,
                                          MethodKind::simplified, MethodKind::graph};

std::vector<ContactOptions> by_each(const std::vector<MethodKind>& methods,
                                    ContactOptions options = {}) {
  std::vector<ContactOptions> all;
  for (const MethodKind method : methods) {
    all.push_back(options);
    if (method == MethodKind::field) all.back() = {.volumes = options.volumes};
    all.back().method = method;
  }
  return all;
}

FeatureGroup methods() {
  using enum MethodKind;
  return {
      "Methods",
      {
          by("`field`", {{.method = field}}),
          by("`weighted`, priority distance", {{.method = weighted}}),
          by("`weighted`, priority count", {{.method = weighted, .priority = Priority::count}}),
          by("`weighted`, priority square", {{.method = weighted, .priority = Priority::square}}),
          by("`weighted`, priority gaussian",
             {{.method = weighted, .priority = Priority::gaussian}}),
          by("`weighted`, priority agreement",
             {{.method = weighted, .priority = Priority::agreement}}),
          by("`weighted`, priority path", {{.method = weighted, .priority = Priority::path}}),
          by("`simplified`, priority distance", {{.method = simplified}}),
          by("`simplified`, priority count", {{.method = simplified, .priority = Priority::count}}),
          by("`simplified`, priority agreement",
             {{.method = simplified, .priority = Priority::agreement}}),
          by("`simplified`, priority path", {{.method = simplified, .priority = Priority::path}}),
          by("`graph`, whole spheres inside", {{.method = graph}}),
          by("`graph`, capped spheres inside", {{.method = graph, .inside = InsideVolume::cap}}),
      }};
}

FeatureGroup options() {
  FeatureGroup group{"Options of a query", {}};
  for (const auto& [name, volumes] : {std::pair{"own", SphereVolumes::own},
                                      std::pair{"represented", SphereVolumes::represented}}) {
    group.features.push_back(by(std::string("volumes: ") + name + ", each method",
                                by_each(kAllMethods, {.volumes = volumes})));
  }
  for (const auto& [name, edges] :
       {std::pair{"center", Edges::center}, std::pair{"strict", Edges::strict},
        std::pair{"cut", Edges::cut}}) {
    group.features.push_back(by(std::string("edges: ") + name + ", each point method",
                                by_each(kPointMethods, {.edges = edges})));
  }
  for (const auto& [name, continuity] :
       {std::pair{"kernel", Continuity::kernel}, std::pair{"entry", Continuity::entry},
        std::pair{"both", Continuity::both}}) {
    group.features.push_back(by(std::string("continuity: ") + name + ", each point method",
                                by_each(kPointMethods, {.continuity = continuity})));
  }
  group.features.push_back(
      by("edges and continuity together",
         by_each(kPointMethods, {.edges = Edges::cut, .continuity = Continuity::both})));
  return group;
}

void compare_states(double) {
  Pair pair;
  pair.compare(by_each(kAllMethods), kMeasure,
               [](const WholeContact& got, const WholeContact& want) {
                 EXPECT_EQ(got.states, want.states);
               });
}

void compare_planes(double allowed) {
  Pair pair;
  pair.compare(by_each(kAllMethods), kMeasure,
               [&](const WholeContact& got, const WholeContact& want) {
                 for (std::size_t i = 0; i < want.planes.size(); ++i) {
                   const Plane<float>&a = got.planes[i], &b = want.planes[i];
                   EXPECT_LE(static_cast<double>(norm(a.normal - b.normal)), allowed);
                   EXPECT_NEAR(a.offset, b.offset, allowed * kWallDepth);
                 }
               });
}

void compare_stiffness(double allowed) {
  Pair pair;
  pair.compare({{.method = MethodKind::field}}, kMeasure,
               [&](const WholeContact& got, const WholeContact& want) {
                 expect_near(*got.stiffness, *want.stiffness, allowed);
               });
}

void compare_deviations(double allowed) {
  Pair pair;
  const FrameNoise noise = frame_noise({.at_zero = 0.001});
  pair.surface.field.noise = &noise;
  for (const Pose& X_WT : poses(3)) {
    const auto said_by = [&](ContactQueries& queries) {
      const ContactQuery& query = queries.by({.method = MethodKind::field});
      return query.measure(pair.surface, X_WT, {.noise = true}).noise.value();
    };
    const MeasureNoise got = said_by(pair.cuda), want = said_by(pair.cpu);
    EXPECT_GT(want.volume, 0);
    EXPECT_NEAR(got.volume_std(), want.volume_std(), allowed * want.volume_std());
    EXPECT_LE(norm(got.force_std() - want.force_std()), allowed * norm(want.force_std()));
    EXPECT_LE(norm(got.torque_std() - want.torque_std()), allowed * norm(want.torque_std()));
  }
}

// Images that are smoothed adaptively each have a noise of their own.
void compare_image_deviations(double allowed) {
  constexpr int kNum = 3, kPerImage = 8;
  const RoughImages images(96, 64, kNum, 1);
  SlotSettings settings;
  settings.stream.width = images.camera.width;
  settings.stream.height = images.camera.height;
  settings.stream.intrinsics = images.camera.intrinsics;
  settings.field = DepthFieldOptions{};
  settings.time.mode = TimeMode::latest;
  const auto on_gpu = make_batch_frames_cuda(settings, 0).value();
  const auto on_cpu = make_batch_frames_cpu(settings).value();
  const Tool tool = test_tool();
  const auto index = ToolIndex::create(tool);
  Random random(2);
  std::vector<Pose> X_WT;
  std::vector<std::int32_t> image_of_pose;
  for (int i = 0; i < kNum * kPerImage; ++i) {
    const double z = images.meters[images.size() * static_cast<std::size_t>(i % kNum) + 40];
    X_WT.push_back({{random.uniform(-0.1, 0.1), random.uniform(-0.1, 0.1), z}, random.rotation(3)});
    image_of_pose.push_back(i % kNum);
  }
  const auto answered_by = [&](const BatchQuery& query, BatchFrames& frames) {
    ThreadPool pool(1);
    std::vector<double> said(X_WT.size());
    const SurfaceBatch fields = frames.update(images.image(0), kNum, {}, pool).value();
    EXPECT_TRUE(query.measure(fields, {X_WT, image_of_pose}, {.volume_std = said.data()}));
    return said;
  };
  const std::vector<double> got = answered_by(FieldBatchCuda(index, {}, 0), *on_gpu),
                            want = answered_by(FieldBatch(index, {}, {}), *on_cpu);
  for (std::size_t i = 0; i < want.size(); ++i) EXPECT_NEAR(got[i], want[i], allowed * want[i]);
  EXPECT_GT(std::ranges::count_if(want, [](double std) { return std > 0; }), 6);
}

void compare_faults(double allowed) {
  Pair pair;
  const Pose nowhere{{NAN, 0, 0}, {}};
  for (const ContactOptions& options : by_each(kAllMethods)) {
    const Penetration got = pair.cuda.measure(pair.surface, nowhere, options);
    EXPECT_EQ(got.status, StepStatus::non_finite_pose);
    expect_near(got, pair.cpu.measure(pair.surface, nowhere, options), allowed);
  }
  PointCloud rough = pair.scene.cloud;  // half of the normals look the other way
  for (std::size_t i = 0; i < rough.size(); i += 2) rough.set(i, rough.point(i), -rough.normal(i));
  pair.surface = {rough.view(), {}};
  const Pose X_WT = poses(1)[0];
  for (const ContactOptions& options : by_each(kPointMethods)) {
    const Penetration want = pair.cpu.measure(pair.surface, X_WT, options);
    EXPECT_EQ(want.status, StepStatus::ambiguous_normals);
    expect_near(pair.cuda.measure(pair.surface, X_WT, options), want, allowed);
  }
}

FeatureGroup results() {
  return {"Results beside the wrench",
          {
              {"stiffness of `field`", kStiffness, compare_stiffness},
              {"standard deviations of `field`", kDeviations, compare_deviations},
              {"the same of images of a batch", kDeviations, compare_image_deviations},
              {"states of spheres", 0, compare_states},
              {"planes of spheres", kMeasure, compare_planes},
              {"status: bad poses, ambiguous normals", kMeasure, compare_faults},
          }};
}

PointCloud scattered_points() {
  Random random(3);
  PointCloud cloud(1501, 1);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    cloud.set(i, to_float(random.in_box(0.08) + Vec3d{0, 0, kWallDepth}),
              to_float(Vec3d{0, 0, -1} + 0.5 * random.direction()));
  }
  return cloud;
}

void compare_unorganized(double allowed) {
  Pair pair;
  const PointCloud cloud = scattered_points();
  pair.surface = {cloud.view(), {}};
  pair.compare(by_each(kPointMethods), allowed);
}

void compare_unorganized_by_field(double allowed) {
  Pair pair;
  const PointCloud image = std::move(make_pinhole_cloud(scattered_points().view())).value();
  const DepthField field = field_of(image.view());
  pair.surface = {image.view(), field.view()};
  pair.compare(by_each({MethodKind::field}), allowed);
}

void compare_host_memory(double allowed) {
  Pair pair;
  const CloudWithEdges scene = wall(9);
  PointCloudView cloud = scene.view();
  cloud.stamp = next_stamp();
  const DepthField field = field_of(cloud);
  pair.surface = {cloud, field.view()};
  ASSERT_EQ(cloud.gpu, kHostMemory);
  pair.compare(by_each(kAllMethods), allowed);
}

SlotSettings stream_settings() {
  SlotSettings settings;
  settings.stream = {80, 60, empty_scene(80, 60, 90).intrinsics, 0.0005, 30, std::nullopt, ""};
  settings.wants_depth_change = true;
  return settings;
}

/// Frames of a wall that comes nearer; both ways from image to wrench have nothing in common.
void compare_from_depth_image(double allowed) {
  const Tool tool = test_tool();
  const SlotSettings settings = stream_settings();
  auto on_cpu =
      FrameSlots::make_timeline(std::move(make_frame_slots_cpu(settings)).value(), settings)
          .value();
  auto on_cuda =
      FrameSlots::make_timeline(std::move(make_frame_slots_cuda(settings, 0)).value(), settings)
          .value();
  ContactQueries cpu(tool), cuda = cuda_queries(tool);
  ThreadPool pool(1);
  for (int number = 0; number < 2; ++number) {
    const DepthFrame frame =
        as_frame(cluttered_scene(80, 60, 90, kWallDepth - 0.005 * number, 7), 0.0005);
    on_cpu.push(frame, number / 30.0, pool);
    on_cuda.push(frame, number / 30.0, pool);
  }
  const double now = 1.3 / 30;
  ASSERT_EQ(on_cuda.at(now).to.cloud.gpu, 0);
  const SurfaceBlend blend = on_cpu.at(now), cuda_blend = on_cuda.at(now);
  double volume = 0;
  for (const ContactOptions& options : by_each(kAllMethods)) {
    for (const Pose& X_WT : poses(2)) {
      const ContactQuery &on_host = cpu.by(options), &on_gpu = cuda.by(options);
      const Penetration want = on_host.measure({&blend, 1}, X_WT).penetration;
      expect_near(on_gpu.measure({&cuda_blend, 1}, X_WT).penetration, want, allowed);
      volume += want.volume;
      if (options.method == MethodKind::field && want.volume > 0) {
        const ContactWants wants{.stiffness = true};
        expect_near(*on_gpu.measure({&cuda_blend, 1}, X_WT, wants).stiffness,
                    *on_host.measure({&blend, 1}, X_WT, wants).stiffness, kStiffness);
      }
    }
  }
  EXPECT_GT(volume, 0);
}

FeatureGroup surroundings() {
  return {"Inputs",
          {
              {"from depth image to wrench, between two frames", kMeasure, compare_from_depth_image,
               "yes: two queries", "yes: `field` in one launch"},
              {"clouds and fields in host memory", kMeasure, compare_host_memory, "yes",
               "yes: copied once per frame"},
              {"unorganized clouds, each point method", kMeasure, compare_unorganized},
              {"unorganized clouds by `field`", kMeasure, compare_unorganized_by_field, "yes",
               "yes: their image is made on the host"},
          }};
}

void compare_bodies(BodyMethod method, double allowed) {
  const Tool left = test_tool(), right = random_tool(90, 0.04, 2), block = random_tool(60, 0.05, 3);
  BodyWorld cpu(method), cuda(method);
  for (BodyWorld* world : {&cpu, &cuda}) {
    world->add_tool(left, nullptr);
    world->add_tool(right, nullptr);
    world->add_object(block, {{0.03, 0.02, 0.7}, axis_angle({1, 0, 0}, 0.4)});
  }
  const Status status = cuda.measure_pairs_by([&](const auto& a, const auto& b) {
    return method == BodyMethod::field ? make_solid_contact_cuda(a, b, 0)
                                       : make_body_contact_cuda(a, b, 0);
  });
  ASSERT_TRUE(status) << status.error().message;
  Random random(4);
  for (int i = 0; i < 5; ++i) {
    const Pose X_WL{{0, 0, 0.65}, random.rotation(3)}, X_WR{{0.05, 0, 0.65}, random.rotation(3)};
    for (BodyWorld* world : {&cpu, &cuda}) {
      world->set_pose(0, X_WL);
      world->set_pose(1, X_WR);
      world->measure(SurfaceView{});
    }
    for (const int body : {0, 1, 2}) {
      EXPECT_GT(cpu.measured(body).num_pairs, 0);
      EXPECT_EQ(cuda.measured(body).num_pairs, cpu.measured(body).num_pairs);
      expect_near(cuda.measured(body).total(), cpu.measured(body).total(), allowed);
    }
  }
}

void compare_bodies_by_field(double allowed) { compare_bodies(BodyMethod::field, allowed); }
void compare_bodies_by_spheres(double allowed) { compare_bodies(BodyMethod::spheres, allowed); }

FeatureGroup bodies() {
  return {"Several bodies",
          {{"tools and objects against each other, by field", kMeasure, compare_bodies_by_field,
            "yes", "yes: all pairs at the same time"},
           {"the same by spheres", kExact, compare_bodies_by_spheres, "yes",
            "yes: all pairs at the same time"}}};
}

/// Whatever was queried before, with any number of threads and in any order of them.
void expect_same_bits_again(double) {
  Pair pair;
  ThreadPool pool(3);
  ContactQueries threaded(pair.tool, {.pool = &pool});
  const Pose X_WT = poses(1)[0], elsewhere = poses(2)[1];
  for (const ContactOptions& options : by_each(kAllMethods, {.edges = Edges::cut})) {
    const Penetration on_cpu = pair.cpu.measure(pair.surface, X_WT, options);
    EXPECT_TRUE(same_bits(threaded.measure(pair.surface, X_WT, options), on_cpu));
    const Penetration on_cuda = pair.cuda.measure(pair.surface, X_WT, options);
    in_all_orders([&] {
      pair.cuda.measure(pair.surface, elsewhere, {.method = MethodKind::graph});
      EXPECT_TRUE(same_bits(pair.cuda.measure(pair.surface, X_WT, options), on_cuda));
    });
  }
}

FeatureGroup repetition() {
  return {"Repetition",
          {{"each backend's own bits, on every run", 0, expect_same_bits_again,
            "yes: for any number of threads", "yes: for any order of threads"}}};
}

}  // namespace

std::vector<FeatureGroup> contact_features() {
  return {methods(), options(), results(), surroundings(), bodies(), repetition()};
}

}  // namespace palpate::test
