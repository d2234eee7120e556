// How much of the tool is inside the scene, and the wrench that follows (thesis sections 3.2, 3.3).
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "palpate/cloud/point_cloud.h"
#include "palpate/core/isa.h"
#include "palpate/core/result.h"
#include "palpate/core/thread_pool.h"
#include "palpate/math/pose.h"
#include "palpate/tool/tool.h"

namespace palpate {

/// How spheres that no point touches get their plane.
enum class InsideMethod {
  weighted,    ///< average over all boundary spheres (Alg. 3.3)
  simplified,  ///< the best boundary sphere only (Alg. 3.4)
  graph,       ///< along the leaf graph, away from the surface (Algs. 3.5-3.7)
};

/// What makes a boundary sphere a good one to borrow from.
enum class Priority {
  distance,  ///< inverse distance of the centres
  count,     ///< number of points inside the boundary sphere
};

/// Volume of a sphere that the graph reaches.
enum class InsideVolume {
  full,  ///< the whole sphere (Alg. 3.7)
  cap,   ///< cut by the plane of its reference (footnote of Alg. 3.7)
};

struct ContactOptions {
  InsideMethod method = InsideMethod::simplified;
  Priority priority = Priority::distance;
  InsideVolume inside = InsideVolume::full;
};

/// Things a caller may want to know about a step that still gave a valid result.
enum class StepStatus : std::uint32_t {
  ok = 0,
  non_finite_pose = 1,    ///< the pose was not finite: nothing was measured, all zero
  ambiguous_normals = 2,  ///< a boundary sphere's points disagree (|mean normal| < 0.5)
};

/// The measure for one pose.
struct Penetration {
  double volume = 0;  ///< m3: sum of V_s, kept apart from |force|
  /// force: sum V_s n_s (m3); torque: sum (c_s - C) x V_s n_s (m4) about the tool's centre of mass
  /// C; both in W, before any stiffness.
  Wrench measure_W;
  int num_boundary_spheres = 0;  ///< spheres that contain at least one point
  int num_inside_spheres = 0;    ///< untouched spheres with V_s > 0
  int num_points = 0;            ///< points inside some sphere
  std::uint32_t status = 0;      ///< StepStatus bits
};

/// State of one sphere after a query, for pictures and tests.
enum class SphereState : std::uint8_t { outside, boundary, inside };

/// Measures one tool against a cloud. All memory is allocated at construction. One thread at a
/// time.
class ContactQuery {
 public:
  virtual ~ContactQuery() = default;

  /// The cloud that the next queries look at, expressed in W. The view must stay valid. O(1).
  virtual void set_cloud(const PointCloudView& cloud) noexcept = 0;

  /// One measurement. O(points in the tool's image window + spheres). No allocation, no lock. The
  /// same input gives the same bits, whatever was asked before and for any number of threads.
  virtual Penetration query(const Pose& X_WT, const ContactOptions& options) noexcept = 0;

  /// Per sphere, of the last query. `planes` are in the tool frame: the plane a sphere was cut by
  /// (normal zero if none).
  virtual std::span<const SphereState> states() const noexcept = 0;
  virtual std::span<const Plane<float>> planes() const noexcept = 0;
};

/// Where queries run.
enum class Backend { cpu, cuda };

struct ContactCapacities {
  Isa isa = best_isa();
  /// Threads used inside one query; null runs on the caller's thread alone.
  ThreadPool* pool = nullptr;
};

/// Errors: the backend is not in this build or on this machine. `tool` must outlive the query.
Result<std::unique_ptr<ContactQuery>> make_contact_query(Backend backend, const Tool& tool,
                                                         const ContactCapacities& capacities = {});

}  // namespace palpate
