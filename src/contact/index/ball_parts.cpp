#include "src/contact/internal/ball_parts.h"

#include <cmath>

#include "src/contact/internal/ball_cut.h"

namespace palpate { inline namespace v0 {
namespace {

// Number of points along each axis of a cell's box by which cells at the surface are cut.
constexpr int kLooks = 12;
// Smallest share of a cell that is kept: less goes to the others.
constexpr double kMinShare = 0.05;

/// True if p, from a site in half lattice constants, is nearer to it than to any other site.
bool is_in_cell(const Vec3d& p) {
  const double x = std::abs(p.x), y = std::abs(p.y), z = std::abs(p.z);
  return x + y <= 1 && x + z <= 1 && y + z <= 1;
}

/// Cuts the cell around a site by the unit ball; share: of the cell.
BallPart cut_cell(const Vec3d& site, double half) {
  if (norm(site) + half <= 1) return {site, 0, 1};
  Vec3d sum;
  int num = 0, num_inside = 0;
  for (int look = 0; look < kLooks * kLooks * kLooks; ++look) {
    const auto at = [](int n) { return (2 * n + 1.0) / kLooks - 1; };
    const Vec3d p{at(look % kLooks), at(look / kLooks % kLooks), at(look / kLooks / kLooks)};
    if (!is_in_cell(p)) continue;
    ++num;
    const Vec3d q = site + half * p;
    if (dot(q, q) > 1) continue;
    ++num_inside;
    sum += q;
  }
  return {num_inside > 0 ? sum / num_inside : site, 0, static_cast<double>(num_inside) / num};
}

}  // namespace

std::vector<BallPart> thirty_parts() {
  constexpr double kRadius = kPartRadius, kDistance = kPartDistance;
  std::vector<BallPart> parts;
  const auto add = [&](const Vec3d& corner) {
    parts.push_back({kDistance * normalized(corner), kRadius, 1.0 / kNumBallParts});
  };
  const double golden = (1 + std::sqrt(5.0)) / 2;
  for (const double a : {-1.0, 1.0}) {
    for (const Vec3d& corner : {Vec3d{a, 0, 0}, Vec3d{0, a, 0}, Vec3d{0, 0, a}}) add(corner);
    for (const double b : {-golden, golden}) {
      for (const double c : {-golden * golden, golden * golden}) {
        for (const Vec3d& corner : {Vec3d{a, b, c}, Vec3d{b, c, a}, Vec3d{c, a, b}}) add(corner);
      }
    }
  }
  return parts;
}

const BallPlaces& ball_places() {
  static const BallPlaces places = [] {
    BallPlaces made;
    const std::vector<BallPart> parts = thirty_parts();
    for (std::size_t i = 0; i < parts.size(); ++i) {
      for (int axis = 0; axis < 3; ++axis) {
        made.rows[axis][i] = static_cast<float>(parts[i].center[axis]);
      }
      made.rows[3][i] = 1;
    }
    return made;
  }();
  return places;
}

std::vector<BallPart> even_parts(double radius) {
  // A cell is twice the cube of half a lattice constant.
  const double whole = radius * radius * radius, half = std::cbrt(sphere_volume(radius) / 2);
  const int most = static_cast<int>(1 / half) + 1;
  std::vector<BallPart> parts;
  double sum = 0;
  for (int i = -most; i <= most; ++i) {
    for (int j = -most; j <= most; ++j) {
      for (int k = -most; k <= most; ++k) {
        if ((i + j + k) % 2 != 0) continue;
        BallPart part = cut_cell({half * i, half * j, half * k}, half);
        if (part.share < kMinShare) continue;
        part.share *= whole;
        sum += part.share;
        parts.push_back(part);
      }
    }
  }
  for (BallPart& part : parts) {
    part.share /= sum;
    part.radius = std::cbrt(part.share);
  }
  return parts;
}

}}  // namespace palpate::v0
