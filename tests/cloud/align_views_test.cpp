// Poses of cameras refined by what they see, against the poses that the images were made with.
#include "palpate/cloud/point_cloud.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "palpate/cloud/surface_estimator.h"
#include "scenes/scene.h"
#include "src/cloud/internal/mean_frame.h"

namespace palpate {
namespace {

constexpr double kDegree = 0.017453292519943295;

/// At `eye`, looking at `target`, with y down.
Pose looking(const Vec3d& eye, const Vec3d& target) {
  const Vec3d z = normalized(target - eye), x = normalized(cross(Vec3d{0, 1, 0}, z));
  const Vec3d y = cross(z, x);
  // Valid for a rotation by less than half a turn.
  const double w = 0.5 * std::sqrt(std::max(1e-9, 1 + x.x + y.y + z.z));
  return {eye, normalized(Quaternion{(y.z - z.y) / (4 * w), (z.x - x.z) / (4 * w),
                                     (x.y - y.x) / (4 * w), w})};
}

/// A table with a box and a ball on it, or something of less shape.
scenes::Scene table() {
  scenes::Scene scene = scenes::make_scene("mannequin").value();
  scenes::set_image_size(scene, 320, 240);
  return scene;
}

struct View {
  Pose X_WC;
  std::unique_ptr<SurfaceEstimator> estimator;
};

/// The mean of some frames, as surfaces.
View view_of(scenes::Scene scene, const Pose& X_WC, bool has_noise, std::uint64_t seed) {
  constexpr int kNumFrames = 8;
  scene.X_WC = [X_WC](double) { return X_WC; };
  for (scenes::Body& body : scene.bodies) {
    if (body.motion) body.X_WB = body.motion(0);
    body.motion = nullptr;
  }
  scenes::SimulatedCameraOptions options;
  options.noise.enabled = has_noise;
  options.seed = seed;
  options.unit = 0.0001;
  options.duration = kNumFrames / scene.rate;
  auto camera = scenes::open_simulated_camera(scene, options).value();
  const DepthFrame frame = mean_frame(*camera, kNumFrames).value();
  View view{X_WC,
            std::make_unique<SurfaceEstimator>(
                SurfaceEstimator::create(scene.width, scene.height, scene.intrinsics, {}).value())};
  ThreadPool pool(1);
  view.estimator->update(frame, pool);
  return view;
}

struct Rig {
  std::vector<View> views;
  std::vector<PointCloudView> clouds;
  std::vector<std::string> names;

