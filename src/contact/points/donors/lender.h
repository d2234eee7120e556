// What a boundary sphere lends, and what one sphere gets from all of them. One text for host and
// device.
#pragma once

#include <cstdint>

#include "src/contact/points/edges/edge_pieces.h"

namespace palpate {

struct Lender {
  std::int32_t sphere_id = -1;  ///< -1: lends nothing
  Plane<double> plane_T;
  LenderPoint point;
  double weight = 0;    ///< points inside, or the sum of their kernel weights: priority `count`
  double presence = 1;  ///< 0 for a sphere that a point is about to enter; see Continuity
};

/// V_s and V_s n_s.
struct Borrowed {
  double volume = 0;
  Vec3d force;
};

/// How a sphere borrows.
struct BorrowRule {
  bool average = false;  ///< over all lenders; otherwise from the best one
  bool by_count = false;
  const EdgesView* edges = nullptr;  ///< null: there are none
};

/// An average of what lenders give, in the making.
struct LenderAverage {
  double weights = 0;
  Borrowed sum;

  PALPATE_HOSTDEV void add(double weight, const Borrowed& part) {
    weights += weight;
    sum.volume += weight * part.volume;
    sum.force += weight * part.force;
  }
  PALPATE_HOSTDEV Borrowed value() const {
    if (!(weights > 0)) return {};
    return {sum.volume / weights, sum.force / weights};
  }
};

/// The best lenders for a sphere, best first; ties to the lowest index.
struct LenderChoices {
  static constexpr int kMost = 4;
  double badness[kMost] = {1e300, 1e300, 1e300, 1e300};
  std::int32_t lender[kMost] = {-1, -1, -1, -1};

  /// To be called with ascending `l`.
  PALPATE_HOSTDEV void offer(double its_badness, std::int32_t l) {
    if (!(its_badness < badness[kMost - 1])) return;
    // Up from the end, to behind those that are as good.
    for (int place = kMost - 1; place > 0; --place) {
      if (!(its_badness < badness[place - 1])) {
        badness[place] = its_badness;
        lender[place] = l;
        return;
      }
      badness[place] = badness[place - 1];
      lender[place] = lender[place - 1];
    }
    badness[0] = its_badness;
    lender[0] = l;
  }
};

/// Ascending by sphere id; not owning.
struct LendersView {
  const Sphere* spheres = nullptr;
  const Lender* lenders = nullptr;
  std::int32_t num = 0;

  /// What one lender gives to a sphere.
  PALPATE_HOSTDEV Borrowed borrow_from(const Lender& lender, std::int32_t sphere_id,
                                       const BorrowRule& rule) const {
    const Sphere& sphere = spheres[sphere_id];
    const Plane<double>& plane = lender.plane_T;
    const double volume =
        rule.edges != nullptr
            ? rule.edges->volume(sphere_id, plane, lender.point)
            : cap_volume(static_cast<double>(sphere.radius),
                         dot(plane.normal, to_double(sphere.centre)) - plane.offset);
    return {volume, volume * plane.normal};
  }

  /// What all lenders but the sphere itself give to it. The best one covers those behind it, but
  /// only as far as it is present: up to four are laid over each other, nearest first. So a lender
  /// that appears or vanishes changes nothing suddenly.
  PALPATE_HOSTDEV Borrowed borrow(std::int32_t sphere_id, const BorrowRule& rule) const {
    if (rule.edges != nullptr && rule.edges->cuts_off(sphere_id)) return {};
    if (rule.average) {
      LenderAverage average;
      for (std::int32_t l = 0; l < num; ++l) add_to(average, l, sphere_id, rule);
      return average.value();
    }
    LenderChoices best;
    for (std::int32_t l = 0; l < num; ++l) offer_to(best, l, sphere_id, rule);
    return laid_over(best, sphere_id, rule);
  }

  // The steps of `borrow`, for those who share the lenders among them.
  PALPATE_HOSTDEV void add_to(LenderAverage& average, std::int32_t l, std::int32_t sphere_id,
                              const BorrowRule& rule) const {
    const Lender& lender = lenders[l];
    if (!may_lend(lender, sphere_id)) return;
    const double weight =
        lender.presence * (rule.by_count ? lender.weight : 1.0 / norm(between(lender, sphere_id)));
    average.add(weight, borrow_from(lender, sphere_id, rule));
  }
  PALPATE_HOSTDEV void offer_to(LenderChoices& best, std::int32_t l, std::int32_t sphere_id,
                                const BorrowRule& rule) const {
    const Lender& lender = lenders[l];
    if (!may_lend(lender, sphere_id)) return;
    const Vec3d d = between(lender, sphere_id);
    best.offer(rule.by_count ? -lender.weight : dot(d, d), l);
  }
  PALPATE_HOSTDEV Borrowed laid_over(const LenderChoices& best, std::int32_t sphere_id,
                                     const BorrowRule& rule) const {
    LenderAverage sum;
    double uncovered = 1;
    for (const std::int32_t l : best.lender) {
      if (l < 0) break;
      const double weight = uncovered * lenders[l].presence;
      sum.add(weight, borrow_from(lenders[l], sphere_id, rule));
      uncovered -= weight;
    }
    return sum.value();
  }

 private:
  PALPATE_HOSTDEV bool may_lend(const Lender& lender, std::int32_t sphere_id) const {
    return lender.sphere_id >= 0 && lender.sphere_id != sphere_id;
  }
  PALPATE_HOSTDEV Vec3d between(const Lender& lender, std::int32_t sphere_id) const {
    return to_double(spheres[lender.sphere_id].centre) - to_double(spheres[sphere_id].centre);
  }
};

}  // namespace palpate
