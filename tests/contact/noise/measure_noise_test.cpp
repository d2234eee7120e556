// The noise of measures: against closed forms on a plane, against many draws of noise, and against
// itself in batches, threads and frames.
#include <array>
#include <cmath>

#include <gtest/gtest.h>

#include "palpate/cloud/depth_noise.h"
#include "palpate/contact/body_contact.h"
#include "src/cloud/internal/frame_noise.h"
#include "tests/contact/noise/noise_study.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/contact_scenes.h"

namespace palpate {
namespace {

using namespace test;

constexpr double kWall = 0.6;  // m

double wall(double, double) { return kWall; }
double slant(double x, double y) { return kWall / (1 + 0.8 * x - 0.5 * y); }

std::vector<float> depth_of(const Shape& scene) {
  std::vector<float> depth;
  for (int v = 0; v < kHigh; ++v) {
    for (int u = 0; u < kWide; ++u) {
      depth.push_back(static_cast<float>(scene((u - kEye.cx) / kEye.fx, (v - kEye.cy) / kEye.fy)));
    }
  }
  return depth;
}

std::vector<float> noisy(const std::vector<float>& depth, Random& random, int side, double sd) {
  std::vector<float> image = unit_noise(random, side);
  for (std::size_t i = 0; i < depth.size(); ++i)
    image[i] = depth[i] + static_cast<float>(sd) * image[i];
  return image;
}

/// The noise of a box mean over `side` pixels.
MeasurementNoise noise_of_side(int side, double sd) {
  return {sd, 0, side == 1 ? 0.0 : side / std::sqrt(2 * kPi)};
}

SurfaceOptions without_filter(const MeasurementNoise& noise) {
  SurfaceOptions options;
  options.filter.enabled = false;
  options.noise = noise;
  return options;
}

Sensor make_sensor(const SurfaceOptions& options, bool is_one_of_several = false) {
  return Sensor::create(
             {kWide, kHigh, kEye}, Place::cpu(),
             {.surface = options, .field = {.one_of_several = is_one_of_several}, .num_threads = 1})
      .value();
}

SurfaceView surface_of(Sensor& sensor, const std::vector<float>& image, const Pose& X_WC = {}) {
  DepthImageView view(kWide, kHigh, image.data());
  view.X_WC = X_WC;
  return sensor.update(view);
}

Tool ball(double radius, int num) {
  return Tool::pack(make_icosphere(radius, 4), {.max_spheres = num}).value();
}
Tool box() { return Tool::pack(make_box({0.06, 0.04, 0.05}), {.max_spheres = 1500}).value(); }
Pose box_pose() { return {{0.01, 0.02, 0.595}, normalized(Quaternion{0.3, 0.2, 0.1, 0.9})}; }

/// Returns what a tool says of its noise, the mean over some frames.
std::array<double, 7> said_of(const Tool& tool, const Pose& X_WT, int side, double sd) {
  constexpr int num_frames = 8;
  const Contact contact = Contact::create(tool).value();
  Sensor sensor = make_sensor(without_filter(noise_of_side(side, sd)));
  const std::vector<float> depth = depth_of(wall);
  Random random(23);
  std::array<double, 7> mean{};
  for (int i = 0; i < num_frames; ++i) {
    const std::vector<float> image = noisy(depth, random, side, sd);
    const ContactResult result = contact.measure(surface_of(sensor, image), X_WT, {.noise = true});
    const auto said = deviations_of(*result.noise);
    for (std::size_t k = 0; k < said.size(); ++k) mean[k] += said[k] / num_frames;
  }
  return mean;
}

// Each pixel of the contact moves as much volume as its area times its depth, and as much force as
// the tool's surface there is slanted.
TEST(MeasureNoise, IsThatOfTheClosedFormsOfABallInAPlane) {
  constexpr double radius = 0.08, depth = 0.02, sd = 0.0005;
  const Tool tool = ball(radius, 3000);
  const double squared = 2 * radius * depth - depth * depth;  // of the contact's radius
  const double pixel = kWall / kEye.fx, r2 = radius * radius;
  const double of_volume = sd * pixel * std::sqrt(kPi * squared);
  const double of_force =
      sd * pixel * std::sqrt(kPi / 2 * (r2 * std::log(r2 / (r2 - squared)) - squared));
  for (const int side : {1, 3}) {
    const auto said = said_of(tool, {{0.01, -0.02, kWall + depth - radius}, {}}, side, sd);
    const double patch = side;  // n independent patches
    EXPECT_NEAR(said[0], patch * of_volume, 0.15 * patch * of_volume) << side;
    EXPECT_NEAR(said[3], patch * of_volume, 0.15 * patch * of_volume) << side;
    EXPECT_NEAR(said[1], patch * of_force, 0.25 * patch * of_force) << side;
    EXPECT_NEAR(said[2], patch * of_force, 0.25 * patch * of_force) << side;
  }
}

// Noise of one patch larger than the contact moves all of it.
TEST(MeasureNoise, OfOnePatchMovesTheWholeContact) {
  constexpr double radius = 0.01, depth = 0.004, sd = 0.0005;
  const auto said = said_of(ball(radius, 300), {{0.01, -0.02, kWall + depth - radius}, {}}, 30, sd);
  const double area = kPi * (2 * radius * depth - depth * depth);
  EXPECT_NEAR(said[0], sd * area, 0.3 * sd * area);
}

/// Errors of volumes, forces and torques over frames and places.
struct Errors {
  std::vector<double> all[3];

