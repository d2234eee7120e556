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

// phi = max(agreed seen free, min(agreed remembered, min in front) - w, min fields - W), rounded.
TEST(HullRules, TheJoinIsItsFormula) {
  Random random(82);
  using Joined = JoinedViews<Space, double, int>;
  int deciders[4] = {};
  for (int n = 0; n < 2000; ++n) {
    const double radius = random.uniform(0.001, 0.02), wide = agreement(radius);
    const double spread = random.uniform(0, 4) * wide;
    const auto view = [&] {
      return Quadric::random(random, spread * random.uniform(-1, 1), 5).at({});
    };
    Joined::Agreed seen, known;
    Joined::Least shown, fields;
    double most = -1, most_known = -1, least_shown = 1, least_field = 1;
    int who = 0, who_knows = 0, who_shows = 0;
    for (int k = 0; k < 3; ++k) {
      const Space views[] = {view(), view(), view(), view()};
      seen.add(views[0], k, radius);
      known.add(views[1], k, radius);
      shown.add(views[2], k, radius);
      fields.add(views[3], k, radius);
      const auto take = [k](double phi, bool is_more, double& value, int& camera) {
        if (is_more) value = phi, camera = k;
      };
      int nobody = 0;
      take(views[0].first.phi, views[0].first.phi > most, most, who);
      take(views[1].first.phi, views[1].first.phi > most_known, most_known, who_knows);
      take(views[2].first.phi, views[2].first.phi < least_shown, least_shown, who_shows);
      take(views[3].first.phi, views[3].first.phi < least_field, least_field, nobody);
    }
    // Rounding lowers the agreed value of three, and changes minimum and maximum of each by less.
    const double low = free_margin(3, radius), w = hull_width(radius).w;
    EXPECT_LE(seen.value.first.phi, most + 1e-12);
    EXPECT_GE(seen.value.first.phi, most - low - 1e-12);
    EXPECT_EQ(seen.who, who);
    EXPECT_LE(shown.value.first.phi, least_shown + 1e-12);
    EXPECT_GE(shown.value.first.phi, least_shown - w);
    Joined joined;
    joined.see(seen);
    EXPECT_EQ(joined.hull.first.phi, seen.value.first.phi);
    const bool is_unseen = joined.is_unseen();
    EXPECT_EQ(is_unseen, seen.value.first.phi < -kSeenBehind);
    const Joined before = joined;
    joined.remember(known, shown, radius, false);
    EXPECT_EQ(joined.hull.first.phi, before.hull.first.phi);
    EXPECT_EQ(joined.decider, who);
    joined.remember(known, shown, radius, true);
    const double memory = std::min(known.value.first.phi, shown.value.first.phi) - w;
    EXPECT_NEAR(joined.hull.first.phi, std::max(before.hull.first.phi, memory), w / 2);
    EXPECT_EQ(joined.seen_phi, joined.hull.first.phi);
    const int remembers = known.value.first.phi < shown.value.first.phi ? who_knows : who_shows;
    if (memory > before.hull.first.phi + w) {
      EXPECT_EQ(joined.decider, remembers);
    }
    if (memory < before.hull.first.phi - w) {
      EXPECT_EQ(joined.decider, who);
    }
    const double seen_phi = joined.hull.first.phi, field = fields.value.first.phi - wide;
    joined.close(fields, radius, true);
    EXPECT_NEAR(joined.hull.first.phi, std::max(seen_phi, field), w / 2);
    EXPECT_EQ(joined.seen_phi, seen_phi);
    if (field > seen_phi + w) {
      EXPECT_EQ(joined.decider, -1);
    }
    ++deciders[joined.decider + 1];
  }
  for (const int num : deciders) EXPECT_GT(num, 10);
}

}  // namespace
}  // namespace palpate
