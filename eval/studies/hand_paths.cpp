#include "eval/studies/hand_paths.h"

#include <algorithm>
#include <cmath>

#include "palpate/math/geometry.h"
#include "src/math/internal/farthest.h"
#include "src/math/internal/rotation_vector.h"

namespace palpate::eval {
namespace {

constexpr int kCellPixels = 16;
constexpr double kMinShare = 0.9;  // of a place's pixels that have a point

/// Surroundings of a pixel: mean point and normal, and deviation from a plane.
struct Patch {
  Vec3d point, normal;
  double unevenness = INFINITY;  // m
};

Patch patch_at(const PointCloudView& cloud, int u0, int v0, double radius) {
  const auto center = static_cast<std::size_t>(v0) * static_cast<std::size_t>(cloud.width) +
                      static_cast<std::size_t>(u0);
  const auto z = static_cast<double>(cloud.z[center]);
  if (!(z > 0)) return {};
  const int reach = static_cast<int>(cloud.intrinsics.fx * radius / z);
  if (u0 < reach || v0 < reach || u0 + reach >= cloud.width || v0 + reach >= cloud.height) {
    return {};
  }
  Patch patch;
  std::vector<Vec3d> points;
  int num = 0;
  const int step = std::max(1, reach / 12);
  for (int v = v0 - reach; v <= v0 + reach; v += step) {
    for (int u = u0 - reach; u <= u0 + reach; u += step) {
      ++num;
      const auto i = static_cast<std::size_t>(v) * static_cast<std::size_t>(cloud.width) +
                     static_cast<std::size_t>(u);
      if (!std::isfinite(cloud.nx[i])) continue;
      points.push_back(to_double(Vec3f{cloud.x[i], cloud.y[i], cloud.z[i]}));
      patch.point += points.back();
      patch.normal += to_double(Vec3f{cloud.nx[i], cloud.ny[i], cloud.nz[i]});
    }
  }
  if (static_cast<double>(points.size()) < kMinShare * num) return {};
  patch.point = patch.point / static_cast<double>(points.size());
  patch.normal = normalized(patch.normal);
  double sum = 0;
  for (const Vec3d& p : points) sum += std::abs(dot(p - patch.point, patch.normal));
  patch.unevenness = sum / static_cast<double>(points.size());
  return patch;
}

/// Returns the pose at a place; `depth` m behind it on average, `swing` m more or less.
Pose pose_at(const Place& place, const Vec3d& center_T, double depth, double swing,
             const HandShift& at) {
  const Vec3d side = normalized(cross(place.into_W, Vec3d{0, 1, 0.3}));
  const Vec3d up = cross(place.into_W, side);
  const Vec3d p = place.p_W + at.side * side + at.up * up + (depth + swing * at.in) * place.into_W;
  const Vec3d turn = at.turn.x * side + at.turn.y * up + at.turn.z * place.into_W;
  const Quaternion R_WT = rotation_by(turn);
  return {p - rotate(R_WT, center_T), R_WT};
}

}  // namespace

Result<Place> calm_place(const PointCloudView& cloud, double radius, double farthest) {
  Place best;
  double least = INFINITY;
  for (int v = kCellPixels; v < cloud.height - kCellPixels; v += kCellPixels) {
    for (int u = kCellPixels; u < cloud.width - kCellPixels; u += kCellPixels) {
      const Patch patch = patch_at(cloud, u, v, radius);
      // Small penalties for the distance from the image's middle and for depth.
      const double off = std::hypot((u - cloud.width / 2.0) / cloud.width,
                                    (v - cloud.height / 2.0) / cloud.height);
      const double cost = patch.unevenness + 0.01 * off + 0.002 * patch.point.z;
      if (cost < least && patch.point.z < farthest) {
        least = cost;
        best = {patch.point, -1.0 * patch.normal};
      }
    }
  }
  if (std::isfinite(least)) return best;
  return Error{Errc::bad_input, "the frame shows no surface that is large enough for the tool"};
}

HandShift figure_of_eight(double phase) {
  const double a = 2 * kPi * phase;
  return {0.012 * std::sin(2 * a),
          0.02 * std::sin(3 * a),
          std::sin(7 * a),
          {0.08 * std::sin(a), 0.06 * std::sin(2 * a + 1), 0.1 * std::sin(3 * a + 2)}};
}

HandMotion recorded_hand(std::vector<TimedPose> poses) {
  constexpr double kAcross = 0.015;       // m, rms
  const double of_sine = std::sqrt(0.5);  // rms
  Vec3d middle, turned, squares;
  const auto num = static_cast<double>(poses.size());
  const Quaternion first = poses.front().X_WT.rotation;
  for (const TimedPose& at : poses) {
    middle += 1 / num * at.X_WT.translation;
    turned += 1 / num * rotation_between(first, at.X_WT.rotation);
  }
  for (const TimedPose& at : poses) {
    const Vec3d d = at.X_WT.translation - middle;
    squares += 1 / num * Vec3d{d.x * d.x, d.y * d.y, d.z * d.z};
  }
  const double across = kAcross / std::sqrt((squares.x + squares.y) / 2);
  const double in = of_sine / std::sqrt(squares.z);
  return [=, poses = std::move(poses)](double phase) {
    const double from = poses.front().time, to = poses.back().time;
    const Pose at = palpate::pose_at(poses, from + phase * (to - from));
    const Vec3d d = at.translation - middle;
    return HandShift{across * d.x, across * d.y, in * d.z,
                     rotation_between(first, at.rotation) - turned};
  };
}

Result<HandPath> hand_path(const FrozenFrame& frame, const Tool& tool, double mean_depth,
                           std::size_t num_poses, double swing, const HandMotion& motion,
                           double farthest) {
  const double radius = palpate::farthest(tool.spheres(), tool.sphere_mass().center_of_mass);
  const auto place = calm_place(frame.cloud(), radius, farthest);
  if (!place) return place.error();
  const auto feeler =
      tool.prefix(static_cast<int>(std::min<std::size_t>(1000, tool.spheres().size())));
  if (!feeler) return feeler.error();
  auto query = make_contact_query(palpate::Place::cpu(), *feeler);
  if (!query) return query.error();
  const Vec3d center_T = tool.sphere_mass().center_of_mass;
  const double whole = full_volume(*feeler, ContactOptions{});

  constexpr int kProbes = 60;
  const double way = swing * radius;
  HandPath path;
  const auto feel = [&](double depth) {
    path.mean_depth = path.max_depth = 0;
    for (int i = 0; i < kProbes; ++i) {
      const Pose X_WT =
          pose_at(*place, center_T, depth, way, motion(static_cast<double>(i) / kProbes));
      const double share = (*query)->measure(frame.surfaces(), X_WT).penetration.volume / whole;
      path.mean_depth += share / kProbes;
      path.max_depth = std::max(path.max_depth, share);
    }
  };
  double low = -radius, high = radius;
  for (int i = 0; i < 30; ++i) {
    const double middle = (low + high) / 2;
    feel(middle);
    (path.mean_depth < mean_depth ? low : high) = middle;
  }
  feel((low + high) / 2);
  for (std::size_t i = 0; i < num_poses; ++i) {
    path.X_WT.push_back(pose_at(*place, center_T, (low + high) / 2, way,
                                motion(static_cast<double>(i) / static_cast<double>(num_poses))));
  }
  return path;
}

}  // namespace palpate::eval
