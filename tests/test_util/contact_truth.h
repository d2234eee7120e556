// The obvious answer to a contact query: every point against every sphere, every sphere against
// every boundary sphere, all in double, in the world frame. Shares no code with the library's
// query but the volume of a ball cut by two planes (two_plane_cut.h), which has tests of its own.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "palpate/cloud/point_cloud.h"
#include "palpate/contact/contact.h"
#include "src/math/internal/two_plane_cut.h"

namespace palpate::test {

struct Truth {
  Penetration penetration;
  std::vector<SphereState> states;
};

/// Results of the points for each sphere: the same for every method.
struct BoundaryTruth {
  struct Donor {
    Vec3d p, n;
    bool valid = false;
    double count = 0;     ///< points, or their weights
    double presence = 1;  ///< see Continuity
  };
  std::vector<Vec3d> c_W;
  std::vector<int> count;
  std::vector<Donor> plane;
  std::vector<std::size_t> boundary;  ///< spheres with a plane, ascending
  struct Edge {
    Vec3d p, n;
  };
  std::vector<Edge> edges;
  int num_points = 0, num_boundary_spheres = 0;
};

inline double true_cap(double r, double d) {
  if (d >= r) return 0;
  if (d <= -r) return 4.0 / 3.0 * M_PI * r * r * r;
  const double h = r - d;
  return M_PI / 3.0 * h * h * (3 * r - h);
}

/// Depth-change vector of a point, also across up to 63 missing pixels in its row or column where
/// something farther away lies behind them.
inline Vec3d change_at(const PointCloudView& cloud, std::size_t i) {
  const Vec3d known{cloud.edge_x[i], cloud.edge_y[i], cloud.edge_z[i]};
  if (norm(known) > 0 || std::isnan(cloud.z[i])) return known;
  const int u = static_cast<int>(i) % cloud.width, v = static_cast<int>(i) / cloud.width;
  Vec3d l;
  for (const auto& [du, dv] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
    for (int n = 1; n <= 64; ++n) {
      const int x = u + n * du, y = v + n * dv;
      if (x < 0 || y < 0 || x >= cloud.width || y >= cloud.height) break;
      const float z = cloud.z[static_cast<std::size_t>(y * cloud.width + x)];
      if (std::isnan(z)) continue;
      const double more =
          n == 1 ? 0 : static_cast<double>(z) - static_cast<double>(cloud.z[i]) - 0.05;
      l += std::max(more, 0.0) * Vec3d{static_cast<double>(du), static_cast<double>(dv), 0};
      break;
    }
  }
  const Vec3d ray = normalized(Vec3d{cloud.x[i], cloud.y[i], cloud.z[i]});
  return l - dot(l, ray) * ray;
}

/// The mean edge point around pixel i and the unit mean of the depth-change vectors there: over
/// the edge points of a square of 9 x 9 pixels that are as deep and look in about the direction.
inline std::pair<Vec3d, Vec3d> contour_at(const PointCloudView& cloud, std::size_t i) {
  const int width = cloud.width, u = static_cast<int>(i) % width, v = static_cast<int>(i) / width;
  const auto change = [&](std::size_t q) { return change_at(cloud, q); };
  Vec3d p, l;
  int count = 0;
  for (int y = v - 4; y <= v + 4; ++y) {
    for (int x = u - 4; x <= u + 4; ++x) {
      if (x < 0 || y < 0 || x >= width || y >= cloud.height) continue;
      const auto q = static_cast<std::size_t>(y * width + x);
      if (dot(change(q), change(i)) <= 0 || !(std::abs(cloud.z[q] - cloud.z[i]) < 0.02f)) continue;
      p += Vec3d{cloud.x[q], cloud.y[q], cloud.z[q]};
      l += change(q);
      ++count;
    }
  }
  return {p / count, normalized(l)};
}

/// Edge planes (eq. 3.17 corrected) of one sphere from the contour at its points: one for each side
/// of the image that they look to.
inline void add_edges(const std::vector<std::pair<Vec3d, Vec3d>>& contour,
                      std::vector<BoundaryTruth::Edge>& edges) {
  struct Side {
    Vec3d p, l;
    int count = 0;
  };
  Side sides[4];  // right, left, down, up
  for (const auto& [p, l] : contour) {
    Side& side = sides[std::abs(l.x) >= std::abs(l.y) ? (l.x > 0 ? 0 : 1) : (l.y > 0 ? 2 : 3)];
    side.p += p;
    side.l += l;
    ++side.count;
  }
  for (const Side& side : sides) {
    if (side.count == 0) continue;
    const Vec3d p = side.p / side.count, v = normalized(p);
    edges.push_back({p, normalized(side.l - dot(side.l, v) * v)});
  }
}

/// Boundary spheres, their planes (Alg. 3.2, eq. 3.3) and edges.
inline BoundaryTruth boundary_truth(const std::vector<Sphere>& spheres, const PointCloudView& cloud,
                                    const Pose& X_WT, Continuity continuity = Continuity::none) {
  const bool in_planes = continuity == Continuity::kernel || continuity == Continuity::both;
  const bool fades_in = continuity == Continuity::entry || continuity == Continuity::both;
  const std::size_t n = spheres.size();
  BoundaryTruth truth;
  truth.count.assign(n, 0);
  truth.plane.resize(n);
  double reach = 0;
  for (const Sphere& s : spheres) {
    truth.c_W.push_back(X_WT * to_double(s.center));
    reach = std::max(reach, norm(to_double(s.center)) + static_cast<double>(s.radius));
  }
  std::vector<Vec3d> p_sum(n), n_sum(n);
  std::vector<double> kernel_sum(n), divisor(n);
  std::vector<std::vector<std::pair<Vec3d, Vec3d>>> contour(n);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3d p{cloud.x[i], cloud.y[i], cloud.z[i]};
    if (!(norm(p - X_WT.translation) < reach * 1.001)) continue;  // far away, or NaN
    for (std::size_t s = 0; s < n; ++s) {
      const Vec3d d = p - truth.c_W[s];
      const double r = spheres[s].radius;
      if (dot(d, d) <= r * r) {
        ++truth.count[s];
        const double weight = std::pow(1 - dot(d, d) / (r * r), 2), factor = in_planes ? weight : 1;
        p_sum[s] += factor * p;
        n_sum[s] += factor * Vec3d{cloud.nx[i], cloud.ny[i], cloud.nz[i]};
        kernel_sum[s] += weight;
        divisor[s] += factor;
        ++truth.num_points;
        if (cloud.edge_x == nullptr) continue;
        if (norm(change_at(cloud, i)) <= 0.005) continue;
        contour[s].push_back(contour_at(cloud, i));
      }
    }
  }
  for (std::size_t s = 0; s < n; ++s) {
    if (truth.count[s] == 0) continue;
    ++truth.num_boundary_spheres;
    add_edges(contour[s], truth.edges);
    if (in_planes && divisor[s] <= 1e-6) continue;
    const Vec3d mean_normal = n_sum[s] / divisor[s];
    if (norm(mean_normal) > 1e-6) {
      const double presence = fades_in ? kernel_sum[s] / (kernel_sum[s] + 0.25) : 1;
      truth.plane[s] = {p_sum[s] / divisor[s], normalized(mean_normal), true, divisor[s], presence};
      truth.boundary.push_back(s);
    }
  }
  return truth;
}

