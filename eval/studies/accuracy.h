// Errors of a way of measuring contact against the exact wrench. Shared by the figures and the
// accuracy tests.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "palpate/cloud/surface_estimator.h"
#include "palpate/contact/contact.h"
#include "palpate/field/depth_field.h"
#include "palpate/tool/tool.h"
#include "scenes/scene.h"
#include "scenes/truth.h"

namespace palpate::eval {

/// A tool goes straight along z into a solid, from first contact (0 %) until its rear has passed
/// z = 1 m (100 %).
struct ContactCase {
  std::string name;   ///< for humans
  std::string scene;  ///< for make_scene
  scenes::Environment environment;
  std::string tool_shape;  ///< for make_shape
  double tool_size = 0.1;  ///< m
  Pose start, end;         ///< X_WT
};

/// The twelve experiments of the thesis.
std::vector<ContactCase> thesis_cases();
/// One case per kind of environment and tool, turned by 20 degrees and off the axis of symmetry.
std::vector<ContactCase> tilted_cases();
/// Both: the set of all reported errors.
std::vector<ContactCase> accuracy_cases();
/// Returns the case of the same tool, turned the same way, against the wall.
ContactCase at_the_wall(const ContactCase& original);

/// Extent of a mesh, turned about its origin, along +z and -z, m.
struct Reach {
  double front = 0, rear = 0;
};
Reach reach_along_z(const TriangleMesh& mesh, const Quaternion& rotation);

/// Packs the tool of a case.
Tool packed_tool(const ContactCase& contact_case, int num_spheres);

/// Depth noise of the simulated camera.
enum class DepthNoise {
  none,
  gaussian,  ///< 1.5 mm standard deviation, independent per pixel
  kinect,    ///< the default NoiseModel, in whole millimeters
};

/// The first image of a scene, ready for queries.
struct RenderedScene {
  SurfaceEstimator surface;
  DepthField field;
};
RenderedScene see(const scenes::Scene& scene, DepthNoise noise);
RenderedScene see(const ContactCase& contact_case, DepthNoise noise);  ///< its scene

/// A way of measuring. Forces and volumes are compared after division by `whole`.
struct Measure {
  double whole = 0;  ///< m3, measured volume of a tool that is wholly inside
  std::function<Penetration(const Pose& X_WT)> at;
};

/// Makes a contact query on the rendered scene; both and the tool must outlive it.
Measure query_measure(const Tool& tool, const RenderedScene& scene, const ContactOptions& options,
                      ThreadPool* pool = nullptr);
/// Cuts every sphere by the tangent plane of a distance field at its center.
Measure distance_measure(const Tool& tool, SphereVolumes volumes,
                         std::function<scenes::SignedDistance(const Vec3d&)> distance_at);
/// The same with the exact distance field: the remaining error is due to the packing.
Measure oracle_measure(const Tool& tool, const scenes::Environment& environment,
                       SphereVolumes volumes);
/// The truth itself: the remaining error is due to the code of this study.
Measure exact_measure(const Tool& tool, const scenes::Environment& environment);

/// A pose and the exact contact there.
struct ExactStep {
  Pose X_WT;
  double depth = 0;                ///< share of the case's travel
  scenes::ExactPenetration exact;  ///< about the tool's center of mass, that of the spheres
};
/// Returns equal steps from one depth (share of travel) to another, both included.
std::vector<ExactStep> exact_steps(const ContactCase& contact_case, const Tool& tool, double from,
                                   double to, int num_steps);
/// Returns the number of steps of `length` meters in this share of the case's travel, rounded.
int num_steps_over(const ContactCase& contact_case, double share, double length);

/// Errors of the measured share of the tool. Steps that have lost contact (nothing measured
/// although more than 1 % of the tool is inside) are counted and not averaged.
struct VolumeError {
  double rms = 0, worst = 0;  ///< shares of the tool's volume
  double lost = 0;            ///< share of the steps
  double worst_lost = 0;      ///< largest share of the tool that crosses the surface there
};
VolumeError volume_error(const Tool& tool, const std::vector<ExactStep>& steps,
                         const Measure& measure);

/// Errors of force, direction and torque. Steps with less than 0.5 % of the tool inside, or without
/// measured contact, are left out.
struct WrenchError {
  double direction_rms = 0, direction_worst = 0;  ///< rad, between measured and exact force
  double force_rms = 0;                           ///< of the volume of the tool
  double torque_rms = 0, torque_worst = 0;        ///< of exact force times radius of the tool
  /// Largest force difference of two successive steps, in volumes of the tool.
  double jump = 0, exact_jump = 0;
  double jump_ratio() const { return jump / exact_jump; }
};
WrenchError wrench_error(const Tool& tool, const std::vector<ExactStep>& steps,
                         const Measure& measure);

/// Returns |net work| / sum of |work| along a smooth closed loop of all six degrees of freedom,
/// about 35 % deep: zero for forces with a potential (theory of conservative contact).
double loop_work(const ContactCase& contact_case, const Tool& tool, const Measure& measure,
                 int num_steps);

}  // namespace palpate::eval
