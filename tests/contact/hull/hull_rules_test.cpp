// The rules by which cameras are joined: their derivatives, once and twice, are those of their
// values.
#include "src/contact/internal/hull_rules.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/test_util/random.h"

namespace palpate {
namespace {

using test::Random;
using Space = SpaceCurvature<double>;

/// c + g.p + p.H p / 2 with its derivatives at p.
struct Quadric {
  double c = 0;
  Vec3d g;
  double h[3][3] = {};

  static Quadric random(Random& random, double around, double bend) {
    Quadric q{around, random.direction(), {}};
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j <= i; ++j) q.h[i][j] = q.h[j][i] = random.uniform(-bend, bend);
    }
    return q;
  }
  Space at(const Vec3d& p) const {
    Vec3d hp;
    for (int i = 0; i < 3; ++i) hp[i] = h[i][0] * p.x + h[i][1] * p.y + h[i][2] * p.z;
    const Vec3d n = g + hp;
    return {{c + dot(g, p) + dot(p, hp) / 2, n.x, n.y, n.z},
            {h[0][0], h[0][1], h[0][2], h[1][1], h[1][2], h[2][2]}};
  }
};

Vec3d gradient_of(const Space& s) { return {s.first.x, s.first.y, s.first.z}; }
Vec3d column(const Symmetric<double>& h, int axis) {
  return axis == 0   ? Vec3d{h.xx, h.xy, h.xz}
         : axis == 1 ? Vec3d{h.xy, h.yy, h.yz}
                     : Vec3d{h.xz, h.yz, h.zz};
}

// The two fields differ by anything from nothing to twice the width, either way round.
TEST(HullRules, DerivativesAreThoseOfTheValues) {
  Random random(81);
  for (int n = 0; n < 3000; ++n) {
    const double radius = random.uniform(0.001, 0.02), wide = agreement(radius);
    const double extent = random.uniform(1, 4) * radius;
    const HullWidth<double> width = hull_width(radius);
    const double scale = n % 3 == 0 ? width.w : wide, around = random.uniform(-0.02, 0.02);
    const Quadric a = Quadric::random(random, around, 20),
                  b = Quadric::random(random, around + 2 * scale * random.uniform(-1, 1), 20);
    const auto joined = [&](int rule, const Vec3d& p) -> Space {
      const Space s = a.at(p), t = b.at(p);
      switch (rule) {
        case 0: return greater_of(s, t, width);
        case 1: return lesser_of(s, t, width);
        case 2: return agreed(s, t, wide);
        default:
          return composed(limited(s.first.phi + free_limit(radius, extent), radius, extent), s);
      }
    };
    for (int rule = 0; rule < 4; ++rule) {
      const Space at = joined(rule, {});
      for (int axis = 0; axis < 3; ++axis) {
        const double step = 1e-5 * radius;
        Vec3d way;
        way[axis] = step;
        const Space more = joined(rule, way), less = joined(rule, -way);
        EXPECT_NEAR(gradient_of(at)[axis], (more.first.phi - less.first.phi) / (2 * step), 1e-4)
            << rule;
        // Second derivatives jump where a rule begins and ends.
        const Vec3d before = column(less.h, axis), after = column(more.h, axis);
        if (norm(after - before) > 1e-2 * (1 + norm(before))) continue;
        const Vec3d slope = (gradient_of(more) - gradient_of(less)) / (2 * step);
        EXPECT_LT(norm(column(at.h, axis) - slope), 1e-3 * (20 + norm(slope))) << rule;
      }
      const double p = a.c, q = b.c, most = std::max(p, q), phi = at.first.phi;
      if (rule == 0) {
        EXPECT_GE(phi, most);
        EXPECT_LE(phi, most + width.w / 4 + 1e-9);
      } else if (rule == 1) {
        EXPECT_LE(phi, std::min(p, q));
        EXPECT_GE(phi, std::min(p, q) - width.w / 4 - 1e-9);
      } else if (rule == 2) {
        EXPECT_GE(phi, (p + q) / 2 - 1e-12);
        EXPECT_GE(phi, most - free_margin(2, radius));
        EXPECT_LE(phi, most + 1e-9);
      }
    }
  }
}

}  // namespace
}  // namespace palpate
