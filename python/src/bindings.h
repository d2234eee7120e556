// What each file of bindings adds to the module.
#pragma once

#include <nanobind/nanobind.h>

#include <memory>

#include "palpate/contact/body_contact.h"
#include "palpate/field/sensor.h"
#include "palpate/tool/tool.h"

namespace palpate::python {

void bind_tool(nanobind::module_& m);
void bind_sensor(nanobind::module_& m);
void bind_batch(nanobind::module_& m);
void bind_contact(nanobind::module_& m);
void bind_penetration(nanobind::module_& m);
void bind_runs(nanobind::module_& m);
void bind_recordings(nanobind::module_& m);
void bind_scenes(nanobind::module_& m);

/// palpate.Tool.
struct PyTool {
  std::shared_ptr<const Tool> tool;
  /// Pairs of neighbours, when they are first requested.
  std::shared_ptr<const std::vector<std::int32_t>> edges = nullptr;
};

/// palpate.Camera: a Camera, how its numbers are to be read, and where it is.
struct PyCamera {
  Camera camera;
  double unit = 0.001;  ///< metres per count
  Pose X_WC;

  DepthStreamInfo stream() const;
};

/// palpate.Surface. As long as it is held, so are its arrays.
struct PySurface {
  std::shared_ptr<Sensor> owner;
  SurfaceView view;
  Pose X_WC, X_CW;
  bool is_in_camera_frame = true;  ///< X_WC is the identity
  double time = 0;                 ///< s; NaN: nobody has said
  Place place;
};

/// palpate.Surfaces: those of many images at once. As long as it is held, so are their arrays.
struct PySurfaces {
  std::shared_ptr<Sensor> owner;
  SurfaceBatch batch;
  Pose X_WC;
  Place place;
};

/// palpate.Body: a rigid body that stays where it is.
struct PyBody {
  PyTool shape;  // outlives what is known of it
  PlacedBody placed;
};

}  // namespace palpate::python