  void add(const NoiseStudy& study) {
    for (int k = 0; k < 7; ++k) {
      for (const double error : study.errors(k)) all[k == 0 ? 0 : k < 4 ? 1 : 2].push_back(error);
    }
  }
};

Errors errors_of(const Tool& tool, const Pose& X_WT, const SurfaceOptions& options, int side,
                 double sd) {
  constexpr int num_places = 9, num_frames = 24;
  const Contact contact = Contact::create(tool).value();
  Errors errors;
  Random random(11);
  for (const auto& scene : {wall, slant}) {
    const std::vector<float> depth = depth_of(scene);
    Sensor sensor = make_sensor(options);
    std::vector<NoiseStudy> studies(num_places);
    for (int i = 0; i < num_frames; ++i) {
      const std::vector<float> image = noisy(depth, random, side, sd);
      const SurfaceView surface = surface_of(sensor, image);
      for (int place = 0; place < num_places; ++place) {
        Pose at = X_WT;
        at.translation.x += 0.08 * (place % 3 - 1);
        at.translation.y += 0.06 * (place / 3 - 1);
        const Vec3d& p = at.translation;
        at.translation.z += scene(p.x / p.z, p.y / p.z) - kWall;
        studies[static_cast<std::size_t>(place)].add(contact.measure(surface, at, {.noise = true}));
      }
    }
    for (const NoiseStudy& study : studies) errors.add(study);
  }
  return errors;
}

void print(const char* name, const Errors& errors) {
  std::printf("%-28s", name);
  for (const auto& all : errors.all) {
    std::printf("  rms %.2f, within 1 and 2: %.0f, %.0f %%", rms(all), 100 * share_within(all, 1),
                100 * share_within(all, 2));
  }
  std::printf("\n");
}

// Volume, force and torque over draws of white noise and of noise shared by three pixels.
TEST(MeasureNoise, IsThatOfManyDraws) {
  constexpr double sd = 0.0008;
  const Tool tools[] = {box(), ball(0.03, 1000)};
  const Pose poses[] = {box_pose(), {{0.01, 0.02, 0.58}, {}}};
  for (const int side : {1, 3}) {
    SurfaceOptions bilateral;
    bilateral.noise = noise_of_side(side, sd);
    SurfaceOptions adaptive;
    adaptive.filter.smoothing = Smoothing::adaptive;
    SurfaceOptions known = adaptive;
    known.noise = noise_of_side(side, sd);
    const std::pair<std::string, SurfaceOptions> ways[] = {
        {"no filter", without_filter(bilateral.noise)},
        {"bilateral", bilateral},
        {"adaptive, known", known},
        {"adaptive, learned", adaptive}};
    for (int t = 0; t < 2; ++t) {
      for (const auto& [name, options] : ways) {
        const Errors errors = errors_of(tools[t], poses[t], options, side, sd);
        print((name + (t == 0 ? ", box, " : ", ball, ") + std::to_string(side)).c_str(), errors);
        const std::string what = name + " " + std::to_string(t) + " " + std::to_string(side);
        EXPECT_GT(share_within(errors.all[0], 1), 0.60) << what;
        EXPECT_LT(share_within(errors.all[0], 1), 0.80) << what;
        EXPECT_GT(share_within(errors.all[0], 2), 0.90) << what;
        if (name == "no filter") continue;  // noise turns forces by more than first order
        EXPECT_GT(share_within(errors.all[1], 1), 0.55) << what;
        EXPECT_LT(share_within(errors.all[1], 1), 0.85) << what;
        EXPECT_GT(share_within(errors.all[1], 2), 0.86) << what;
      }
    }
  }
}

TEST(MeasureNoise, IsTheSameForAllThreadsAndInstructions) {
  Random random(3);
  Sensor sensor = make_sensor(without_filter({0.001, 0, 0}));
  const std::vector<float> image = noisy(depth_of(slant), random, 1, 0.001);
  const SurfaceView surface = surface_of(sensor, image);
  const Tool tool = box();
  ThreadPool pool(3);
  std::optional<std::array<double, 7>> first;
  for (const Isa isa : {Isa::baseline, Isa::avx2, Isa::avx512}) {
    if (isa > best_isa()) continue;
    for (ThreadPool* const threads : {static_cast<ThreadPool*>(nullptr), &pool}) {
      const auto query =
          make_contact_query(Place::cpu(), tool, FieldMethod{}, {isa, threads}).value();
      const auto said = deviations_of(*query->measure(surface, box_pose(), {.noise = true}).noise);
      EXPECT_GT(said[0], 0);
      if (!first) first = said;
      EXPECT_EQ(said, *first);
    }
  }
}

TEST(MeasureNoise, ChangesNothingElseAndAllocatesNothing) {
  Random random(3);
  Sensor sensor = make_sensor(without_filter({0.001, 0, 0}));
  const std::vector<float> image = noisy(depth_of(slant), random, 1, 0.001);
  const SurfaceView surface = surface_of(sensor, image);
  const Tool tool = box();
  const auto query = make_contact_query(Place::cpu(), tool).value();
  const ContactResult plain = query->measure(surface, box_pose(), {.stiffness = true});
  query->measure(surface, box_pose(), {.noise = true});  // the first one takes its memory
  const AllocationCounter counter;
  const ContactResult with =
      query->measure(surface, box_pose(), {.stiffness = true, .noise = true});
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_FALSE(plain.noise);
  EXPECT_EQ(numbers_of(plain.penetration), numbers_of(with.penetration));
  for (int i = 0; i < 36; ++i) {
    EXPECT_EQ(plain.stiffness->m[i / 6][i % 6], with.stiffness->m[i / 6][i % 6]);
  }
  const ContactResult alone = query->measure(surface, box_pose(), {.noise = true});
  EXPECT_EQ(deviations_of(*alone.noise), deviations_of(*with.noise));
}

TEST(MeasureNoise, OfABatchIsThatOfEachPose) {
  Random random(5);
  Sensor sensor = make_sensor(without_filter({0.001, 0, 0}));
  const std::vector<float> image = noisy(depth_of(slant), random, 1, 0.001);
  const Pose X_WC{{0.1, -0.2, 0.3}, normalized(Quaternion{0.1, 0.5, 0.2, 0.8})};
  SurfaceView surface = surface_of(sensor, image, X_WC);
  const Tool tool = box();
  const Contact contact = Contact::create(tool).value();
  std::vector<Pose> poses;
  for (int i = 0; i < 100; ++i) {
    Pose at = box_pose();
    at.translation.x += random.uniform(-0.1, 0.1);
    at.translation.z += random.uniform(-0.05, 0.03);
    poses.push_back(X_WC * at);
  }
  std::vector<double> volume(poses.size()), force(3 * poses.size()), torque(3 * poses.size());
  BatchAnswers answers;
  answers.volume_std = volume.data();
  answers.force_std = force.data();
  answers.torque_std = torque.data();
  ASSERT_TRUE(contact.measure_batch(surface, {.X_WT = poses, .X_WC = {&X_WC, 1}}, answers));
  int num_touching = 0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const auto said = deviations_of(*contact.measure(surface, poses[i], {.noise = true}).noise);
    num_touching += said[0] > 0;
    EXPECT_NEAR(volume[i], said[0], 1e-5 * said[0]);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(force[3 * i + axis], said[1 + axis], 1e-4 * said[1 + axis]);
      EXPECT_NEAR(torque[3 * i + axis], said[4 + axis], 1e-4 * said[4 + axis]);
    }
  }
  EXPECT_GT(num_touching, 20);
}

