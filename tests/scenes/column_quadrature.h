// Integrals the plodding way: a tool is cut into thin columns along its z axis. Shares no idea with
// the cones of truth.cpp and the pressure of exact_wrench.cpp.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"
#include "scenes/environment.h"

namespace palpate::test {

using Span = std::pair<double, double>;

/// Returns the spans of the line (x, y, *) inside the closed mesh.
inline std::vector<Span> inside_spans(const TriangleMesh& mesh, double x, double y) {
  std::vector<double> crossings;
  for (const auto& t : mesh.triangles) {
    const Vec3d &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
    const auto side = [&](const Vec3d& p, const Vec3d& q) {
      return (q.x - p.x) * (y - p.y) - (q.y - p.y) * (x - p.x);
    };
    const double wc = side(a, b), wa = side(b, c), wb = side(c, a);
    if ((wa > 0) != (wb > 0) || (wb > 0) != (wc > 0)) continue;
    crossings.push_back((wa * a.z + wb * b.z + wc * c.z) / (wa + wb + wc));
  }
  std::sort(crossings.begin(), crossings.end());
  std::vector<Span> spans;
  for (std::size_t i = 1; i < crossings.size(); i += 2)
    spans.emplace_back(crossings[i - 1], crossings[i]);
  return spans;
}

/// The parts of the span of the line p + t d (|d| = 1) that lie in the environment's solid; they do
/// not overlap.
inline std::vector<Span> spans_in(const scenes::Environment& e, const Vec3d& p, const Vec3d& d,
                                  Span span) {
  using Kind = scenes::Environment::Kind;
  const auto behind = [&](Span s, const Plane<double>& plane) {
    const double h = dot(plane.normal, p) - plane.offset, v = dot(plane.normal, d);
    if (v > 0) s.second = std::min(s.second, -h / v);
    if (v < 0) s.first = std::max(s.first, -h / v);
    if (v == 0 && h > 0) s.second = s.first;
    return s;
  };
  std::vector<Span> parts;
  const auto add = [&](Span s) {
    if (s.first < s.second) parts.push_back(s);
  };
  const auto add_but = [&](Span whole, Span hole) {
    if (!(hole.first < hole.second)) return add(whole);
    add({whole.first, std::min(whole.second, hole.first)});
    add({std::max(whole.first, hole.second), whole.second});
  };
  if (e.kind == Kind::half_space) {
    add(behind(span, e.a));
  } else if (e.kind == Kind::ridge) {
    add(behind(behind(span, e.a), e.b));
  } else if (e.kind == Kind::corner) {
    add(behind(span, e.a));
    add_but(behind(span, e.b), behind(behind(span, e.a), e.b));
  } else if (e.kind == Kind::box) {
    const Pose X_BW = inverse(e.X_WB);
    const Vec3d q = X_BW * p, v = rotate(X_BW.rotation, d);
    for (std::size_t i = 0; i < 3; ++i) {
      const double low = (-e.half_size[i] - q[i]) / v[i], high = (e.half_size[i] - q[i]) / v[i];
      span.first = std::max(span.first, std::min(low, high));
      span.second = std::min(span.second, std::max(low, high));
    }
    add(span);
  } else {
    const double along = dot(e.center - p, d);
    const double apart2 = dot(p + d * along - e.center, p + d * along - e.center);
    const double half = std::sqrt(std::max(0.0, e.radius * e.radius - apart2));
    const Span ball{std::max(span.first, along - half), std::min(span.second, along + half)};
    e.kind == Kind::ball_outside ? add(ball) : add_but(span, ball);
  }
  return parts;
}

/// Cuts the tool into n x n columns and calls visit(p, d, span, area) for every part of a column
/// p + t d in the solid.
template <class Visit>
void for_each_column_part(const TriangleMesh& tool_T, const Pose& X_WT,
                          const scenes::Environment& environment, int n, Visit visit) {
  const Bounds box = bounds(tool_T);
  const Vec3d step = (box.high - box.low) / n;
  const Vec3d d = rotate(X_WT.rotation, {0, 0, 1});
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      const double x = box.low.x + (i + 0.5) * step.x, y = box.low.y + (j + 0.4999) * step.y;
      const Vec3d p = X_WT * Vec3d{x, y, 0};
      for (const Span& span : inside_spans(tool_T, x, y)) {
        for (const Span& part : spans_in(environment, p, d, span)) {
          visit(p, d, part, step.x * step.y);
        }
      }
    }
  }
}

/// Volume of tool and solid in common.
inline double column_volume(const TriangleMesh& tool_T, const Pose& X_WT,
                            const scenes::Environment& environment, int n) {
  double sum = 0;
  for_each_column_part(tool_T, X_WT, environment, n,
                       [&](const Vec3d&, const Vec3d&, const Span& part, double area) {
                         sum += (part.second - part.first) * area;
                       });
  return sum;
}

/// Calls visit(x, weight) for points x of the common part: twelve midpoints per part of a column,
/// which is split where n jumps (between the planes of a ridge).
template <class Visit>
void for_each_column_point(const TriangleMesh& tool_T, const Pose& X_WT,
                           const scenes::Environment& e, int n, Visit visit) {
  constexpr int kSteps = 12;
  const Plane<double> halfway{e.a.normal - e.b.normal, e.a.offset - e.b.offset};
  for_each_column_part(
      tool_T, X_WT, e, n, [&](const Vec3d& p, const Vec3d& d, const Span& part, double area) {
        const auto add = [&](double from, double to) {
          const double step = (to - from) / kSteps;
          for (int i = 0; i < kSteps; ++i) visit(p + d * (from + (i + 0.5) * step), step * area);
        };
        const double split = (halfway.offset - dot(halfway.normal, p)) / dot(halfway.normal, d);
        if (e.kind == scenes::Environment::Kind::ridge && split > part.first &&
            split < part.second) {
          add(part.first, split);
          add(split, part.second);
        } else {
          add(part.first, part.second);
        }
      });
}

/// Integrals of n and of (x - C) x n over the common part, n from signed_distance.
inline VolumeWrench column_wrench(const TriangleMesh& tool_T, const Pose& X_WT,
                                  const Vec3d& center_W, const scenes::Environment& environment,
                                  int n) {
  VolumeWrench sum;
  for_each_column_point(tool_T, X_WT, environment, n, [&](const Vec3d& x, double weight) {
    const Vec3d force = scenes::signed_distance(environment, x).gradient * weight;
    sum.force += force;
    sum.torque += cross(x - center_W, force);
  });
  return sum;
}

/// Integral of the depth over the common part, m4.
inline double column_energy(const TriangleMesh& tool_T, const Pose& X_WT,
                            const scenes::Environment& environment, int n) {
  double sum = 0;
  for_each_column_point(tool_T, X_WT, environment, n, [&](const Vec3d& x, double weight) {
    sum -= scenes::signed_distance(environment, x).distance * weight;
  });
  return sum;
}

}  // namespace palpate::test
