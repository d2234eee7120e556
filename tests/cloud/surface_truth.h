// The definitions of surface estimation written down once more, in double, pixel by pixel. Shares
// no code with the library. Input depth is NaN where there is no measurement.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "palpate/cloud/surface_estimator.h"

namespace palpate::test {

/// Read access with "no measurement" all around.
struct TrueDepth {
  std::span<const float> pixels;
  int width, height;

  double operator()(int u, int v) const {
    if (u < 0 || v < 0 || u >= width || v >= height) return NAN;
    return pixels[static_cast<std::size_t>(v * width + u)];
  }
};

/// Eq. 3.12 corrected.
inline double true_filtered(const TrueDepth& depth, const DepthFilterOptions& options, int u,
                            int v) {
  const double z_p = depth(u, v);
  const double s = options.sigma_depth * z_p * z_p;
  double sum = 0, sum_weights = 0;
  for (int dv = -options.radius; dv <= options.radius; ++dv) {
    for (int du = -options.radius; du <= options.radius; ++du) {
      const double z_q = depth(u + du, v + dv);
      if (!(z_q > 0)) continue;
      const double w =
          std::exp(-(du * du + dv * dv) / (2 * options.sigma_space * options.sigma_space)) *
          std::exp(-(z_q - z_p) * (z_q - z_p) / (2 * s * s));
      sum += w * z_q;
      sum_weights += w;
    }
  }
  return sum / sum_weights;
}

/// Between two opposite neighbors and on neither: SurfaceOptions::flying_pixel_gap.
inline bool true_flying(const TrueDepth& depth, double gap, int u, int v) {
  const double z = depth(u, v);
  for (const auto& [du, dv] : {std::pair(1, 0), {0, 1}, {1, 1}, {1, -1}}) {
    const double a = depth(u + du, v + dv), b = depth(u - du, v - dv);
    if (!(a > 0 && b > 0)) continue;
    if (z - std::min(a, b) > gap * z && std::max(a, b) - z > gap * z) return true;
  }
  return false;
}

struct TrueNormal {
  bool exists = false;
  bool well_conditioned = false;  ///< the plane is clear: neither near to a ball nor to a line
  Vec3d n;
};

/// Eigenvalues ascending with eigenvectors of a symmetric matrix, by Jacobi rotations.
inline void eigen_decomposition(double a[3][3], std::array<double, 3>& values, Vec3d vectors[3]) {
  double v[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  for (int sweep = 0; sweep < 60; ++sweep) {
    for (int p = 0; p < 2; ++p) {
      for (int q = p + 1; q < 3; ++q) {
        if (a[p][q] == 0) continue;
        const double theta = 0.5 * std::atan2(2 * a[p][q], a[q][q] - a[p][p]);
        const double c = std::cos(theta), s = std::sin(theta);
        for (int k = 0; k < 3; ++k) {
          const double x = a[k][p], y = a[k][q];
          a[k][p] = c * x - s * y;
          a[k][q] = s * x + c * y;
        }
        for (int k = 0; k < 3; ++k) {
          const double x = a[p][k], y = a[q][k];
          a[p][k] = c * x - s * y;
          a[q][k] = s * x + c * y;
        }
        for (int k = 0; k < 3; ++k) {
          const double x = v[k][p], y = v[k][q];
          v[k][p] = c * x - s * y;
          v[k][q] = s * x + c * y;
        }
      }
    }
  }
  int order[3] = {0, 1, 2};
  for (int i : {0, 1, 0}) {
    if (a[order[i]][order[i]] > a[order[i + 1]][order[i + 1]]) std::swap(order[i], order[i + 1]);
  }
  for (int i = 0; i < 3; ++i) {
    values[static_cast<std::size_t>(i)] = a[order[i]][order[i]];
    vectors[i] = {v[0][order[i]], v[1][order[i]], v[2][order[i]]};
  }
}

/// Eq. 3.7.
inline TrueNormal principal_normal(double c[3][3]) {
  std::array<double, 3> values{};
  Vec3d vectors[3];
  eigen_decomposition(c, values, vectors);
  return {true, values[0] < 0.5 * values[1] && values[1] > 1e-3 * values[2], vectors[0]};
}

/// The n with n.r = 1 that minimises n^T C n: n = r / |r|^2 + a s + b t with s and t orthogonal to
/// r has the derivatives s^T C n = 0 and t^T C n = 0, two equations for a and b.
inline TrueNormal normal_along(const Vec3d& r, const double c[3][3]) {
  const auto product = [&](const Vec3d& x, const Vec3d& y) {
    double sum = 0;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) sum += x[i] * c[i][j] * y[j];
    }
    return sum;
  };
  const Vec3d s = normalized(cross(r, Vec3d{0, 1, 0})), t = normalized(cross(r, s));
  const Vec3d start = r / dot(r, r);
  const double ss = product(s, s), st = product(s, t), tt = product(t, t);
  const double s0 = product(s, start), t0 = product(t, start);
  const double determinant = ss * tt - st * st;
  const double a = (st * t0 - tt * s0) / determinant, b = (st * s0 - ss * t0) / determinant;
  return {true, determinant > 1e-3 * (ss + tt) * (ss + tt), normalized(start + a * s + b * t)};
}