TEST(MeasureNoise, OfABlendIsThatOfIndependentFrames) {
  Random random(5);
  Sensor sensor = Sensor::create({kWide, kHigh, kEye}, Place::cpu(),
                                 {.surface = without_filter({0.001, 0, 0}), .num_surfaces = 2})
                      .value();
  const std::vector<float> image = noisy(depth_of(slant), random, 1, 0.001);
  const SurfaceView from = surface_of(sensor, image), to = surface_of(sensor, image);
  const Tool tool = box();
  const auto query = make_contact_query(Place::cpu(), tool).value();
  const auto one = deviations_of(*query->measure(to, box_pose(), {.noise = true}).noise);
  const auto both =
      deviations_of(*query->measure(from, to, 0.25, box_pose(), {.noise = true}).noise);
  for (std::size_t k = 0; k < 7; ++k) {
    EXPECT_NEAR(both[k], std::hypot(0.25, 0.75) * one[k], 1e-6 * one[k]);
  }
  SurfaceView unknown = from;
  unknown.field.noise = nullptr;
  EXPECT_FALSE(query->measure(unknown, to, 0.25, box_pose(), {.noise = true}).noise);
  EXPECT_FALSE(query->measure(to, unknown, 0.25, box_pose(), {.noise = true}).noise);
  EXPECT_TRUE(query->measure(unknown, to, 1, box_pose(), {.noise = true}).noise);
  // A camera without a frame has none.
  EXPECT_TRUE(query->measure(SurfaceView{}, to, 0.25, box_pose(), {.noise = true}).noise);
}

