// Scenes as code: what the simulated depth camera looks at. Shared by tests, benchmarks, the
// command line and, later, the viewer.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"
#include "scenes/environment.h"

namespace palpate { inline namespace v0 { namespace scenes {

/// One rigid body of a scene. Its pose may change with time.
struct Body {
  std::string name;
  TriangleMesh mesh;  ///< body frame B
  /// Pose at time t (s); null: it stays at `X_WB`.
  Pose (*motion)(double t) = nullptr;
  Pose X_WB;
};

/// A world seen by a depth camera, which looks along its z with x to the right and y down.
struct Scene {
  std::string name;
  std::string title;                       ///< one line for humans
  std::optional<Environment> environment;  ///< the part that is known exactly; it never moves
  std::vector<Body> bodies;                ///< the rest
  /// Where the camera is at a time, s; null: at the origin of W.
  std::function<Pose(double)> X_WC = nullptr;
  bool is_camera_moving = false;  ///< X_WC is not the same at all times
  Intrinsics intrinsics{575.8157, 575.8157, 319.5, 239.5};
  int width = 640, height = 480;
  double rate = 30;                ///< frames per second
  double duration = 4;             ///< seconds of the default motion and tool path
  std::string tool_shape;          ///< the shape that goes with it (mesh/mesh.h)
  double tool_size = 0.1;          ///< meters
  std::vector<double> path_times;  ///< default tool path, with path_poses
  std::vector<Pose> path_poses;    ///< X_WT
};

/// Kinect class noise. Each pixel and each frame is independent of the others.
/// * Axial: the standard deviation grows as 0.0012 + 0.0019 (z - 0.4)^2 (Nguyen, Izadi & Lovell
///   2012, "Modeling Kinect sensor noise for improved 3D reconstruction and tracking", eq. 3, for
///   incidence up to 60 degrees; the quantisation below is part of it, not added to it).
/// * Quantisation: depth comes from a disparity in steps of 1/8 pixel, 2.9 mm at 1 m (Khoshelham &
///   Oude Elberink 2012, "Accuracy and resolution of Kinect depth data", sections 3.1 and 4.3).
/// * Lateral: a pixel near an edge may see the other side of it (Nguyen et al., section 3.1).
/// * Shadow: the projector sits `baseline` to the right of the camera (+x); what it does not reach,
///   left of near objects, has no depth (Khoshelham & Oude Elberink, section 3.3).
/// * Missing: any pixel may fail.
struct NoiseModel {
  bool enabled = true;
  double axial_base = 0.0012;    ///< m, standard deviation at 0.4 m
  double axial_growth = 0.0019;  ///< m / m2: + growth * (z - 0.4)^2
  double disparity_steps = 8;    ///< steps per pixel of the disparity quantisation; 0: none
  double baseline = 0.075;       ///< m, camera to projector; 0: no shadows, no quantisation
  double missing = 0.002;        ///< share of pixels without a measurement
  double lateral = 0.6;          ///< pixels, standard deviation of the jitter of edges
};

struct SimulatedCameraOptions {
  NoiseModel noise;
  std::uint64_t seed = 1;
  double unit = 0.001;             ///< meters per count; noise-free runs want 0.0001
  std::optional<double> duration;  ///< seconds; default: the scene's
};

/// Names for make_scene, in the order of the documentation.
std::vector<std::string> scene_names();
/// Error: unknown name (the message lists the known ones).
Result<Scene> make_scene(std::string_view name);

/// Another camera in the same place: as wide a view in `width` columns, its optical axis in the
/// middle of the image.
void set_image_size(Scene& scene, int width, int height);

/// Exact depth along z in meters of every pixel at time t, NaN where nothing is hit. Embree finds
/// the triangle, its depth is computed in double; the environment is cast in double.
std::vector<float> render_depth(const Scene& scene, double t);

/// Streams the scene through the noise model: frame k at time k / rate, as long as that is less
/// than the duration. The same seed gives the same bits. Error: a number out of its range.
Result<std::unique_ptr<DepthSource>> open_simulated_camera(Scene scene,
                                                           const SimulatedCameraOptions& options);

}}}  // namespace palpate::v0::scenes
