// The plane donors (boundary spheres), and the plane that one sphere gets from them. Shared by host
// and device.
#pragma once

#include <cmath>
#include <cstdint>

#include "palpate/contact/contact.h"
#include "src/contact/points/edges/edge_pieces.h"

namespace palpate { inline namespace v0 {

struct Donor {
  std::int32_t sphere_id = -1;  ///< -1: no donor
  Plane<double> plane_T;
  DonorPoint point;
  double weight = 0;    ///< points inside, or the sum of their kernel weights: priority `count`
  double presence = 1;  ///< 0 for a sphere that a point is about to enter; see Continuity
};

/// Volume V_s and force V_s n_s of a sphere.
struct Assigned {
  double volume = 0;
  Vec3d force;
};

/// A Gaussian weight is e^-40 at least, and a cosine 0.001: a sphere far from all donors, or in
/// front of them, still has one.
inline constexpr double kMaxExponent = 40, kMinCosine = 1e-3;
inline constexpr double kDoublings = 1.4426950408889634;  // 1 / ln 2

/// A priority with the data that it needs of the tool.
struct PriorityRule {
  Priority by = Priority::distance;
  double per_square = 0;         ///< gaussian: 1 / 2 s^2, in 1/m2
  const float* paths = nullptr;  ///< path: PathLengths, a row of num_spheres for each sphere
  std::int32_t num_spheres = 0;

  /// True if the best donor does not follow from the distance or from the number of points: then
  /// all are compared for each sphere.
  PALPATE_HOSTDEV bool compares_all(bool average) const {
    return by == Priority::path || (by == Priority::agreement && !average);
  }
  /// Weight of a donor with this Donor::weight and normal for a sphere; `d` is the vector from the
  /// sphere's center to the donor's.
  PALPATE_HOSTDEV double weight(double count, const Vec3d& normal, std::int32_t donor_id,
                                std::int32_t sphere_id, const Vec3d& d) const {
    switch (by) {
      case Priority::count: return count;
      case Priority::square: return 1.0 / dot(d, d);
      case Priority::gaussian: {
        const double exponent = per_square * dot(d, d);
        return std::exp(-(exponent < kMaxExponent ? exponent : kMaxExponent));
      }
      case Priority::agreement: {
        const double cosine = dot(normal, d) / norm(d);
        return (cosine > kMinCosine ? cosine : kMinCosine) / norm(d);
      }
      case Priority::path:
        return 1.0 / static_cast<double>(
                         paths[static_cast<std::int64_t>(donor_id) * num_spheres + sphere_id]);
      case Priority::distance: break;
    }
    return 1.0 / norm(d);
  }
};

/// Rule by which a sphere takes from donors.
struct AssignmentRule {
  bool average = false;  ///< over all donors; otherwise from the best one
  PriorityRule priority;
  const EdgesView* edges = nullptr;  ///< null: there are none
};

/// Running average over donors.
struct DonorAverage {
  double weights = 0;
  Assigned sum;

  PALPATE_HOSTDEV void add(double weight, const Assigned& part) {
    weights += weight;
    sum.volume += weight * part.volume;
    sum.force += weight * part.force;
  }
  PALPATE_HOSTDEV Assigned value() const {
    if (!(weights > 0)) return {};
    return {sum.volume / weights, sum.force / weights};
  }
};

/// The best donors for a sphere, best first; ties to the lowest index.
struct DonorChoices {
  static constexpr int kMaxDonors = 4;
  double cost[kMaxDonors] = {1e300, 1e300, 1e300, 1e300};
  std::int32_t donor[kMaxDonors] = {-1, -1, -1, -1};

  /// Call with ascending `l`.
  PALPATE_HOSTDEV void offer(double its_cost, std::int32_t l) {
    if (!(its_cost < cost[kMaxDonors - 1])) return;
    // Inserts from the end, behind equally good ones.
    for (int slot = kMaxDonors - 1; slot > 0; --slot) {
      if (!(its_cost < cost[slot - 1])) {
        cost[slot] = its_cost;
        donor[slot] = l;
        return;
      }
      cost[slot] = cost[slot - 1];
      donor[slot] = donor[slot - 1];
    }
    cost[0] = its_cost;
    donor[0] = l;
  }
};

/// Ascending by sphere id; not owning.
struct DonorsView {
  const Sphere* spheres = nullptr;
  const Donor* donors = nullptr;
  std::int32_t num = 0;