TEST(MeasureNoise, OfCamerasIsUnknownIfThatOfAFrameIs) {
  Sensor sensor = make_sensor(without_filter({0.001, 0, 0}), true);
  const SurfaceView known = surface_of(sensor, depth_of(wall));
  SurfaceView unknown = known;
  unknown.field.noise = nullptr;
  const Tool tool = box();
  const auto query = make_contact_query(Place::cpu(), tool).value();
  const auto is_known = [&](const SurfaceView& from, double progress) {
    const SurfaceBlend cameras[] = {{known, known, 1}, {from, known, progress}};
    return query->measure(cameras, box_pose(), {.noise = true}).noise.has_value();
  };
  EXPECT_TRUE(is_known(known, 0.5));
  EXPECT_TRUE(is_known(unknown, 1));
  EXPECT_FALSE(is_known(unknown, 0.5));
}

// It does not become 0, which would say that the measure is exact.
TEST(MeasureNoise, WhatIsNoNumberStaysNone) {
  Sensor sensor = make_sensor(without_filter({0.001, 0, 0}));
  SurfaceView surface = surface_of(sensor, depth_of(wall));
  FrameNoise broken = *surface.field.noise;
  broken.base[0] = NAN;
  surface.field.noise = &broken;
  const Tool tool = box();
  const auto query = make_contact_query(Place::cpu(), tool).value();
  const auto said = query->measure(surface, box_pose(), {.noise = true}).noise;
  ASSERT_TRUE(said);
  for (const double each : deviations_of(*said)) EXPECT_TRUE(std::isnan(each));
}

