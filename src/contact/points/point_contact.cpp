// The query by points on the CPU: order of the stages, and the loops over threads.
#include "src/contact/points/point_contact.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "src/contact/points/donors/plane_assignment.h"
#include "src/contact/points/point_contact_of.h"
#include "src/contact/points/point_measurement.h"
#include "src/contact/points/scan/boundary_plane.h"
#include "src/contact/points/scan/point_scan.h"
#include "src/core/internal/select_isa.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr ScanPoints kScanPoints[] = PALPATE_BY_ISA(scan_points);
constexpr AssignNearest kAssignNearest[] = PALPATE_BY_ISA(assign_nearest);
constexpr AssignWeighted kAssignWeighted[] = PALPATE_BY_ISA(assign_weighted);

}  // namespace

PointMeasurement::PointMeasurement(const ToolIndex& index, const ContactOptions& options,
                                   const ExecutionOptions& execution)
    : index_(index),
      options_(options),
      fades_in_(options.continuity == Continuity::entry || options.continuity == Continuity::both),
      spheres_(index.tool().spheres()),
      pool_(execution.pool != nullptr ? execution.pool : &own_pool_),
      assign_nearest_(select_isa(kAssignNearest, execution.isa)),
      assign_weighted_(select_isa(kAssignWeighted, execution.isa)),
      grid_(parts_of(index).grid()),
      clusters_(parts_of(index).clusters()),
      scales_(parts_of(index).scales(options.counted())),
      box_T_(parts_of(index).box_T),
      priority_(parts_of(index).priority_rule(
          options.priority,
          options.priority == Priority::path ? parts_of(index).paths().lengths.data() : nullptr)),
      points_(spheres_.size(), *pool_, select_isa(kScanPoints, execution.isa),
              options.edges != Edges::none),
      edges_(spheres_, clusters_, options.edges != Edges::none),
      donors_(spheres_) {
  const std::size_t n = spheres_.size(), num_slots = clusters_.x.size();
  seeds_.reserve(n);
  donor_of_seed_.reserve(n);
  if (options.method == MethodKind::graph) {
    traversal_.emplace(spheres_, parts_of(index).graph());
    seed_moments_.reserve(n);
    return;
  }
  touched_slots_.assign(num_slots, PlaneAssignment::kNone);
  for (std::size_t slot = 0; slot < num_slots; ++slot) {
    if (clusters_.sphere_id[slot] < 0) touched_slots_[slot] = PlaneAssignment::kTouched;
  }
  assigned_volume_.assign(num_slots, 0.0f);
  group_sums_.resize(static_cast<std::size_t>(clusters_.num_groups()));
  numbers_.resize(n + Donors::kPadding);
  std::iota(numbers_.begin(), numbers_.end(), 0);
  donor_slots_.assign(num_slots, PlaneAssignment::kNone);
  if (options.method == MethodKind::simplified) {
    const auto num_tasks = static_cast<std::size_t>(pool_->num_threads());
    candidate_floats_.resize(8 * num_tasks * (n + Donors::kPadding));
    candidate_donors_.resize(2 * num_tasks * (n + Donors::kPadding));
  }
  if (overlays() || compares_all() || options.edges != Edges::none) {
    skipped_slots_ = touched_slots_;
    assigned_.resize(n);
  }
}

Penetration PointMeasurement::measure(const PointCloudView& cloud, const Pose& X_WT) {
  cloud_ = cloud.gpu == kHostMemory ? cloud : PointCloudView{};
  forget_last_query();
  Penetration result;
  if (cloud_.size() == 0) {
    result.status = StepStatus::no_surface;
    return result;
  }
  find_boundary_points(X_WT);
  result = find_boundary_planes(X_WT);
  if (options_.edges != Edges::none && !uses_edges()) result.status |= StepStatus::no_edge_vectors;
  MeasureSums sums = measure_boundary_spheres();
  sums.add(options_.method == MethodKind::graph ? measure_along_graph() : measure_by_assignment());
  result.volume = sums.volume;
  result.num_inside_spheres = sums.num_inside;
  result.measure_W = {rotate(X_WT.rotation, sums.force), rotate(X_WT.rotation, sums.torque)};
  return result;
}

void PointMeasurement::forget_last_query() {
  for (const GraphTraversal::Seed& seed : seeds_) {
    const auto id = static_cast<std::size_t>(seed.sphere_id);
    if (!traversal_) {
      touched_slots_[static_cast<std::size_t>(clusters_.slot_of[id])] = PlaneAssignment::kNone;
    }
  }
  seeds_.clear();
  donor_of_seed_.clear();
  edges_.clear();
  donors_.clear();
  reached_ = {};
}

// Stage 1: finds the spheres that contain points, and sums over these.
void PointMeasurement::find_boundary_points(const Pose& X_WT) {
  PointScan scan;
  scan.cloud = cloud_;
  scan.grid = grid_.view();
  scan.spheres = spheres_.data();
  scan.R_TW = rotation_matrix(conjugate(X_WT.rotation));
  scan.translation_W = X_WT.translation;
  scan.sum_scale = sum_scale_ = finest_sum_scale(cloud_.size(), reach_of_sums(box_T_));
  scan.weights = options_.continuity == Continuity::none    ? PointWeights::none
                 : options_.continuity == Continuity::entry ? PointWeights::beside
                                                            : PointWeights::in_sums;
  points_.collect(scan, image_window(cloud_, box_T_, X_WT), uses_edges());
}

