// Volumes the plodding way: a tool is cut into thin columns along its z axis. Shares no idea with
// the cones of truth.cpp.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "palpate/math/pose.h"
#include "palpate/mesh/triangle_mesh.h"
#include "scenes/environment.h"

namespace palpate::test {

using Span = std::pair<double, double>;

/// Where the line (x, y, *) is inside the closed mesh.
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

/// Part of the span of the line p + t d (|d| = 1) that lies in the environment's solid.
inline double length_in(const scenes::Environment& e, const Vec3d& p, const Vec3d& d, Span span) {
  using Kind = scenes::Environment::Kind;
  const double whole = span.second - span.first;
  const auto behind = [&](Span s, const Plane<double>& plane) {
    const double h = dot(plane.normal, p) - plane.offset, v = dot(plane.normal, d);
    if (v > 0) s.second = std::min(s.second, -h / v);
    if (v < 0) s.first = std::max(s.first, -h / v);
    if (v == 0 && h > 0) s.second = s.first;
    return s;
  };
  const auto length = [](Span s) { return std::max(0.0, s.second - s.first); };
  if (e.kind == Kind::half_space) return length(behind(span, e.a));
  if (e.kind == Kind::ridge || e.kind == Kind::corner) {
    const double a = length(behind(span, e.a)), b = length(behind(span, e.b));
    const double both = length(behind(behind(span, e.a), e.b));
    return e.kind == Kind::ridge ? both : a + b - both;
  }
  const double along = dot(e.centre - p, d);
  const double apart2 = dot(p + d * along - e.centre, p + d * along - e.centre);
  const double half = std::sqrt(std::max(0.0, e.radius * e.radius - apart2));
  const double in_ball =
      length({std::max(span.first, along - half), std::min(span.second, along + half)});
  return e.kind == Kind::ball_outside ? in_ball : whole - in_ball;
}

/// Volume of tool and solid in common, from n x n columns.
inline double column_volume(const TriangleMesh& tool_T, const Pose& X_WT,
                            const scenes::Environment& environment, int n) {
  const Bounds box = bounds(tool_T);
  const Vec3d step = (box.high - box.low) / n;
  const Vec3d d = rotate(X_WT.rotation, {0, 0, 1});
  double sum = 0;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      const double x = box.low.x + (i + 0.5) * step.x, y = box.low.y + (j + 0.4999) * step.y;
      for (const Span& span : inside_spans(tool_T, x, y)) {
        sum += length_in(environment, X_WT * Vec3d{x, y, 0}, d, span);
      }
    }
  }
  return sum * step.x * step.y;
}

}  // namespace palpate::test