/// Data of a tool.
struct ToolTruth {
  std::vector<Sphere> spheres;
  std::vector<std::pair<int, int>> edges;  ///< of the leaf graph, each once
  Vec3d center_T;                          ///< of mass of the spheres
  std::vector<float> represented;          ///< volumes
  double gaussian_width = 0;               ///< a twelfth of the longest side
  /// Lengths of paths along the leaf graph, from every sphere to every other; filled on first use.
  mutable std::vector<std::vector<double>> ways;

  explicit ToolTruth(const Tool& tool)
      : spheres(tool.spheres().begin(), tool.spheres().end()),
        edges(tool.graph().edges()),
        center_T(tool.sphere_mass().center_of_mass),
        represented(tool.represented_volumes().begin(), tool.represented_volumes().end()) {
    for (int axis = 0; axis < 3; ++axis) {
      double low = 1e300, high = -1e300;
      for (const Sphere& s : spheres) {
        low = std::min(low, static_cast<double>(s.center[axis]) - static_cast<double>(s.radius));
        high = std::max(high, static_cast<double>(s.center[axis]) + static_cast<double>(s.radius));
      }
      gaussian_width = std::max(gaussian_width, (high - low) / 12);
    }
  }

  /// Over every sphere in turn (Floyd and Warshall).
  void find_ways() const {
    const std::size_t n = spheres.size();
    ways.assign(n, std::vector<double>(n, 1e9));
    for (std::size_t i = 0; i < n; ++i) ways[i][i] = 0;
    for (const auto& [a, b] : edges) {
      const auto i = static_cast<std::size_t>(a), j = static_cast<std::size_t>(b);
      ways[i][j] = ways[j][i] = norm(to_double(spheres[i].center) - to_double(spheres[j].center));
    }
    for (std::size_t k = 0; k < n; ++k) {
      for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t j = 0; j < n; ++j) {
          ways[i][j] = std::min(ways[i][j], ways[i][k] + ways[k][j]);
        }
      }
    }
  }

  /// Computes the priority of donor b, its normal given in the tool frame, for sphere s.
  double priority(Priority by, std::size_t s, std::size_t b, double count,
                  const Vec3d& normal_T) const {
    const Vec3d d = to_double(spheres[b].center) - to_double(spheres[s].center);
    const double square = dot(d, d), sigma = gaussian_width;
    switch (by) {
      case Priority::distance: return 1 / std::sqrt(square);
      case Priority::count: return count;
      case Priority::square: return 1 / square;
      case Priority::gaussian: return std::exp(-std::min(40.0, square / (2 * sigma * sigma)));
      case Priority::agreement:
        return std::max(0.001, dot(normal_T, d) / std::sqrt(square)) / std::sqrt(square);
      case Priority::path:
        if (ways.empty()) find_ways();
        return 1 / ways[s][b];
    }
    return 0;
  }
};

