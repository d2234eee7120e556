#include "src/packing/linear_program.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace palpate { inline namespace v0 {
namespace {

using Vec4 = std::array<double, 4>;

constexpr int kMaxPivots = 64;

double dot4(const Vec4& a, const Vec4& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
}

}  // namespace

// Dual simplex with z = (d, t) and rows a.z <= b. Four rows are active: z is their common point,
// and the multipliers lambda >= 0 write the objective as their combination, which proves z optimal
// for the active rows alone. The start takes the tightest constraint and the three sides of the box
// that its normal points at. While some row is violated it enters, and the one that lets every
// multiplier stay >= 0 leaves. `inverse` holds the columns of the inverse of the active matrix:
// inverse[j] . a_k = (j == k).
LinearOptimum solve_linear_program(const LinearConstraints& constraints, double box) {
  const std::size_t n = constraints.size();
  const std::size_t first = static_cast<std::size_t>(
      std::min_element(constraints.f.begin(), constraints.f.end()) - constraints.f.begin());
  const Vec3d n0{constraints.nx[first], constraints.ny[first], constraints.nz[first]};

  // Active rows are (sign_k e_k, 0) for k < 3 and (-n0, 1).
  std::array<Vec4, 4> inverse{};
  Vec4 z{}, lambda{};
  for (std::size_t k = 0; k < 3; ++k) {
    const double component = n0[static_cast<int>(k)], sign = component < 0 ? -1 : 1;
    inverse[k][k] = sign;
    inverse[k][3] = std::abs(component);
    lambda[k] = std::abs(component);
    z[k] = sign * box;
  }
  inverse[3] = {0, 0, 0, 1};
  lambda[3] = 1;
  z[3] = constraints.f[first] + n0.x * z[0] + n0.y * z[1] + n0.z * z[2];

  const double tolerance = 1e-13 * (box + std::abs(constraints.f[first]));
  for (int pivot = 0; pivot < kMaxPivots; ++pivot) {
    double worst = tolerance;
    Vec4 row{};
    for (std::size_t i = 0; i < n; ++i) {
      const double violation = z[3] - constraints.f[i] - constraints.nx[i] * z[0] -
                               constraints.ny[i] * z[1] - constraints.nz[i] * z[2];
      if (violation > worst) {
        worst = violation;
        row = {-constraints.nx[i], -constraints.ny[i], -constraints.nz[i], 1};
      }
    }
    for (std::size_t k = 0; k < 3; ++k) {
      const double violation = std::abs(z[k]) - box;
      if (violation > worst) {
        worst = violation;
        row = {};
        row[k] = z[k] < 0 ? -1 : 1;
      }
    }
    if (worst <= tolerance) break;

    // y writes the entering row as a combination of the active ones.
    Vec4 y;
    for (std::size_t j = 0; j < 4; ++j) y[j] = dot4(inverse[j], row);
    std::size_t leaving = 4;
    double ratio = 0;
    for (std::size_t j = 0; j < 4; ++j) {
      if (y[j] <= 1e-12) continue;
      const double r = lambda[j] / y[j];
      if (leaving == 4 || r < ratio) leaving = j, ratio = r;
    }
    if (leaving == 4) break;  // rounding only: the program always has a solution

    const Vec4 direction = inverse[leaving];
    for (std::size_t k = 0; k < 4; ++k) z[k] -= direction[k] * (worst / y[leaving]);
    for (std::size_t j = 0; j < 4; ++j) {
      if (j == leaving) continue;
      lambda[j] = std::max(0.0, lambda[j] - ratio * y[j]);
      const double factor = y[j] / y[leaving];
      for (std::size_t k = 0; k < 4; ++k) inverse[j][k] -= factor * direction[k];
    }
    lambda[leaving] = ratio;
    for (std::size_t k = 0; k < 4; ++k) inverse[leaving][k] = direction[k] / y[leaving];
  }
  const auto clamped = [box](double x) { return std::clamp(x, -box, box); };
  return {{clamped(z[0]), clamped(z[1]), clamped(z[2])}, z[3]};
}

}}  // namespace palpate::v0
