// Boxes on a table that a simulated depth camera looks down at, on a simulated clock.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "palpate/field/sensor.h"
#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"
#include "scenes/scene.h"
#include "src/bodies/internal/moving_bodies.h"

namespace palpate::test {

inline constexpr double kTable = 0.7;  ///< how far the table is from the camera, m

inline std::shared_ptr<const Tool> packed_shape(TriangleMesh mesh, int num_spheres) {
  auto tool = Tool::pack(std::move(mesh), {.max_spheres = num_spheres}).value();
  return std::make_shared<const Tool>(std::move(tool).with_solid_field());
}

/// A block from corner to corner.
inline TriangleMesh block(const Vec3d& from, const Vec3d& to) {
  TriangleMesh mesh = make_box(to - from);
  for (Vec3d& vertex : mesh.vertices) vertex += (from + to) / 2;
  return mesh;
}

struct CameraTableOptions {
  bool has_noise = false;
  int width = 160;
  TimeOptions time;
  double duration = 100;
  std::vector<scenes::Body> others;  ///< beside the table
};

class CameraTable {
 public:
  using Options = CameraTableOptions;
  explicit CameraTable(const Options& options = {}) {
    scenes::Scene scene;
    scene.bodies.push_back({"table", block({-1, -1, kTable}, {1, 1, kTable + 0.1}), nullptr, {}});
    for (const scenes::Body& body : options.others) scene.bodies.push_back(body);
    scenes::set_image_size(scene, options.width, options.width * 3 / 4);
    scenes::SimulatedCameraOptions camera;
    camera.noise.enabled = options.has_noise;
    camera.unit = options.has_noise ? 0.001 : 2e-5;
    camera.duration = options.duration;
    source_ = scenes::open_simulated_camera(std::move(scene), camera).value();
    timeline_ = std::make_unique<SurfaceTimeline>(
        SurfaceTimeline::create(source_->info(), {.time = options.time}).value());
  }

  /// Returns the surface at `time`, which must not decrease between calls.
  SurfaceBlend at(double time) {
    while (next_frame_ <= time + 1e-9) {
      if (!source_->next(frame_).value()) break;
      timeline_->push(frame_, next_frame_, pool_);
      next_frame_ += 1 / source_->info().rate;
    }
    return timeline_->at(time);
  }

 private:
  std::unique_ptr<DepthSource> source_;
  std::unique_ptr<SurfaceTimeline> timeline_;
  ThreadPool pool_{1};
  DepthFrame frame_;
  double next_frame_ = 0;
};

/// Objects on it. Down is away from the camera.
class TableTop {
 public:
  explicit TableTop(std::vector<SceneObject> objects, const CameraTable::Options& options = {},
                    BodyOptions body_options = {})
      : table(options), bodies(made(objects, std::move(body_options))) {}
  static std::unique_ptr<MovingBodies> made(const std::vector<SceneObject>& objects,
                                            BodyOptions options) {
    options.gravity_y = 0;
    options.gravity_z = 9.81;
    return MovingBodies::create(objects, options, Place::cpu(), nullptr).value();
  }
  void step(std::span<const MovingBodies::Push> pushes = {}) {
    const SurfaceBlend seen = table.at(time);
    bodies->step({&seen, 1}, pushes, tick);
    time += tick;
  }
  const RigidBody& body(int i) const { return bodies->bodies()[static_cast<std::size_t>(i)]; }

  double time = 0, tick = 1e-3;
  CameraTable table;
  std::unique_ptr<MovingBodies> bodies;
};

}  // namespace palpate::test