inline Truth contact_truth(const ToolTruth& tool, const BoundaryTruth& touched, const Pose& X_WT,
                           const ContactOptions& options) {
  const std::vector<Sphere>& spheres = tool.spheres;
  const std::size_t n = spheres.size();
  const std::vector<Vec3d>& c_W = touched.c_W;
  const std::vector<int>& count = touched.count;
  const std::vector<BoundaryTruth::Donor>& plane = touched.plane;
  const std::vector<std::size_t>& boundary = touched.boundary;
  using Donor = BoundaryTruth::Donor;
  const Vec3d C_W = X_WT * tool.center_T;
  Truth truth;
  truth.penetration.num_points = touched.num_points;
  truth.penetration.num_boundary_spheres = touched.num_boundary_spheres;
  truth.states.assign(n, SphereState::outside);
  for (std::size_t s = 0; s < n; ++s) {
    if (count[s] > 0) truth.states[s] = SphereState::boundary;
  }
  // Factor of V_s.
  const auto scale = [&](std::size_t s) {
    return options.counted() == SphereVolumes::own
               ? 1.0
               : tool.represented[s] / true_cap(spheres[s].radius, -1e9);
  };
  // The edge that is nearest in the image, if edges matter.
  const auto edge_of = [&](std::size_t s) -> const BoundaryTruth::Edge* {
    if (options.edges == Edges::none || c_W[s].z <= 0) return nullptr;
    const BoundaryTruth::Edge* nearest = nullptr;
    double least = 1e300;
    for (const BoundaryTruth::Edge& edge : touched.edges) {
      const double du = edge.p.x / edge.p.z - c_W[s].x / c_W[s].z;
      const double dv = edge.p.y / edge.p.z - c_W[s].y / c_W[s].z;
      if (du * du + dv * dv < least) least = du * du + dv * dv, nearest = &edge;
    }
    return nearest;
  };
  // An edge leaves the planes of what lies beyond it alone.
  const auto matters_to = [&](const BoundaryTruth::Edge& edge, const Donor& donor) {
    return dot(edge.n, donor.p - edge.p) <= 0 || norm(donor.p) <= norm(edge.p) + 0.02;
  };
  const auto is_beyond = [&](std::size_t s, const Donor& donor) {
    const BoundaryTruth::Edge* edge = edge_of(s);
    if (edge == nullptr || !matters_to(*edge, donor)) return false;
    const double r = spheres[s].radius;
    const double margin = options.edges == Edges::center ? 0 : options.edges == Edges::cut ? r : -r;
    return dot(edge->n, c_W[s] - edge->p) >= margin;
  };
  // Signed distance of the center from the edge that cuts the sphere, far behind it if none does.
  const auto edge_distance = [&](std::size_t s, const Donor& donor) {
    const BoundaryTruth::Edge* edge = edge_of(s);
    if (options.edges != Edges::cut || edge == nullptr || !matters_to(*edge, donor)) return -1e9;
    return dot(edge->n, c_W[s] - edge->p);
  };
  const auto volume_behind = [&](std::size_t s, const Donor& donor) {
    // A boundary sphere's own plane is not taken.
    if (&donor != &plane[s] && is_beyond(s, donor)) return 0.0;
    const double r = spheres[s].radius, d = dot(donor.n, c_W[s] - donor.p);
    const double e = edge_distance(s, donor);
    const double cosine = e > -r ? dot(donor.n, edge_of(s)->n) : 0;
    return scale(s) * (e > -r ? two_plane_cut(r, d, e, cosine).volume : true_cap(r, d));
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
  const bool fades_in =
      options.continuity == Continuity::entry || options.continuity == Continuity::both;
  // Assigns to s the planes of all boundary spheres but s itself.
  const auto assigned = [&](std::size_t s) {
    struct Offer {
      double priority, presence;
      std::size_t from;
    };
    std::vector<Offer> offers;
    for (std::size_t b : boundary) {
      if (b == s) continue;
      // The best one of a Gaussian is the nearest, also where its weights are all as small.
      const bool picks_nearest =
          options.method != MethodKind::weighted && options.priority == Priority::gaussian;
      offers.push_back({tool.priority(picks_nearest ? Priority::distance : options.priority, s, b,
                                      plane[b].count, rotate(conjugate(X_WT.rotation), plane[b].n)),
                        plane[b].presence, b});
    }
    if (options.method != MethodKind::weighted) {
      // The best four, each as far as those before it leave it visible.
      std::sort(offers.begin(), offers.end(), [](const Offer& a, const Offer& b) {
        return a.priority != b.priority ? a.priority > b.priority : a.from < b.from;
      });
      if (offers.size() > 4) offers.resize(4);
      double visible = 1;
      for (Offer& offer : offers) {
        offer.priority = visible;
        visible *= 1 - offer.presence;
      }
    }
    double weights = 0, volume = 0;
    Vec3d force;
    for (const Offer& offer : offers) {
      const double weight = offer.priority * offer.presence;
      const double V = volume_behind(s, plane[offer.from]);
      weights += weight;
      volume += weight * V;
      force += weight * V * plane[offer.from].n;
    }
    if (weights == 0) return std::pair<double, Vec3d>{};
    return std::pair{volume / weights, force / weights};
  };
  for (std::size_t s = 0; s < n; ++s) {
    if (count[s] == 0) continue;
    double volume = plane[s].valid ? volume_behind(s, plane[s]) : 0;
    Vec3d force = volume * plane[s].n;
    if (fades_in) {
      const double presence = plane[s].valid ? plane[s].presence : 0;
      const auto [state_volume, state_force] = assigned(s);
      volume = presence * volume + (1 - presence) * state_volume;
      force = presence * force + (1 - presence) * state_force;
    }
    add(s, volume, force);
  }
  if (boundary.empty()) return truth;

  if (options.method == MethodKind::graph) {
    // Rounds of the corrected Algs. 3.5/3.6.
    std::vector<std::vector<std::size_t>> neighbors(n);
    for (const auto& [a, b] : tool.edges) {
      neighbors[static_cast<std::size_t>(a)].push_back(static_cast<std::size_t>(b));
      neighbors[static_cast<std::size_t>(b)].push_back(static_cast<std::size_t>(a));
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
        for (std::size_t i : neighbors[j]) {
          if (label[i].round != round - 1) continue;
          const Donor& donor = plane[label[i].reference];
          if (!donor.valid) continue;
          const Vec3d n_T = rotate(conjugate(X_WT.rotation), donor.n);
          const Vec3d step = to_double(spheres[j].center) - to_double(spheres[i].center);
          if (!(dot(step, n_T) < 0) || is_beyond(j, donor)) continue;
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
      const Donor& donor = plane[label[s].reference];
      const double volume = options.inside == InsideVolume::full
                                ? scale(s) * true_cap(spheres[s].radius, edge_distance(s, donor))
                                : volume_behind(s, donor);
      add(s, volume, volume * donor.n);
    }
    return truth;
  }

  for (std::size_t s = 0; s < n; ++s) {
    if (count[s] > 0) continue;
    const auto [volume, force] = assigned(s);
    add(s, volume, force);
  }
  return truth;
}

}  // namespace palpate::test
