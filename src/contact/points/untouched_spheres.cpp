// The spheres that no point touches, in a query by points on the CPU: each is cut by the planes of
// donors, which are boundary spheres, or is reached from a boundary sphere along the leaf graph. So
// the measure has the volume behind a surface, where no points are.
#include <algorithm>
#include <cstdint>

#include "src/contact/points/graph/graph_rule.h"
#include "src/contact/points/point_measurement.h"

namespace palpate { inline namespace v0 {

Candidates PointMeasurement::candidates(int which) {
  const std::size_t size = spheres_.size() + Donors::kPadding;
  float* floats = candidate_floats_.data() + static_cast<std::size_t>(which) * 4 * size;
  return {0,
          floats,
          floats + size,
          floats + 2 * size,
          floats + 3 * size,
          candidate_donors_.data() + static_cast<std::size_t>(which) * size};
}

// Weighted and simplified: measures groups of clusters in any order, added up in group order.
MeasureSums PointMeasurement::measure_by_assignment() {
  MeasureSums sums;
  if (donors_.empty()) return sums;
  PlaneAssignment job;
  job.clusters = &clusters_;
  job.spheres = spheres_.data();
  job.boundary = donors_.view(fades_in_);
  job.origin = origin();
  job.priority = options_.priority;
  job.doublings_per_square = static_cast<float>(kDoublings * priority_.per_square);
  job.num_donors = job.boundary.num;
  if (job.priority == Priority::count) {
    // One donor for all: most points, ties to the lowest sphere id.
    job.first_donor = donors_.heaviest();
    job.num_donors = 1;
  }
  job.numbers = numbers_.data();
  job.touched = touched_slots_.data();
  const bool all_one_by_one = overlays() || compares_all();
  const bool one_by_one = all_one_by_one || !edges_.empty();
  if (one_by_one) {
    skipped_slots_ = touched_slots_;
    for (std::size_t id = 0; id < spheres_.size(); ++id) {
      if (all_one_by_one || edges_view_.concerns(static_cast<std::int32_t>(id))) {
        skipped_slots_[static_cast<std::size_t>(clusters_.slot_of[id])] = PlaneAssignment::kTouched;
      }
    }
    job.touched = skipped_slots_.data();
  }
  job.volume_scale = scales_.of_slot.data();
  job.donor = donor_slots_.data();
  job.assigned_volume = assigned_volume_.data();

  if (compares_all()) {
    std::fill(assigned_volume_.begin(), assigned_volume_.end(), 0.0f);
    return measure_one_by_one();
  }
  const bool is_weighted = options_.method == MethodKind::weighted;
  const int num_groups = clusters_.num_groups();
  const int num_tasks = pool_->num_threads();
  pool_->parallel_for(num_tasks, [&](int t) {
    AssignmentScratch scratch;
    if (!is_weighted) scratch = {candidates(2 * t), candidates(2 * t + 1)};
    for (int group = t; group < num_groups; group += num_tasks) {
      group_sums_[static_cast<std::size_t>(group)] =
          is_weighted ? assign_weighted_(job, group) : assign_nearest_(job, group, scratch);
    }
  });
  for (const MeasureSums& group : group_sums_) sums.add(group);
  if (one_by_one) sums.add(measure_one_by_one());
  return sums;
}

// Measures untouched spheres that the kernels leave out: those at edges, and all if they composite
// or compare all donors.
MeasureSums PointMeasurement::measure_one_by_one() {
  const AssignmentRule rule = assignment_rule();
  const bool from_nearest = options_.method == MethodKind::simplified && !overlays();
  const auto is_one_of_them = [&](std::size_t slot) {
    return touched_slots_[slot] != PlaneAssignment::kTouched &&
           skipped_slots_[slot] == PlaneAssignment::kTouched;
  };
  const int num_tasks = pool_->num_threads();
  pool_->parallel_for(num_tasks, [&](int t) {
    // Strided: spheres that need it lie together.
    const auto num = static_cast<std::size_t>(num_tasks);
    for (auto slot = static_cast<std::size_t>(t); slot < touched_slots_.size(); slot += num) {
      if (!is_one_of_them(slot)) continue;
      const std::int32_t id = clusters_.sphere_id[slot];
      std::int32_t& nearest = donor_slots_[slot];
      if (from_nearest && compares_all()) nearest = donors_.donors().choose(id, rule).donor[0];
      Assigned& assigned = assigned_[static_cast<std::size_t>(id)];
      if (!from_nearest) {
        assigned = donors_.donors().assign(id, rule);
      } else {
        assigned =
            nearest < 0 ? Assigned{} : donors_.donors().assign_from(donors_[nearest], id, rule);
      }
    }
  });
  MeasureSums sums;
  for (std::size_t id = 0; id < spheres_.size(); ++id) {
    const auto slot = static_cast<std::size_t>(clusters_.slot_of[id]);
    if (!is_one_of_them(slot)) continue;
    const double scale = volume_scale(static_cast<std::int32_t>(id));
    const double volume = scale * assigned_[id].volume;
    const Vec3d force = scale * assigned_[id].force;
    assigned_volume_[slot] = static_cast<float>(volume);
    sums.volume += volume;
    sums.force += force;
    sums.torque += cross(to_double(spheres_[id].center) - origin(), force);
    sums.num_inside += volume > 0;
  }
  return sums;
}

double PointMeasurement::reached_volume(const GraphTraversal::Visit& visit) const {
  const std::int32_t l = donor_of_seed_[static_cast<std::size_t>(visit.seed)];
  return volume_scale(visit.sphere_id) * palpate::reached_volume(donors_.donors(), donors_[l],
                                                                 visit.sphere_id, options_.inside,
                                                                 found_edges());
}

// Measures the spheres reached by the graph. All with one reference push along one normal: their
// volumes and first moments are added up first.
MeasureSums PointMeasurement::measure_along_graph() {
  MeasureSums sums;
  reached_ = traversal_->run(seeds_, found_edges());
  seed_moments_.assign(seeds_.size(), SeedMoment{});
  for (const GraphTraversal::Visit& visit : reached_) {
    const double volume = reached_volume(visit);
    const Vec3d c = to_double(spheres_[static_cast<std::size_t>(visit.sphere_id)].center);
    SeedMoment& moment = seed_moments_[static_cast<std::size_t>(visit.seed)];
    moment.volume += volume;
    moment.first += volume * (c - origin());
    sums.num_inside += volume > 0;
  }
  for (std::size_t s = 0; s < seeds_.size(); ++s) {
    sums.volume += seed_moments_[s].volume;
    sums.force += seed_moments_[s].volume * seeds_[s].normal;
    sums.torque += cross(seed_moments_[s].first, seeds_[s].normal);
  }
  return sums;
}

}}  // namespace palpate::v0
