// Scenes that several cameras look at, rendered by exact rays.
#pragma once

#include <cmath>
#include <functional>
#include <limits>
#include <utility>
#include <vector>

#include "palpate/field/sensor.h"
#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"
#include "palpate/tool/tool.h"
#include "tests/test_util/random_frame.h"

namespace palpate::test {

/// Distance along a ray p + t d to what is first hit, infinite if nothing is.
using Ray = std::function<double(const Vec3d& p, const Vec3d& d)>;

inline double to_ball(const Vec3d& p, const Vec3d& d, const Vec3d& center, double radius) {
  const Vec3d o = p - center;
  const double a = dot(d, d), b = dot(d, o), c = dot(o, o) - radius * radius;
  const double root = b * b - a * c;
  const double t = root > 0 ? (-b - std::sqrt(root)) / a : -1;
  return t > 0 ? t : std::numeric_limits<double>::infinity();
}
/// A wall z = `depth`, seen from below that.
inline double to_wall(const Vec3d& p, const Vec3d& d, double depth) {
  const double t = (depth - p.z) / d.z;
  return t > 0 && std::isfinite(t) ? t : std::numeric_limits<double>::infinity();
}

/// Cameras with what they show; each has a sensor of its own, or a timeline.
struct HullScene {
  std::vector<Sensor> sensors;
  std::vector<SurfaceTimeline> timelines;
  std::vector<SurfaceBlend> views;
  Ray ray;  ///< the scene, if it is exact
  std::function<bool(const Vec3d&)> is_solid;
};

/// A pose of a camera at p_W that looks at `target`, its image upright.
inline Pose look_at(const Vec3d& p_W, const Vec3d& target) {
  const Vec3d z = normalized(target - p_W), x = normalized(cross(Vec3d{0, 1, 0}, z));
  const Vec3d y = cross(z, x);
  // The largest part of the quaternion is w here, and positive.
  const double w = std::sqrt(std::max(0.0, 1 + x.x + y.y + z.z)) / 2;
  return {p_W, normalized(Quaternion{(y.z - z.y) / (4 * w), (z.x - x.z) / (4 * w),
                                     (x.y - y.x) / (4 * w), w})};
}

inline Camera vga() { return {640, 480, {525, 525, 319.5, 239.5}}; }

/// The depth image that a camera at X_WC takes.
inline std::vector<float> depth_seen(const Ray& ray, const Camera& camera, const Pose& X_WC) {
  std::vector<float> meters;
  const Mat3d R_WC = rotation_matrix(X_WC.rotation);
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const Intrinsics& k = camera.intrinsics;
      const double t = ray(X_WC.translation, R_WC * Vec3d{(u - k.cx) / k.fx, (v - k.cy) / k.fy, 1});
      meters.push_back(t < 10 ? static_cast<float>(t) : 0.0f);
    }
  }
  return meters;
}

/// Adds a camera with an image in meters.
inline void add_view(HullScene& scene, const Camera& camera, const Pose& X_WC,
                     const std::vector<float>& meters, const DepthFieldOptions& field = {}) {
  SensorOptions options;
  options.field = field;
  options.field.one_of_several = true;
  options.num_threads = 1;
  scene.sensors.push_back(Sensor::create(camera, Place::cpu(), options).value());
  DepthImageView image(camera.width, camera.height, meters.data());
  image.X_WC = X_WC;
  const SurfaceView surface = scene.sensors.back().update(image);
  scene.views.push_back({surface, surface, 1});
}

/// Rough frames with holes, seen by cameras side by side.
inline HullScene rough_scene(int num_cameras, const DepthFieldOptions& field, Random& random) {
  HullScene scene;
  const Camera camera{160, 120, {140, 140, 79.5, 59.5}};
  for (int k = 0; k < num_cameras; ++k) {
    const DepthFrame frame = random_frame(camera.width, camera.height, random, false);
    std::vector<float> meters;
    for (const std::uint16_t count : frame.pixels) {
      meters.push_back(static_cast<float>(count) * static_cast<float>(frame.unit));
    }
    const Pose X_WC{random.in_box(0.05), random.rotation(0.1)};
    add_view(scene, camera, X_WC, meters, field);
  }
  return scene;
}

