// Scenes as code: what the simulated depth camera looks at. Shared by tests, benchmarks, the command
// line and, later, the viewer.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/math/pose.h"
#include "palpate/mesh/triangle_mesh.h"

namespace palpate::scenes {

/// One rigid body of a scene. Its pose may change with time.
struct Body {
  std::string name;
  TriangleMesh mesh;  ///< body frame B
  /// Pose at time t (s); null: it stays at `X_WB`.
  Pose (*motion)(double t) = nullptr;
  Pose X_WB;
};

/// A world seen by a depth camera at the origin of W (x right, y down, z forward).
struct Scene {
  std::string name;
  std::string title;  ///< one line for people
  std::vector<Body> bodies;
  Intrinsics intrinsics{575.8157, 575.8157, 319.5, 239.5};
  int width = 640, height = 480;
  double rate = 30;         ///< frames per second
  double duration = 4;      ///< seconds of the default motion
  std::string tool_shape;   ///< the shape that goes with it (mesh/shapes.h)
  double tool_size = 0.1;   ///< metres
  std::vector<double> path_times;  ///< default tool path, with path_poses
  std::vector<Pose> path_poses;    ///< X_WT
};

/// Kinect class noise after Nguyen, Izadi & Lovell 2012 and Khoshelham & Oude Elberink 2012.
struct NoiseModel {
  bool enabled = true;
  double axial_base = 0.0012;      ///< m, standard deviation at 0.4 m
  double axial_growth = 0.0019;    ///< m / m2: + growth * (z - 0.4)^2
  double disparity_steps = 8;      ///< sub-pixel steps of the disparity quantisation; 0: none
  double baseline = 0.075;         ///< m; also casts the edge shadows
  double missing = 0.002;          ///< share of pixels without a measurement
  double lateral = 0.6;            ///< pixels, jitter of edges
};

struct SimulatedCameraOptions {
  NoiseModel noise;
  std::uint64_t seed = 1;
  double unit = 0.001;             ///< metres per count; noise-free runs want 0.0001
  std::optional<double> duration;  ///< seconds; default: the scene's
};

/// Names for make_scene, in the order of the documentation.
std::vector<std::string> scene_names();
/// Error: unknown name (the message lists the known ones).
Result<Scene> make_scene(std::string_view name);

/// Exact depth along z in metres of every pixel at time t, NaN where no body is hit (ray casting with
/// Embree in single precision).
std::vector<float> render_depth(const Scene& scene, double t);

/// Streams the scene through the noise model. The same seed gives the same bits.
Result<std::unique_ptr<DepthSource>> open_simulated_camera(Scene scene,
                                                           const SimulatedCameraOptions& options);

}  // namespace palpate::scenes