// Stage 2: computes the mean point and normal of each boundary sphere (eq. 3.3), in the tool frame.
Penetration PointMeasurement::find_boundary_planes(const Pose& X_WT) {
  Penetration result;
  const Mat3d R_TW = rotation_matrix(conjugate(X_WT.rotation));
  const BoundaryPlaneRule rule{
      options_.continuity == Continuity::kernel || options_.continuity == Continuity::both,
      fades_in_, uses_edges()};
  points_.take([&](std::size_t id, const PointSums& sums, const EdgeSums& edge_sums) {
    const BoundarySphere sphere = boundary_sphere(static_cast<std::int32_t>(id), sums, sum_scale_,
                                                  rule, R_TW, X_WT.translation);
    if (sphere.is_ambiguous) {
      result.status |= StepStatus::ambiguous_normals;
    }
    const Donor& donor = sphere.donor;
    seeds_.push_back({sphere.sphere_id, donor.plane_T.normal, donor.point});
    donor_of_seed_.push_back(sphere.has_plane() ? donors_.size() : -1);
    if (sphere.has_plane()) donors_.add(donor);
    if (!traversal_) {
      touched_slots_[static_cast<std::size_t>(clusters_.slot_of[id])] = PlaneAssignment::kTouched;
    }
    if (uses_edges()) edges_.add_pieces(edge_sums, sum_scale_, R_TW, X_WT.translation);
    result.num_points += sphere.num_points;
  });
  if (uses_edges()) edges_.find_nearest(X_WT, options_.edges);
  for (std::int32_t l = 0; l < donors_.size(); ++l) edges_.note(donors_[l].point);
  edges_view_ = edges_.view();
  donors_.pad();
  result.num_boundary_spheres = static_cast<int>(seeds_.size());
  return result;
}

// Sums V_s n_s over the boundary spheres, each cut by its own plane (Alg. 3.1) and, by `cut`, by
// its edge; the lever is the center. A sphere that a point has just entered is still measured as if
// it were untouched: V = (1 - presence) V_state + presence V_cap.
MeasureSums PointMeasurement::measure_boundary_spheres() {
  MeasureSums sums;
  AssignmentRule own_rule = assignment_rule();
  if (options_.edges != Edges::cut) own_rule.edges = nullptr;
  for (std::size_t s = 0; s < seeds_.size(); ++s) {
    const std::int32_t id = seeds_[s].sphere_id, l = donor_of_seed_[s];
    Assigned measured;
    if (l >= 0) measured = donors_.donors().assign_from(donors_[l], id, own_rule);
    if (fades_in_) {
      const double presence = l >= 0 ? donors_[l].presence : 0;
      const Assigned state = donors_.donors().assign(id, assignment_rule());
      measured.volume = presence * measured.volume + (1 - presence) * state.volume;
      measured.force = presence * measured.force + (1 - presence) * state.force;
    }
    const double volume = volume_scale(id) * measured.volume;
    const Vec3d force = volume_scale(id) * measured.force;
    sums.volume += volume;
    sums.force += force;
    sums.torque +=
        cross(to_double(spheres_[static_cast<std::size_t>(id)].center) - origin(), force);
  }
  return sums;
}

void PointMeasurement::describe(const ContactWants& wants) const {
  const auto set_state = [&](std::int32_t id, SphereState state) {
    if (!wants.states.empty()) wants.states[static_cast<std::size_t>(id)] = state;
  };
  const auto set_plane = [&](std::int32_t id, std::int32_t donor) {
    if (wants.planes.empty() || donor < 0) return;
    const Plane<double>& plane = donors_[donor].plane_T;
    wants.planes[static_cast<std::size_t>(id)] = {to_float(plane.normal),
                                                  static_cast<float>(plane.offset)};
  };
  std::fill(wants.states.begin(), wants.states.end(), SphereState::outside);
  std::fill(wants.planes.begin(), wants.planes.end(), Plane<float>{});
  for (const GraphTraversal::Visit& visit : reached_) {
    if (!(reached_volume(visit) > 0)) continue;
    set_state(visit.sphere_id, SphereState::inside);
    set_plane(visit.sphere_id, donor_of_seed_[static_cast<std::size_t>(visit.seed)]);
  }
  const bool has_references = options_.method == MethodKind::simplified && !overlays();
  for (std::size_t slot = 0; !donors_.empty() && slot < assigned_volume_.size(); ++slot) {
    if (!(assigned_volume_[slot] > 0) || clusters_.sphere_id[slot] < 0) continue;
    set_state(clusters_.sphere_id[slot], SphereState::inside);
    if (has_references) set_plane(clusters_.sphere_id[slot], donor_slots_[slot]);
  }
  for (std::size_t s = 0; s < seeds_.size(); ++s) {
    set_state(seeds_[s].sphere_id, SphereState::boundary);
    if (!wants.planes.empty()) wants.planes[static_cast<std::size_t>(seeds_[s].sphere_id)] = {};
    set_plane(seeds_[s].sphere_id, donor_of_seed_[s]);
  }
}

std::unique_ptr<ContactQuery> make_point_contact(std::shared_ptr<const ToolIndex> index,
                                                 const ContactMethod& method,
                                                 const ExecutionOptions& execution) {
  auto measurement = std::make_unique<PointMeasurement>(*index, contact_options(method), execution);
  return std::make_unique<PointContactOf<PointMeasurement>>(std::move(index), method,
                                                            std::move(measurement));
}

}}  // namespace palpate::v0
