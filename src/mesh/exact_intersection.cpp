#include "src/mesh/self_intersection.h"

#include <algorithm>

namespace palpate { inline namespace v0 {
namespace {

__extension__ typedef __int128 Int128;

int sign(Int128 x) { return (x > 0) - (x < 0); }

Vec3<Int128> wide(const GridPoint& a) { return {a.x, a.y, a.z}; }

Vec3<Int128> normal(const GridPoint& a, const GridPoint& b, const GridPoint& c) {
  return cross(wide(b - a), wide(c - a));
}

/// On which side of the plane abc is d? 0: on it.
int side(const GridPoint& a, const GridPoint& b, const GridPoint& c, const GridPoint& d) {
  return sign(dot(normal(a, b, c), wide(d - a)));
}

/// The plane figure left when one axis is dropped.
struct FlatPoint {
  std::int64_t u, v;
};

FlatPoint flatten(const GridPoint& p, int dropped) {
  return {p[(dropped + 1) % 3], p[(dropped + 2) % 3]};
}

int turn(const FlatPoint& a, const FlatPoint& b, const FlatPoint& c) {
  return sign(Int128(b.u - a.u) * (c.v - a.v) - Int128(b.v - a.v) * (c.u - a.u));
}

/// For p on the line ab: is it on the segment?
bool between(const FlatPoint& a, const FlatPoint& b, const FlatPoint& p) {
  return std::min(a.u, b.u) <= p.u && p.u <= std::max(a.u, b.u) && std::min(a.v, b.v) <= p.v &&
         p.v <= std::max(a.v, b.v);
}

bool segments_meet(const FlatPoint& p, const FlatPoint& q, const FlatPoint& a, const FlatPoint& b) {
  const int pqa = turn(p, q, a), pqb = turn(p, q, b), abp = turn(a, b, p), abq = turn(a, b, q);
  if (pqa * pqb < 0 && abp * abq < 0) return true;
  return (pqa == 0 && between(p, q, a)) || (pqb == 0 && between(p, q, b)) ||
         (abp == 0 && between(a, b, p)) || (abq == 0 && between(a, b, q));
}

/// All points lie in one plane with the given normal.
bool coplanar_segment_meets(const GridPoint& p, const GridPoint& q, const GridTriangle& t,
                            const Vec3<Int128>& n) {
  if (n == Vec3<Int128>{}) return false;
  const int dropped = n.x != 0 ? 0 : (n.y != 0 ? 1 : 2);
  const FlatPoint a = flatten(t.p[0], dropped), b = flatten(t.p[1], dropped),
                  c = flatten(t.p[2], dropped), from = flatten(p, dropped),
                  to = flatten(q, dropped);
  const int inside = turn(a, b, from) + turn(b, c, from) + turn(c, a, from);
  return inside == 3 || inside == -3 || segments_meet(from, to, a, b) ||
         segments_meet(from, to, b, c) || segments_meet(from, to, c, a);
}

/// Do the closed segment pq and the closed triangle have a point in common?
bool segment_meets(const GridPoint& p, const GridPoint& q, const GridTriangle& t) {
  const auto& [a, b, c] = t.p;
  const Vec3<Int128> n = normal(a, b, c);
  const int side_p = sign(dot(n, wide(p - a))), side_q = sign(dot(n, wide(q - a)));
  if (side_p * side_q > 0) return false;
  if (side_p == 0 && side_q == 0) return coplanar_segment_meets(p, q, t, n);
  // The line crosses the plane in one point: does it pass all edges on the same side?
  const int ab = side(p, q, a, b), bc = side(p, q, b, c), ca = side(p, q, c, a);
  return (ab >= 0 && bc >= 0 && ca >= 0) || (ab <= 0 && bc <= 0 && ca <= 0);
}

}  // namespace

bool triangles_meet(const GridTriangle& a, const GridTriangle& b) {
  int num_shared = 0, shared_a = 0, shared_b = 0;
  bool is_shared_a[3] = {}, is_shared_b[3] = {};
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      if (a.vertex[i] != b.vertex[j]) continue;
      ++num_shared;
      is_shared_a[i] = is_shared_b[j] = true;
      shared_a = i;
      shared_b = j;
    }
  }
  if (num_shared == 3) return true;
  if (num_shared == 2) {
    // Neighbors meet beyond their edge only if one is folded flat onto the other.
    const auto free = std::find(is_shared_a, is_shared_a + 3, false) - is_shared_a;
    const GridPoint& from = a.p[(free + 1) % 3];
    const GridPoint& to = a.p[(free + 2) % 3];
    const GridPoint& c = a.p[free];
    const GridPoint& d = b.p[std::find(is_shared_b, is_shared_b + 3, false) - is_shared_b];
    const Vec3<Int128> n = normal(from, to, c);
    if (sign(dot(n, wide(d - from))) != 0) return false;
    const Vec3<Int128> m = normal(from, to, d);
    for (int axis = 0; axis < 3; ++axis) {
      if (n[axis] != 0) return sign(n[axis]) == sign(m[axis]);
    }
    return false;
  }
  if (num_shared == 1) {
    // Beyond the shared corner, the side opposite to it takes part in every contact.
    return segment_meets(a.p[(shared_a + 1) % 3], a.p[(shared_a + 2) % 3], b) ||
           segment_meets(b.p[(shared_b + 1) % 3], b.p[(shared_b + 2) % 3], a);
  }
  for (int k = 0; k < 3; ++k) {
    if (segment_meets(a.p[k], a.p[(k + 1) % 3], b)) return true;
    if (segment_meets(b.p[k], b.p[(k + 1) % 3], a)) return true;
  }
  return false;
}

}}  // namespace palpate::v0
