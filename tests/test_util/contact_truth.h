// The obvious answer to a contact query: every point against every sphere, every sphere against
// every boundary sphere, all in double, in the world frame. Shares no code with the library's
// query.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "palpate/cloud/point_cloud.h"
#include "palpate/contact/contact_query.h"

namespace palpate::test {

struct Truth {
  Penetration penetration;
  std::vector<SphereState> states;
};

/// What the points say about each sphere: the same for every method.
struct BoundaryTruth {
  struct Lender {
    Vec3d p, n;
    bool valid = false;
  };
  std::vector<Vec3d> c_W;
  std::vector<int> count;
  std::vector<Lender> plane;
  std::vector<std::size_t> boundary;  ///< spheres with a plane, ascending
  int num_points = 0, num_boundary_spheres = 0;
};

inline double true_cap(double r, double d) {
  if (d >= r) return 0;
  if (d <= -r) return 4.0 / 3.0 * M_PI * r * r * r;
  const double h = r - d;
  return M_PI / 3.0 * h * h * (3 * r - h);
}

/// Boundary spheres and their planes (Alg. 3.2, eq. 3.3).
inline BoundaryTruth boundary_truth(const std::vector<Sphere>& spheres, const PointCloudView& cloud,
                                    const Pose& X_WT) {
  const std::size_t n = spheres.size();
  BoundaryTruth truth;
  truth.count.assign(n, 0);
  truth.plane.resize(n);
  double reach = 0;
  for (const Sphere& s : spheres) {
    truth.c_W.push_back(X_WT * to_double(s.centre));
    reach = std::max(reach, norm(to_double(s.centre)) + static_cast<double>(s.radius));
  }
  std::vector<Vec3d> p_sum(n), n_sum(n);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3d p{cloud.x[i], cloud.y[i], cloud.z[i]};
    if (!(norm(p - X_WT.translation) < reach * 1.001)) continue;  // far away, or NaN
    for (std::size_t s = 0; s < n; ++s) {
      const Vec3d d = p - truth.c_W[s];
      const double r = spheres[s].radius;
      if (dot(d, d) <= r * r) {
        ++truth.count[s];
        p_sum[s] += p;
        n_sum[s] += Vec3d{cloud.nx[i], cloud.ny[i], cloud.nz[i]};
        ++truth.num_points;
      }
    }
  }
  for (std::size_t s = 0; s < n; ++s) {
    if (truth.count[s] == 0) continue;
    ++truth.num_boundary_spheres;
    const Vec3d mean_normal = n_sum[s] / truth.count[s];
    if (norm(mean_normal) > 1e-6) {
      truth.plane[s] = {p_sum[s] / truth.count[s], normalized(mean_normal), true};
      truth.boundary.push_back(s);
    }
  }
  return truth;
}

/// `edges` of the leaf graph, each once.
inline Truth contact_truth(const std::vector<Sphere>& spheres,
                           const std::vector<std::pair<int, int>>& edges, const Vec3d& centre_T,
                           const BoundaryTruth& touched, const Pose& X_WT,
                           const ContactOptions& options) {
  const std::size_t n = spheres.size();
  const std::vector<Vec3d>& c_W = touched.c_W;
  const std::vector<int>& count = touched.count;
  const std::vector<BoundaryTruth::Lender>& plane = touched.plane;
  const std::vector<std::size_t>& boundary = touched.boundary;
  using Lender = BoundaryTruth::Lender;
  const Vec3d C_W = X_WT * centre_T;
  Truth truth;
  truth.penetration.num_points = touched.num_points;
  truth.penetration.num_boundary_spheres = touched.num_boundary_spheres;
  truth.states.assign(n, SphereState::outside);
  for (std::size_t s = 0; s < n; ++s) {
    if (count[s] > 0) truth.states[s] = SphereState::boundary;
  }
  const auto volume_behind = [&](std::size_t s, const Lender& lender) {
    return true_cap(spheres[s].radius, dot(lender.n, c_W[s] - lender.p));
  };
  const auto add = [&](std::size_t s, double volume, const Vec3d& force) {
    truth.penetration.volume += volume;
    truth.penetration.measure_W.force += force;
    truth.penetration.measure_W.torque += cross(c_W[s] - C_W, force);
    if (volume > 0 && count[s] == 0) {
      truth.states[s] = SphereState::inside;
      ++truth.penetration.num_inside_spheres;
    }
  };
  for (std::size_t s : boundary)
    add(s, volume_behind(s, plane[s]), volume_behind(s, plane[s]) * plane[s].n);
  if (boundary.empty()) return truth;

  if (options.method == InsideMethod::graph) {
    // Rounds of the corrected Algs. 3.5/3.6.
    std::vector<std::vector<std::size_t>> neighbours(n);
    for (const auto& [a, b] : edges) {
      neighbours[static_cast<std::size_t>(a)].push_back(static_cast<std::size_t>(b));
      neighbours[static_cast<std::size_t>(b)].push_back(static_cast<std::size_t>(a));
    }
    struct Label {
      int round = -1;
      double length = 0;
      std::size_t reference = 0;
    };
    std::vector<Label> label(n);
    for (std::size_t s = 0; s < n; ++s) {
      if (count[s] > 0) label[s] = {0, 0.0, s};
    }
    for (int round = 1;; ++round) {
      bool grew = false;
      for (std::size_t j = 0; j < n; ++j) {
        if (label[j].round >= 0) continue;
        Label best;
        for (std::size_t i : neighbours[j]) {
          if (label[i].round != round - 1) continue;
          const Lender& lender = plane[label[i].reference];
          if (!lender.valid) continue;
          const Vec3d n_T = rotate(conjugate(X_WT.rotation), lender.n);
          const Vec3d step = to_double(spheres[j].centre) - to_double(spheres[i].centre);
          if (!(dot(step, n_T) < 0)) continue;
          const double length = label[i].length + norm(step);
          if (best.round < 0 || length < best.length ||
              (length == best.length && label[i].reference < best.reference)) {
            best = {round, length, label[i].reference};
          }
        }
        if (best.round >= 0) label[j] = best, grew = true;
      }
      if (!grew) break;
    }
    for (std::size_t s = 0; s < n; ++s) {
      if (label[s].round <= 0) continue;
      const Lender& lender = plane[label[s].reference];
      const double volume = options.inside == InsideVolume::full ? true_cap(spheres[s].radius, -1e9)
                                                                 : volume_behind(s, lender);
      add(s, volume, volume * lender.n);
    }
    return truth;
  }

  for (std::size_t s = 0; s < n; ++s) {
    if (count[s] > 0) continue;
    double weight_sum = 0, volume = 0, best = -1;
    Vec3d force;
    for (std::size_t b : boundary) {
      const Vec3d d = to_double(spheres[b].centre) - to_double(spheres[s].centre);
      const double priority = options.priority == Priority::count ? count[b] : 1.0 / norm(d);
      const double V = volume_behind(s, plane[b]);
      if (options.method == InsideMethod::weighted) {
        weight_sum += priority;
        volume += priority * V;
        force += priority * V * plane[b].n;
      } else if (priority > best) {
        best = priority;
        weight_sum = 1;
        volume = V;
        force = V * plane[b].n;
      }
    }
    add(s, volume / weight_sum, force / weight_sum);
  }
  return truth;
}

}  // namespace palpate::test
