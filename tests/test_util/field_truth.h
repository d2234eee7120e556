// The obvious answer of the field method: every element by itself, in double.
#pragma once

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "palpate/contact/contact.h"
#include "src/contact/internal/ball_cut.h"
#include "src/contact/internal/field_elements.h"
#include "src/field/internal/field_point.h"
#include "tests/test_util/ball_truth.h"

namespace palpate::test {

/// The longest gradient that a force follows.
inline constexpr double kLongest = 1.05;

/// An element of a tool and what a field says to it.
struct ElementTruth {
  Vec3d lever;  ///< from the center of mass, in W
  double radius = 0, factor = 0;
  bool is_counted = false;
  double phi = 0;
  Vec3d gradient;
  bool has_value = true;  ///< false: it does not touch
  bool is_unseen = false;
  double volume = 0, potential = 0;  ///< what it counts
  double push = 0;                   ///< volume that the force is of
  std::size_t cluster = 0;
};

/// Makes clusters that lie deep one ball each, by shares: their volume at their centroid, with the
/// mean radius of their elements. Tools of fewer than 128 clusters have none.
template <class Sample>
void join_deep_clusters(const Tool& tool, int first_ball, const Pose& X_WT, const Sample& sample,
                        std::vector<ElementTruth>& elements) {
  const std::size_t num = elements.size();
  if (first_ball < 128) return;
  for (std::size_t begin = 0, end = 0; begin < num; begin = end) {
    while (end < num && elements[end].cluster == elements[begin].cluster) ++end;
    if (elements[begin].cluster >= static_cast<std::size_t>(first_ball)) break;
    const std::span<ElementTruth> cluster{&elements[begin], end - begin};
    ElementTruth ball;
    double all = 0, radii = 0, deep = 0, potential = 0;
    const auto whole = [](const ElementTruth& e) { return e.factor * sphere_volume(e.radius); };
    for (const ElementTruth& e : cluster) {
      all += whole(e);
      ball.lever += whole(e) * e.lever;
      potential += e.potential;
    }
    if (!(all > 0)) continue;
    ball.lever *= 1 / all;
    for (const ElementTruth& e : cluster) {
      const double r = e.radius, away = norm(e.lever - ball.lever);
      radii += whole(e) * r;
      deep = std::max(deep, away + 1.6 * 0.7 * r);
    }
    ball.radius = radii / all;
    ball.cluster = cluster.front().cluster;
    sample(ball, X_WT * tool.sphere_mass().center_of_mass + ball.lever, ball.radius);
    const double x = (-ball.phi - deep) / deep;
    if (!ball.has_value || !(x > 0)) continue;
    const double share = x < 1 ? x * x * (3 - 2 * x) : 1;
    const double by_phi = x < 1 ? -6 * x * (1 - x) / deep : 0;
    ball.volume = share * all;
    ball.factor = ball.volume / sphere_volume(ball.radius);
    ball.potential = -share * all * ball.phi;
    ball.push = ball.volume + by_phi * (all * ball.phi + potential);
    for (ElementTruth& e : cluster) {
      for (double ElementTruth::*number : {&ElementTruth::volume, &ElementTruth::potential,
                                           &ElementTruth::push, &ElementTruth::factor}) {
        e.*number *= 1 - share;
      }
    }
    elements.push_back(ball);
  }
}

/// All elements of a tool at a pose, without padding; sample(element, p_W, extent) fills in what
/// the field says, where values up to `extent` count; then come the balls of clusters that lie
/// deep.
template <class Sample>
std::vector<ElementTruth> elements_truth(const Tool& tool, const FieldElements& elements,
                                         const Pose& X_WT, const Sample& sample,
                                         bool joins = true) {
  std::vector<ElementTruth> all;
  const SphereClusters& at = elements.clusters;
  const auto first_part = static_cast<std::size_t>(elements.first_ball()) * SphereClusters::kSize;
  for (std::size_t i = 0; i < elements.factor.size(); ++i) {
    if (at.sphere_id[i] < 0) continue;
    ElementTruth e;
    e.lever = rotate(X_WT.rotation, to_double(Vec3f{at.x[i], at.y[i], at.z[i]}));
    e.radius = elements.radius[i];
    e.factor = elements.factor[i];
    e.is_counted = elements.counted[i] > 0;
    sample(e, X_WT * tool.sphere_mass().center_of_mass + e.lever,
           i >= first_part && i % SphereClusters::kSize < 30 ? double{kPartExtent} * e.radius
                                                             : e.radius);
    if (e.has_value) {
      e.volume = e.factor * cap_volume(e.radius, e.phi);
      e.potential = e.factor * cap_potential(e.radius, e.phi);
    }
    e.cluster = i / SphereClusters::kSize;
    e.push = e.volume;
    all.push_back(e);
    // The parts of a ball, and the ball itself behind them.
    if (i < first_part || i % SphereClusters::kSize != 30) continue;
    const auto parts = all.end() - 31;
    const double R = e.radius, count = elements.ball_factor[i / SphereClusters::kSize] * R * R * R;
    if (!std::all_of(parts, parts + 31, [](const ElementTruth& part) { return part.has_value; })) {
      continue;
    }
    BallValues values;
    for (std::size_t k = 0; k < 30; ++k) values[k] = parts[static_cast<long>(k)].phi / R;
    const BallValues volumes = ball_corrections(values);
    parts->potential += count * R * ball_correction(values);
    for (std::size_t k = 0; k < 30; ++k) {
      ElementTruth& part = parts[static_cast<long>(k)];
      part.volume += count * volumes[k];
      part.push = part.volume;
    }
  }
  if (joins) join_deep_clusters(tool, elements.first_ball(), X_WT, sample, all);
  return all;
}

/// Their sum.
inline Penetration sum_of(const std::vector<ElementTruth>& elements, double longest) {
  Penetration sum;
  for (const ElementTruth& e : elements) {
    sum.volume += e.volume;
    sum.potential += e.potential;
    const Vec3d force = e.push / std::max(norm(e.gradient) / longest, 1.0) * e.gradient;
    sum.measure_W.force += force;
    sum.measure_W.torque += cross(e.lever, force);
    sum.num_inside_spheres += e.has_value && e.is_counted && e.phi <= -e.radius;
    sum.num_boundary_spheres +=
        e.has_value && e.is_counted && e.phi > -e.radius && e.phi < e.radius;
    if (e.is_unseen) sum.unseen_volume += e.factor * sphere_volume(e.radius);
  }
  // No force without volume, and none longer than the bound.
  const double most = std::max(longest * sum.volume, 0.0), force = norm(sum.measure_W.force);
  if (force > most) {
    sum.measure_W = {most / force * sum.measure_W.force, most / force * sum.measure_W.torque};
  }
  sum.volume = std::max(sum.volume, 0.0);
  sum.potential = std::max(sum.potential, 0.0);
  return sum;
}

/// Fills in what a depth field says.
inline auto sampling(const DepthFieldView& field) {
  return [&field](ElementTruth& e, const Vec3d& p_C, double extent) {
    const FieldSample<double> at = sample_field(field, p_C, e.radius);
    e.phi = at.phi;
    e.gradient = at.gradient;
    e.has_value = p_C.z > double{kMinDepth};
    if (extent == e.radius) return;
    // The lesser one of it and what is free, rounded.
    const double corner = 0.25 * e.radius, free = extent + corner;
    const double limit = std::max(2 * e.radius + 0.003 + 0.2 * e.radius, free);
    const double over = std::clamp((at.phi - limit + corner) / (2 * corner), 0.0, 1.0);
    e.phi = over < 1 ? at.phi - corner * over * over : limit;
    e.gradient = (1 - over) * at.gradient;
  };
}

/// U = sum f G(phi) and its parts by their definition.
inline Penetration field_truth(const Tool& tool, const DepthFieldView& field, const Pose& X_WT,
                               SphereVolumes volumes, double longest = kLongest) {
  const FieldElements elements(tool, volumes);
  return sum_of(elements_truth(tool, elements, X_WT, sampling(field)), longest);
}

}  // namespace palpate::test
