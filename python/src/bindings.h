// Python classes, and the functions that add them to the module, one per file of bindings.
#pragma once

#include <nanobind/nanobind.h>

#include <memory>

#include "palpate/contact/body_contact.h"
#include "palpate/field/sensor.h"
#include "palpate/settings/setting_table.h"
#include "palpate/tool/tool.h"
#include "python/src/arrays.h"

namespace palpate::python {

void bind_tool(nanobind::module_& m);
void bind_sensor(nanobind::module_& m);
void bind_camera(nanobind::module_& m);
void bind_surface(nanobind::module_& m);
void bind_batch(nanobind::module_& m);
void bind_contact(nanobind::module_& m);
void bind_penetration(nanobind::module_& m);
void bind_pose_gradients(nanobind::module_& m);
void bind_runs(nanobind::module_& m);
void bind_pushed_camera(nanobind::module_& m);
void bind_camera_frames(nanobind::module_& m);
void bind_recordings(nanobind::module_& m);
void bind_robot(nanobind::module_& m);
void bind_scenes(nanobind::module_& m);

/// Class palpate.Tool.
struct PyTool {
  std::shared_ptr<const Tool> tool;
  /// Pairs of neighbors, computed when first requested.
  std::shared_ptr<const std::vector<std::int32_t>> edges = nullptr;
};

/// Class palpate.Camera: a Camera with its unit and pose.
struct PyCamera {
  Camera camera;
  double unit = 0.001;  ///< meters per count
  Pose X_WC;

  DepthStreamInfo stream() const;
};

/// Class palpate.Surface. Keeps its arrays alive.
struct PySurface {
  std::shared_ptr<Sensor> owner;
  SurfaceView view;
  Pose X_WC, X_CW;
  bool is_in_camera_frame = true;  ///< X_WC is the identity
  double time = 0;                 ///< s; NaN: unknown
  Place place;
};

/// Class palpate.Surfaces: those of many images at once. Keeps their arrays alive.
struct PySurfaces {
  std::shared_ptr<Sensor> owner;
  SurfaceBatch batch;
  Pose X_WC;
  Place place;
};

/// Class palpate.Body: a fixed rigid body.
struct PyBody {
  PyTool shape;  // outlives its index in `placed`
  PlacedBody placed;
};

/// Sets the settings that the keywords name: "stiffness" if only one section has it,
/// "coupling_stiffness" or "coupling.stiffness". palpate.Error: an unknown name, with the nearest
/// one; those of Setting::set.
void apply(const nb::dict& keywords, SettingTable& table);

}  // namespace palpate::python