inline DepthStreamInfo stream_of(const Camera& camera) {
  DepthStreamInfo stream;
  stream.width = camera.width;
  stream.height = camera.height;
  stream.intrinsics = camera.intrinsics;
  stream.rate = 30;
  return stream;
}

/// Adds a camera that remembers: it has seen the first frames, and shows the way from the one
/// before the last to that; by itself or as one of several.
inline void add_memory(HullScene& scene, const Camera& camera, const std::vector<DepthFrame>& seen,
                       const Pose& X_WC, double progress, bool is_one_of_several,
                       const MemoryOptions& memory = {}) {
  TimeOptions time;
  time.memory = memory;
  time.memory.kind = DepthMemory::on;
  DepthFieldOptions joined;
  joined.one_of_several = is_one_of_several;
  ThreadPool pool(1);
  scene.timelines.push_back(
      SurfaceTimeline::create(stream_of(camera), {.field = joined, .time = time}).value());
  SurfaceTimeline& timeline = scene.timelines.back();
  for (std::size_t i = 0; i < seen.size(); ++i) {
    DepthImageView image = seen[i];
    image.X_WC = X_WC;
    timeline.push(image, static_cast<double>(i) / 30, pool);
  }
  SurfaceBlend view = timeline.at(static_cast<double>(seen.size()) / 30);
  view.progress = progress;
  scene.views.push_back(view);
}

/// Rough frames, before which others come, for cameras that hardly stand apart. One camera is by
/// itself, or joined to none.
inline HullScene rough_memories(int num_cameras, Random& random, bool is_joined) {
  HullScene scene;
  const Camera camera{160, 120, {140, 140, 79.5, 59.5}};
  std::vector<DepthFrame> frames;
  for (int i = 0; i < 5; ++i) {
    const bool is_new = i == 0 || i > 2;
    frames.push_back(is_new ? random_frame(camera.width, camera.height, random, false) : frames[0]);
  }
  for (int k = 0; k < num_cameras; ++k) {
    const Pose X_WC{random.in_box(0.01), random.rotation(0.01)};
    add_memory(scene, camera, frames, X_WC, k % 2 == 0 ? random.uniform(0, 1) : 1, is_joined);
  }
  return scene;
}

inline HullScene rough_memories(int num_cameras, Random& random) {
  return rough_memories(num_cameras, random, num_cameras > 1);
}

/// A pose near something that has come before what the first camera remembers.
inline Pose pose_in_front(const HullScene& scene, Random& random) {
  const SurfaceView& seen = scene.views[0].to;
  const DepthFieldLevel& level = seen.in_front.levels[0];
  while (true) {
    const int u = static_cast<int>(random.uniform(0, level.width));
    const int v = static_cast<int>(random.uniform(0, level.height));
    const auto i = static_cast<std::size_t>(v * level.width + u);
    const float* const plane = level.planes + 2 * (v * level.stride + u);
    if (!(seen.cloud.z[i] > 0) || plane[0] > 10 || plane[1] == 0) continue;
    const Vec3d p_C = to_double(Vec3f{seen.cloud.x[i], seen.cloud.y[i], seen.cloud.z[i]});
    return {seen.X_WC * p_C + random.in_box(0.05), random.rotation(3.0)};
  }
}

inline HullScene exact_scene(const std::vector<Pose>& cameras, const Camera& camera, Ray ray) {
  HullScene scene;
  for (const Pose& X_WC : cameras) {
    add_view(scene, camera, X_WC, depth_seen(ray, camera, X_WC));
  }
  scene.ray = std::move(ray);
  return scene;
}

/// A large ball in front of a wall, which looks smooth from everywhere.
inline HullScene smooth_scene(int num_cameras) {
  std::vector<Pose> cameras;
  for (int k = 0; k < num_cameras; ++k) {
    cameras.push_back(look_at({0.25 * (k - 1), 0.2 * (k % 2), 0.05}, {0, 0, 0.85}));
  }
  return exact_scene(cameras, vga(), [](const Vec3d& p, const Vec3d& d) {
    return std::min(to_ball(p, d, {0, 0, 1.0}, 0.18), to_wall(p, d, 1.3));
  });
}