// Two cameras see one wall; a third one sees nothing of the tool.
TEST(MeasureNoise, OfSeveralCamerasIsThatOfThoseThatDecide) {
  constexpr double sd = 0.0005;
  const Pose X_WC[] = {{}, {{0.05, 0, 0}, {}}, {{3, 0, 0}, {}}};
  const std::vector<float> depth = depth_of(wall);
  std::vector<Sensor> sensors;
  for (int k = 0; k < 3; ++k) sensors.push_back(make_sensor(without_filter({sd, 0, 0}), true));
  const Tool tool = ball(0.05, 1500);
  const auto query = make_contact_query(Place::cpu(), tool).value();
  const Pose X_WT{{0.02, 0.01, 0.565}, {}};
  Random random(17);
  NoiseStudy of_one, of_two;
  for (int i = 0; i < 30; ++i) {
    std::vector<SurfaceBlend> cameras;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::vector<float> image = noisy(depth, random, 1, sd);
      const SurfaceView surface = surface_of(sensors[k], image, X_WC[k]);
      cameras.push_back({surface, surface, 1});
    }
    of_two.add(query->measure(std::span(cameras).first(2), X_WT, {.noise = true}));
    const SurfaceBlend apart[] = {cameras[0], cameras[2]};
    of_one.add(query->measure(apart, X_WT, {.noise = true}));
    const auto single = deviations_of(*query->measure(cameras[0].to, X_WT, {.noise = true}).noise);
    for (std::size_t k = 0; k < 4; ++k) {
      EXPECT_NEAR(of_one.said.back()[k], single[k], 0.02 * single[k]) << k;
    }
  }
  EXPECT_GT(rms(of_one.errors(0)), 0.7);
  EXPECT_LT(rms(of_one.errors(0)), 1.4);
  // Cameras that agree count both, which makes the measure calmer than it says.
  EXPECT_GT(rms(of_two.errors(0)), 0.5);
  EXPECT_LT(rms(of_two.errors(0)), 1.2);
}

TEST(MeasureNoise, OfBodiesIsZero) {
  const Tool tool = box();
  const auto index = ToolIndex::create(tool);
  const auto query = make_body_batch_query(Place::cpu(), index, {{index, Pose{}}}).value();
  const Pose X_WT{{0.01, 0, 0}, {}};
  double volume = 0, volume_std = 1, force_std[3] = {1, 1, 1};
  BatchAnswers answers;
  answers.volume = &volume;
  answers.volume_std = &volume_std;
  answers.force_std = force_std;
  ASSERT_TRUE(query->measure({&X_WT, 1}, {}, answers));
  EXPECT_GT(volume, 0);
  EXPECT_EQ(volume_std, 0);
  for (const double each : force_std) EXPECT_EQ(each, 0);
}

TEST(MeasureNoise, IsOfTheFieldAlone) {
  Sensor sensor = make_sensor({});
  const SurfaceView surface = surface_of(sensor, depth_of(wall));
  const Tool tool = box();
  const auto query = make_contact_query(Place::cpu(), tool, GraphMethod{}).value();
  EXPECT_FALSE(query->measure(surface, box_pose(), {.noise = true}).noise);
}

}  // namespace
}  // namespace palpate
