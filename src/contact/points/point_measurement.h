// Measurements by points on the CPU, with all memory that they need. The stages that find boundary
// spheres, their planes and the result are in point_contact.cpp; the spheres that no point touches
// are measured in untouched_spheres.cpp.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "palpate/contact/contact.h"
#include "src/contact/index/tool_parts.h"
#include "src/contact/points/donors/donors.h"
#include "src/contact/points/donors/plane_assignment.h"
#include "src/contact/points/edges/edge_planes.h"
#include "src/contact/points/graph/graph_traversal.h"
#include "src/contact/points/scan/boundary_points.h"

namespace palpate { inline namespace v0 {

// Successive measurements, each with the memory of the one before.
class PointMeasurement {
 public:
  PointMeasurement(const ToolIndex& index, const ContactOptions& options,
                   const ExecutionOptions& execution);

  /// `X_WT` is finite, its quaternion unit.
  Penetration measure(const PointCloudView& cloud, const Pose& X_WT);
  /// Describes the last measurement, whose options have no field.
  void describe(const ContactWants& wants) const;

 private:
  void forget_last_query();
  void find_boundary_points(const Pose& X_WT);
  Penetration find_boundary_planes(const Pose& X_WT);
  MeasureSums measure_boundary_spheres();
  MeasureSums measure_by_assignment();
  MeasureSums measure_one_by_one();
  MeasureSums measure_along_graph();
  Candidates candidates(int which);
  double reached_volume(const GraphTraversal::Visit& visit) const;
  double volume_scale(std::int32_t id) const {
    return static_cast<double>(scales_.of_sphere[static_cast<std::size_t>(id)]);
  }
  bool uses_edges() const { return options_.edges != Edges::none && cloud_.edge_x != nullptr; }
  AssignmentRule assignment_rule() const {
    return {options_.method == MethodKind::weighted, priority_, found_edges()};
  }
  const EdgesView* found_edges() const { return edges_.empty() ? nullptr : &edges_view_; }
  const Vec3d& origin() const { return index_.tool().sphere_mass().center_of_mass; }
  // True if the spheres that no point touches composite donors.
  bool overlays() const { return fades_in_ && options_.method == MethodKind::simplified; }
  // True if they compare all donors, which the kernels do not.
  bool compares_all() const {
    return priority_.compares_all(options_.method == MethodKind::weighted);
  }

  const ToolIndex& index_;
  const ContactOptions options_;
  const bool fades_in_;
  std::span<const Sphere> spheres_;
  ThreadPool own_pool_{1};
  ThreadPool* pool_;
  AssignNearest assign_nearest_;
  AssignWeighted assign_weighted_;
  // Parts of the index.
  const SphereGrid& grid_;
  const SphereClusters& clusters_;
  const VolumeScales& scales_;
  const Bounds& box_T_;
  const PriorityRule priority_;

  std::optional<GraphTraversal> traversal_;  // graph
  BoundaryPoints points_;
  EdgePlanes edges_;  // without room if edges do not matter
  EdgesView edges_view_;
  PointCloudView cloud_;
  double sum_scale_ = 1;  // of the last query

  // Boundary spheres of the last query.
  std::vector<GraphTraversal::Seed> seeds_;  // all, ascending; zero normal: no plane
  std::vector<std::int32_t> donor_of_seed_;  // index into the donors, or -1
  struct SeedMoment {
    double volume = 0;
    Vec3d first;  // sum of V_s (c_s - C)
  };
  std::vector<SeedMoment> seed_moments_;  // graph: of the spheres that a seed reached
  Donors donors_;                         // those with a plane
  // Per slot of clusters_.
  std::vector<std::int32_t> touched_slots_, skipped_slots_, donor_slots_;
  std::vector<float> assigned_volume_;
  std::vector<MeasureSums> group_sums_;
  std::vector<float> candidate_floats_;
  std::vector<std::int32_t> candidate_donors_;
  std::vector<std::int32_t> numbers_;  // 0, 1, 2, ...
  std::vector<Assigned> assigned_;     // of spheres that are measured one by one

  std::span<const GraphTraversal::Visit> reached_;  // graph
};

}}  // namespace palpate::v0