/// A wall 0.8 m away, in the middle of which the second camera measures nothing if it is `patched`.
inline HullScene wall_scene(int num_cameras, bool patched) {
  HullScene scene;
  for (int k = 0; k < num_cameras; ++k) {
    const Pose X_WC = look_at({0.2 * k, 0, 0}, {0, 0, 0.8});
    const Camera camera = vga();
    std::vector<float> meters =
        depth_seen([](const Vec3d& p, const Vec3d& d) { return to_wall(p, d, 0.8); }, camera, X_WC);
    for (int v = 140; patched && k == 1 && v < 340; ++v) {
      std::fill_n(meters.begin() + v * camera.width + 220, 200, 0.0f);
    }
    add_view(scene, camera, X_WC, meters);
  }
  return scene;
}

/// A ball of 60 mm radius in front of a wall, seen from the front, from both sides and from above.
inline HullScene ball_before_wall(int num_cameras) {
  const Vec3d target{0, 0, 1.05}, ball{0, 0, 1.0};
  std::vector<Pose> cameras = {{}};
  for (const auto& [degrees, elevation] : {std::pair{35.0, 0.0}, {-35.0, 0.0}, {0.0, 35.0}}) {
    const double a = degrees * kPi / 180, e = elevation * kPi / 180;
    cameras.push_back(look_at(
        target + 1.05 * Vec3d{std::sin(a) * std::cos(e), -std::sin(e), -std::cos(a) * std::cos(e)},
        target));
  }
  cameras.resize(static_cast<std::size_t>(num_cameras));
  HullScene scene = exact_scene(cameras, vga(), [ball](const Vec3d& p, const Vec3d& d) {
    return std::min(to_ball(p, d, ball, 0.06), to_wall(p, d, 1.3));
  });
  scene.is_solid = [ball](const Vec3d& p) { return norm(p - ball) < 0.06 || p.z > 1.3; };
  return scene;
}

/// Calls f(point) for `num` points that fill a ball evenly, not in layers: those of the sequence of
/// the number x^4 = x + 1 that lie in the ball.
template <class F>
void for_points_in_ball(const Vec3d& center, double radius, const F& f, int num = 4000) {
  constexpr double kStep = 1.2207440846057596;
  Vec3d at{0.5, 0.5, 0.5};
  for (int i = 0; i < num;) {
    double step = 1;
    for (int axis = 0; axis < 3; ++axis) {
      step /= kStep;
      at[axis] += step;
      at[axis] -= std::floor(at[axis]);
    }
    const Vec3d p = 2.0 * at - Vec3d{1, 1, 1};
    if (dot(p, p) >= 1) continue;
    f(center + radius * p);
    ++i;
  }
}

/// The share of a ball in which no camera sees that a point is free though some camera looks there,
/// by exact rays.
inline double exact_hull_share(const HullScene& scene, const Vec3d& center, double radius) {
  const Camera camera = vga();
  int num = 0, num_solid = 0;
  for_points_in_ball(center, radius, [&](const Vec3d& p) {
    bool is_free = false, is_looked_at = false;
    for (const SurfaceBlend& view : scene.views) {
      const Vec3d p_C = inverse(view.to.X_WC) * p;
      const Intrinsics& k = camera.intrinsics;
      if (p_C.z < 0.02 || std::abs(p_C.x / p_C.z) * k.fx > 320 ||
          std::abs(p_C.y / p_C.z) * k.fy > 240) {
        continue;
      }
      is_looked_at = true;
      const Vec3d eye = view.to.X_WC.translation;
      is_free |= scene.ray(eye, (1 / p_C.z) * (p - eye)) > p_C.z;
    }
    ++num;
    num_solid += is_looked_at && !is_free;
  });
  return static_cast<double>(num_solid) / num;
}

/// A ball as tool.
inline Tool ball_tool(double radius, int num_spheres = 3000) {
  return Tool::pack(make_icosphere(radius, 4), {.max_spheres = num_spheres}).value();
}

}  // namespace palpate::test
