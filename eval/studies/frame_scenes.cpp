#include "eval/studies/frame_scenes.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "eval/studies/interaction.h"
#include "palpate/io/formats.h"
#include "palpate/math/geometry.h"
#include "scenes/truth.h"
#include "src/math/internal/random.h"
#include "src/session/internal/probing_path.h"

namespace palpate::eval {
namespace {

constexpr double kBox = 0.1, kOctahedron = 0.08;  // m
constexpr double kNoise = 0.0015;                 // m, of DepthNoise::gaussian
constexpr int kCoarser = 6;                       // quick form: divides columns and rows

int num_spheres(const Context& context) { return context.choose(1000, 200); }

/// Depth of the moving wall, m; its speed is at most 75 mm/s.
double wall_depth(double t) { return 1 - 0.03 * (1 - std::cos(2.5 * t)); }
Pose wall_pose(double t) { return {{0, 0, wall_depth(t)}, {}}; }
constexpr double kRestTime = 1;  // s: time whose wall pose is that of the wall at rest

Pose tool_pose(double z) { return {{0.001, 0.002, z}, axis_angle({1, 2, 0}, 0.1)}; }
double tool_depth(double t) { return 0.96 + 0.01 * std::sin(4 * t); }
constexpr double kRestDepth = 0.93;  // m

/// Range of the distance from the tool's origin to the wall, and the step of its table, m.
constexpr double kMinDepth = -0.04, kMaxDepth = 0.06, kStep = 0.0005;

scenes::SimulatedCameraOptions camera_with(const Context& context, DepthNoise noise) {
  scenes::SimulatedCameraOptions camera;
  camera.noise.enabled = noise == DepthNoise::kinect;
  camera.unit = noise == DepthNoise::kinect ? 0.001 : 0.0001;
  if (context.quick()) camera.noise.disparity_steps *= kCoarser;  // the same steps in meters
  return camera;
}

/// Makes a scene; in the quick form with a coarser camera.
Result<scenes::Scene> scene_for(const Context& context, const char* name) {
  auto scene = scenes::make_scene(name);
  if (!scene || !context.quick()) return scene;
  scenes::set_image_size(*scene, scene->width / kCoarser, scene->height / kCoarser);
  return scene;
}

void add_gaussian_noise(std::vector<DepthFrame>& frames) {
  Random random(1);
  for (DepthFrame& frame : frames) {
    for (std::uint16_t& count : frame.pixels) {
      const long off = std::lround(kNoise / frame.unit * random.normal());
      if (count > 0) count = static_cast<std::uint16_t>(count + off);
    }
  }
}

Result<Touch> touch_scene(Context& context, const scenes::Scene& scene, DepthNoise noise,
                          double duration, const char* shape, double size) {
  Touch touch;
  scenes::SimulatedCameraOptions camera = camera_with(context, noise);
  camera.duration = duration;
  auto frames = context.simulated(scene, camera, touch.stream);
  if (!frames) return frames.error();
  touch.frames = *std::move(frames);
  if (noise == DepthNoise::gaussian) add_gaussian_noise(touch.frames);
  auto tool = context.tool(shape, size, num_spheres(context));
  if (!tool) return tool.error();
  touch.tool = *std::move(tool);
  return touch;
}

Result<scenes::Scene> wall_scene(const Context& context, bool moves) {
  auto scene = scene_for(context, "moving-wall");
  if (!scene) return scene.error();
  scene->bodies[0].motion = moves ? wall_pose : nullptr;
  scene->bodies[0].X_WB = wall_pose(kRestTime);
  return scene;
}

std::function<Pose(double)> along(std::vector<TimedPose> path) {
  return [path = std::move(path)](double t) { return pose_at(path, t); };
}

}  // namespace

const char* const kFrameScenesNote =
    "Ticks at 1 kHz, frames at 30 Hz: a step that is spread evenly over a frame is 1 of 33. The "
    "wall moves by up to 75 mm/s, the tool is a box of 10 cm (at the moving box an octahedron of 8 "
    "cm).";

Result<Touch> touch_wall(Context& context, DepthNoise noise, bool moves) {
  const auto scene = wall_scene(context, moves);
  if (!scene) return scene.error();
  auto touch = touch_scene(context, *scene, noise, 1.5, "box", kBox);
  if (!touch) return touch.error();
  touch->X_WT = [moves](double t) { return tool_pose(moves ? tool_depth(t) : kRestDepth); };
  return touch;
}

Result<Touch> touch_moving_box(Context& context) {
  const auto scene = scene_for(context, "moving-box");
  if (!scene) return scene.error();
  auto touch = touch_scene(context, *scene, DepthNoise::kinect, 2, "octahedron", kOctahedron);
  if (!touch) return touch.error();
  std::vector<TimedPose> path;
  for (std::size_t i = 0; i < scene->path_times.size(); ++i) {
    path.push_back({scene->path_times[i], scene->path_poses[i]});
  }
  touch->X_WT = along(std::move(path));
  return touch;
}

Result<std::optional<Touch>> touch_recording(Context& context) {
  if (context.quick()) return std::optional<Touch>();
  Touch touch;
  auto frames = context.recorded("sequences/visp_rbt", touch.stream);
  if (!frames) return frames.error();
  if (!*frames) return std::optional<Touch>();
  touch.frames = **std::move(frames);
  auto tool = context.tool("box", kBox, num_spheres(context));
  if (!tool) return tool.error();
  touch.tool = *std::move(tool);
  const OpenDepthSource open = [&] {
    return open_depth_folder(context.settings().data / touch.stream.name,
                             {touch.stream.intrinsics, touch.stream.unit, touch.stream.rate});
  };
  auto path = probing_path(open, *touch.tool, std::nullopt);
  if (!path) return path.error();
  touch.X_WT = along(std::move(path->poses));
  return std::optional(std::move(touch));
}

Result<WallForces> WallForces::create(Context& context, const std::vector<Method>& methods) {
  const auto scene = wall_scene(context, false);
  if (!scene) return scene.error();
  const auto touch = touch_scene(context, *scene, DepthNoise::none, 0.01, "box", kBox);
  if (!touch) return touch.error();
  const auto frame = FrozenFrame::create(touch->stream, touch->frames.front());
  if (!frame) return frame.error();
  auto query = query_on(*frame, *touch->tool);
  WallForces forces;
  forces.tool_ = touch->tool;
  forces.methods_ = methods;
  for (const Method& method : methods) {
    std::vector<double>& measured = forces.measured_.emplace_back();
    for (double in = kMinDepth; in < kMaxDepth; in += kStep) {
      const Pose X_WT = tool_pose(wall_depth(kRestTime) - in);
      measured.push_back(-query->query(X_WT, method.options).measure_W.force.z /
                         full_volume(*forces.tool_, method.options));
    }
  }
  return forces;
}

double WallForces::exact(std::size_t method, double time) const {
  const Pose X_WT = tool_pose(tool_depth(time));
  const double depth = wall_depth(time), whole = full_volume(*tool_, methods_[method].options);
  if (methods_[method].options.counted() == SphereVolumes::represented) {
    return scenes::exact_volume(tool_->mesh(), X_WT, scenes::Environment::wall(depth)) / whole;
  }
  double sum = 0;
  for (const Sphere& s : tool_->spheres()) {
    sum += cap_volume(static_cast<double>(s.radius), depth - (X_WT * to_double(s.center)).z);
  }
  return sum / whole;
}

double WallForces::measured(std::size_t method, double time, double lag) const {
  const std::vector<double>& all = measured_[method];
  const double in = wall_depth(time - lag) - tool_depth(time);
  const double at =
      std::clamp((in - kMinDepth) / kStep, 0.0, static_cast<double>(all.size()) - 1.001);
  const auto i = static_cast<std::size_t>(at);
  const double share = at - static_cast<double>(i);
  return (1 - share) * all[i] + share * all[i + 1];
}

}  // namespace palpate::eval