/// Eqs. 3.7-3.11. Whether a pixel is a neighbor is decided in single precision, as in the library.
inline TrueNormal true_normal(const TrueDepth& depth, const Intrinsics& k,
                              const NormalOptions& options, int u, int v) {
  const double z_p = depth(u, v);
  if (!(z_p > 0)) return {};
  const auto unproject = [&](int column, int row, double z) {
    return Vec3d{(column - k.cx) * z / k.fx, (row - k.cy) * z / k.fy, z};
  };
  const Vec3d p = unproject(u, v, z_p);
  const float gate = static_cast<float>(options.max_depth_change) * static_cast<float>(z_p);
  const double sigma = options.weight_sigma * z_p * z_p;
  std::vector<Vec3d> neighbors;
  std::vector<double> weights;
  std::vector<std::pair<int, int>> pixels;
  Vec3d sum;
  double sum_weights = 0;
  for (int dv = -options.radius; dv <= options.radius; ++dv) {
    for (int du = -options.radius; du <= options.radius; ++du) {
      const double z = depth(u + du, v + dv);
      if (!(z > 0)) continue;
      if (std::abs(static_cast<float>(z) - static_cast<float>(z_p)) > gate) continue;
      const Vec3d q = unproject(u + du, v + dv, z);
      const double w = options.weighting ? std::exp(-dot(q - p, q - p) / (2 * sigma * sigma)) : 1;
      neighbors.push_back(q);
      weights.push_back(w);
      pixels.emplace_back(du, dv);
      sum += w * q;
      sum_weights += w;
    }
  }
  bool on_one_line = true;
  for (const auto& [a_u, a_v] : pixels) {
    for (const auto& [b_u, b_v] : pixels) on_one_line &= a_u * b_v == a_v * b_u;  // p is the origin
  }
  TrueNormal result;
  if (static_cast<int>(pixels.size()) < options.min_neighbors || on_one_line) return result;

  const Vec3d center = options.anchoring ? p : sum / sum_weights;
  double c[3][3] = {};
  for (std::size_t i = 0; i < neighbors.size(); ++i) {
    Vec3d d = neighbors[i] - center;
    if (options.normalization) {
      if (norm(d) <= 1e-5 * z_p) continue;
      d = d / norm(d);
    }
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) c[row][column] += weights[i] * d[row] * d[column];
    }
  }
  result = options.fit == PlaneFit::principal ? principal_normal(c) : normal_along(p, c);
  if (dot(result.n, p) > 0) result.n = -result.n;
  return result;
}

/// Eqs. 3.13-3.16 corrected.
inline Vec3d true_depth_change(const TrueDepth& depth, const Intrinsics& k, double min_step, int u,
                               int v) {
  const double z_p = depth(u, v);
  Vec3d l;
  if (!(z_p > 0)) return l;
  for (int dv = -1; dv <= 1; ++dv) {
    for (int du = -1; du <= 1; ++du) {
      const double z_q = depth(u + du, v + dv);
      if (!(z_q > 0)) continue;
      const double a = std::max(0.0, z_q - z_p - min_step);
      l += Vec3d{a * du, a * dv, 0};
    }
  }
  const Vec3d ray = normalized(Vec3d{(u - k.cx) / k.fx, (v - k.cy) / k.fy, 1});
  return l - dot(l, ray) * ray;
}

/// Degrees; precise for small angles.
inline double angle_between(const Vec3d& a, const Vec3d& b) {
  return std::atan2(norm(cross(a, b)), dot(a, b)) * 180 / M_PI;
}

}  // namespace palpate::test