  void add(View view) {
    clouds.push_back(view.estimator->cloud());
    names.push_back("camera " + std::string(1, static_cast<char>('A' + views.size())));
    views.push_back(std::move(view));
  }
  /// The true poses, but for the first one wrong by so much.
  std::vector<Pose> wrong(double shift, double degrees) const {
    std::vector<Pose> X_WC;
    for (std::size_t k = 0; k < views.size(); ++k) {
      const double sign = k % 2 == 0 ? -1 : 1;
      const Pose off{Vec3d{0.6, -0.5, 0.62} * (k == 0 ? 0 : sign * shift),
                     axis_angle({1, -2, 1.5}, k == 0 ? 0 : sign * degrees * kDegree)};
      X_WC.push_back(views[k].X_WC * off);
    }
    return X_WC;
  }
};

Rig rig_of(const scenes::Scene& scene, const std::vector<Pose>& poses, bool has_noise) {
  Rig rig;
  for (std::size_t k = 0; k < poses.size(); ++k) {
    rig.add(view_of(scene, poses[k], has_noise, k + 1));
  }
  return rig;
}

double angle_between(const Quaternion& a, const Quaternion& b) {
  const Quaternion q = a * conjugate(b);
  return 2 * std::atan2(norm(Vec3d{q.x, q.y, q.z}), std::abs(q.w));
}

/// Returns the shift of a world point if camera pose b is replaced by a, m.
double off_at(const Pose& a, const Pose& b, const Vec3d& p_W) {
  return norm(a * (inverse(b) * p_W) - p_W);
}

const Vec3d kMiddle{0, 0, 1};

std::vector<Pose> around(int num) {
  std::vector<Pose> poses;
  for (int k = 0; k < num; ++k) {
    const double angle = 0.35 * k;
    poses.push_back(looking(kMiddle + Vec3d{std::sin(angle), -0.1 * k, -std::cos(angle)}, kMiddle));
  }
  poses[0] = Pose{};
  return poses;
}

TEST(AlignViews, BringsCamerasWhereTheyAre) {
  for (const bool has_noise : {false, true}) {
    const Rig rig = rig_of(table(), around(2), has_noise);
    for (const auto& [shift, degrees] : {std::pair{0.003, 0.5}, {0.02, 2.0}}) {
      const auto aligned = align_views(rig.clouds, rig.wrong(shift, degrees), rig.names);
      ASSERT_TRUE(aligned) << aligned.error().message;
      EXPECT_EQ(aligned->X_WC[0], rig.views[0].X_WC);
      const double off = off_at(aligned->X_WC[1], rig.views[1].X_WC, kMiddle);
      const double angle = angle_between(aligned->X_WC[1].rotation, rig.views[1].X_WC.rotation);
      EXPECT_LT(off, 1e-3) << has_noise << " " << degrees;
      EXPECT_LT(angle, 0.1 * kDegree) << has_noise << " " << degrees;
      ASSERT_EQ(aligned->pairs.size(), 1u);
      const ViewPair& pair = aligned->pairs[0];
      EXPECT_GT(pair.num_points, 2000u);
      EXPECT_LT(pair.after, pair.before);
      EXPECT_LT(pair.after, has_noise ? 3e-3 : 1e-3);
      EXPECT_NEAR(pair.turned, degrees * kDegree, 0.15 * kDegree);
    }
  }
}

TEST(AlignViews, RefinesAllAtOnce) {
  const Rig rig = rig_of(table(), around(4), true);
  const auto aligned = align_views(rig.clouds, rig.wrong(0.01, 1), rig.names);
  ASSERT_TRUE(aligned) << aligned.error().message;
  for (std::size_t k = 1; k < 4; ++k) {
    EXPECT_LT(off_at(aligned->X_WC[k], rig.views[k].X_WC, kMiddle), 1e-3) << k;
    EXPECT_LT(angle_between(aligned->X_WC[k].rotation, rig.views[k].X_WC.rotation), 0.1 * kDegree);
  }
  EXPECT_GE(aligned->pairs.size(), 3u);
  const auto again = align_views(rig.clouds, rig.wrong(0.01, 1), rig.names);
  EXPECT_EQ(again->X_WC, aligned->X_WC);
}

TEST(AlignViews, RefusesWhatDoesNotHoldTheCameras) {
  const auto why_not = [](const scenes::Scene& scene, const std::vector<Pose>& poses) {
    const Rig rig = rig_of(scene, poses, true);
    const auto aligned = align_views(rig.clouds, rig.wrong(0.003, 0.5), rig.names);
    return aligned ? "known to " + std::to_string(aligned->uncertainty) : aligned.error().message;
  };
  scenes::Scene wall = scenes::make_scene("wall").value(),
                ball = scenes::make_scene("sphere-out-320").value();
  scenes::set_image_size(wall, 320, 240);
  scenes::set_image_size(ball, 320, 240);
  EXPECT_NE(why_not(wall, around(2)).find("too flat or too round"), std::string::npos);
  EXPECT_NE(why_not(ball, around(2)).find("too flat or too round"), std::string::npos)
      << why_not(ball, around(2));
  // One looks the other way.
  const std::string elsewhere = why_not(table(), {Pose{}, looking({0, 0, 0.5}, {5, 0, -2})});
  EXPECT_NE(elsewhere.find("sees too little"), std::string::npos) << elsewhere;
  const Rig rig = rig_of(table(), around(2), false);
  EXPECT_FALSE(align_views({rig.clouds.data(), 1}, std::vector<Pose>(1), rig.names));
}

}  // namespace
}  // namespace palpate