  /// Returns the share that one donor gives to a sphere.
  PALPATE_HOSTDEV Assigned assign_from(const Donor& donor, std::int32_t sphere_id,
                                       const AssignmentRule& rule) const {
    const Sphere& sphere = spheres[sphere_id];
    const Plane<double>& plane = donor.plane_T;
    const double volume =
        rule.edges != nullptr
            ? rule.edges->volume(sphere_id, plane, donor.point)
            : cap_volume(static_cast<double>(sphere.radius),
                         dot(plane.normal, to_double(sphere.center)) - plane.offset);
    return {volume, volume * plane.normal};
  }

  /// Returns the share that all donors but the sphere itself give to it. The best one covers those
  /// behind it, but only as far as it is present: up to four are composited, nearest first. So a
  /// donor that appears or vanishes changes nothing suddenly.
  PALPATE_HOSTDEV Assigned assign(std::int32_t sphere_id, const AssignmentRule& rule) const {
    if (rule.edges != nullptr && rule.edges->cuts_off(sphere_id)) return {};
    if (rule.average) {
      DonorAverage average;
      for (std::int32_t l = 0; l < num; ++l) add_to(average, l, sphere_id, rule);
      return average.value();
    }
    return composite(choose(sphere_id, rule), sphere_id, rule);
  }
  PALPATE_HOSTDEV DonorChoices choose(std::int32_t sphere_id, const AssignmentRule& rule) const {
    DonorChoices best;
    for (std::int32_t l = 0; l < num; ++l) offer_to(best, l, sphere_id, rule);
    return best;
  }

  // The steps of `assign`, for threads that share the donors.
  PALPATE_HOSTDEV void add_to(DonorAverage& average, std::int32_t l, std::int32_t sphere_id,
                              const AssignmentRule& rule) const {
    const Donor& donor = donors[l];
    if (!may_donate(donor, sphere_id)) return;
    average.add(donor.presence * weight(donor, sphere_id, rule),
                assign_from(donor, sphere_id, rule));
  }
  PALPATE_HOSTDEV void offer_to(DonorChoices& best, std::int32_t l, std::int32_t sphere_id,
                                const AssignmentRule& rule) const {
    const Donor& donor = donors[l];
    if (!may_donate(donor, sphere_id)) return;
    const Vec3d d = between(donor, sphere_id);
    const bool by_weight =
        rule.priority.by == Priority::count || rule.priority.compares_all(rule.average);
    best.offer(by_weight ? -weight(donor, sphere_id, rule) : dot(d, d), l);
  }
  PALPATE_HOSTDEV Assigned composite(const DonorChoices& best, std::int32_t sphere_id,
                                     const AssignmentRule& rule) const {
    DonorAverage sum;
    double uncovered = 1;
    for (const std::int32_t l : best.donor) {
      if (l < 0) break;
      const double weight = uncovered * donors[l].presence;
      sum.add(weight, assign_from(donors[l], sphere_id, rule));
      uncovered -= weight;
    }
    return sum.value();
  }

 private:
  PALPATE_HOSTDEV double weight(const Donor& donor, std::int32_t sphere_id,
                                const AssignmentRule& rule) const {
    return rule.priority.weight(donor.weight, donor.plane_T.normal, donor.sphere_id, sphere_id,
                                between(donor, sphere_id));
  }
  PALPATE_HOSTDEV bool may_donate(const Donor& donor, std::int32_t sphere_id) const {
    return donor.sphere_id >= 0 && donor.sphere_id != sphere_id;
  }
  PALPATE_HOSTDEV Vec3d between(const Donor& donor, std::int32_t sphere_id) const {
    return to_double(spheres[donor.sphere_id].center) - to_double(spheres[sphere_id].center);
  }
};

}}  // namespace palpate::v0
