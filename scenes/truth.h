// How much of a polyhedral tool lies in an exact environment: the yardstick of every measurement.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"
#include "scenes/environment.h"

namespace palpate { inline namespace v0 { namespace scenes {

/// Volume common to the closed mesh (frame T) and the solid, in m3. Closed form for all kinds,
/// balls included; the error is that of double arithmetic, below 1e-10 of the tool's volume for
/// hand-sized tools within a few meters. O(triangles).
double exact_volume(const TriangleMesh& tool_T, const Pose& X_WT, const Environment& environment);

/// The same with what lies behind all planes, which pass through the point `apex`. O(triangles).
double exact_volume(const TriangleMesh& tool_T, const Pose& X_WT, const Vec3d& apex,
                    std::span<const Plane<double>> planes);

/// The common part's volume and the exact counterpart of the wrench sum V_s n_s (thesis
/// section 3.2): the integral of n over it and of (x - C) x n, n being the gradient of
/// signed_distance. The force is minus the gradient of the energy "integral of depth over the
/// common part". Closed form for all kinds but `corner`, where the part nearest to the edge takes
/// quadrature; errors below 1e-10 of the tool's volume (times its size, for the torque about a C
/// within it), below 1e-9 in corners. O(triangles).
struct ExactPenetration {
  double volume = 0;         ///< m3
  VolumeWrench measure_C_W;  ///< force m3, torque m4 about C
};
ExactPenetration exact_penetration(const TriangleMesh& tool_T, const Pose& X_WT,
                                   const Vec3d& center_W, const Environment& environment);

/// One experiment of the thesis: a tool moves in a straight line along z, without turning, from
/// first contact (0 %) until its rear has passed z = 1 m (100 %).
struct ThesisExperiment {
  std::string figure;      ///< of the thesis, e.g. "5.18"
  std::string scene;       ///< for make_scene and environment_of
  std::string tool_shape;  ///< for make_shape
  double tool_size = 0.1;  ///< m
  Pose start, end;         ///< X_WT
};

/// The twelve pairs of Figs. 5.17-5.29.
std::vector<ThesisExperiment> thesis_experiments();

/// The exact solid of a synthetic scene; nullopt for the other scenes and unknown names.
std::optional<Environment> environment_of(std::string_view scene);

/// Names environment_of knows, in the order of the documentation.
std::vector<std::string> environment_names();

}}}  // namespace palpate::v0::scenes
