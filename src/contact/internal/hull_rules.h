// Rules that join the fields of several cameras: the depth hull
// (docs/decisions/0029-depth-hull.md). Shared by host and device, for single numbers and vectors of
// them.
//
// Each camera has two fields: `seen_free` is positive only in space that the camera has seen to be
// free, `field` also in space that it does not see (UnknownSpace). With both limited in free space,
//
//   phi = max( agreed over k of seen_free_k,  min over k of field_k - W )
//
// the depth of a sphere is the smallest of any camera, and space that no camera sees has the depth
// on which their fields agree. Two cameras that differ by less than W may see one surface with
// noise: then `agreed` is between their mean and the greater one. Maximum and minimum are rounded
// over w = kHullCorner radii to each side. So phi is once continuously differentiable as the fields
// are, and values W deeper than another camera's have no influence at all.
//
// With a memory (docs/decisions/0033-memory.md) the field of a single camera shows the surfaces
// behind, which may be remembered, and another one those that have come before them: the lesser of
// both counts. For several cameras
//
//   max( agreed over k of seen_free_k,
//        min( agreed over k of remembered_k, min over k of in_front_k ) - w )
//
// takes the place of the first part: the seen outranks the remembered, which counts only where no
// camera sees a surface, as thick as in_front has it.
#pragma once

#include "src/contact/field/field_bound.h"
#include "src/contact/field/field_element.h"

namespace palpate { inline namespace v0 {

/// In radii: half the width over which two cameras are joined.
inline constexpr float kHullCorner = 0.1f;
/// In radii: half the width over which values are limited.
inline constexpr float kLimitCorner = 0.25f;
/// Cameras that differ by less, m, may see the same surface.
inline constexpr float kAgreement = 0.003f;

/// A field and its derivatives in space.
template <class Real>
struct SpaceGradient {
  Real phi{}, x{}, y{}, z{};
};
template <class Real>
struct SpaceCurvature {
  SpaceGradient<Real> first{};
  Symmetric<Real> h{};
};

template <class Real>
PALPATE_FORMULA const SpaceGradient<Real>& first_of(const SpaceGradient<Real>& s) {
  return s;
}
template <class Real>
PALPATE_FORMULA const SpaceGradient<Real>& first_of(const SpaceCurvature<Real>& s) {
  return s.first;
}
/// Returns the second derivatives, zero where they are not known.
template <class Real>
PALPATE_FORMULA Symmetric<Real> second_of(const SpaceGradient<Real>&) {
  return {};
}
template <class Real>
PALPATE_FORMULA Symmetric<Real> second_of(const SpaceCurvature<Real>& s) {
  return s.h;
}
/// A field whose second derivatives are zero.
template <class Real>
PALPATE_FORMULA void set(SpaceGradient<Real>& to, const SpaceGradient<Real>& s) {
  to = s;
}
template <class Real>
PALPATE_FORMULA void set(SpaceCurvature<Real>& to, const SpaceGradient<Real>& s) {
  to = {s, {}};
}

/// Returns f(s) for a function f of one number.
template <class Real>
PALPATE_FORMULA SpaceGradient<Real> composed(const Curved<Real>& f, const SpaceGradient<Real>& s) {
  return {f.value, f.slope * s.x, f.slope * s.y, f.slope * s.z};
}
template <class Real>
PALPATE_FORMULA SpaceCurvature<Real> composed(const Curved<Real>& f,
                                              const SpaceCurvature<Real>& s) {
  const SpaceGradient<Real>& g = s.first;
  return {composed(f, g),
          {f.slope * s.h.xx + f.bend * g.x * g.x, f.slope * s.h.xy + f.bend * g.x * g.y,
           f.slope * s.h.xz + f.bend * g.x * g.z, f.slope * s.h.yy + f.bend * g.y * g.y,
           f.slope * s.h.yz + f.bend * g.y * g.z, f.slope * s.h.zz + f.bend * g.z * g.z}};
}
/// Returns a + t b for a number t.
template <class Real>
PALPATE_FORMULA SpaceGradient<Real> plus(const SpaceGradient<Real>& a, Real t,
                                         const SpaceGradient<Real>& b) {
  return {a.phi + t * b.phi, a.x + t * b.x, a.y + t * b.y, a.z + t * b.z};
}
template <class Real>
PALPATE_FORMULA SpaceCurvature<Real> plus(const SpaceCurvature<Real>& a, Real t,
                                          const SpaceCurvature<Real>& b) {
  return {plus(a.first, t, b.first),
          {a.h.xx + t * b.h.xx, a.h.xy + t * b.h.xy, a.h.xz + t * b.h.xz, a.h.yy + t * b.h.yy,
           a.h.yz + t * b.h.yz, a.h.zz + t * b.h.zz}};
}

/// Returns a + phi.
template <class Space, class Real>
PALPATE_FORMULA Space shifted(const Space& a, Real phi) {
  Space shift{};
  set(shift, SpaceGradient<Real>{phi});
  return plus(a, Real{} + 1.0f, shift);
}
/// Returns `a` for the elements in `which`, `b` for the others.
template <class Real>
PALPATE_FORMULA SpaceGradient<Real> chosen(const auto& which, const SpaceGradient<Real>& a,
                                           const SpaceGradient<Real>& b) {
  return {which ? a.phi : b.phi, which ? a.x : b.x, which ? a.y : b.y, which ? a.z : b.z};
}
template <class Real>
PALPATE_FORMULA SpaceCurvature<Real> chosen(const auto& which, const SpaceCurvature<Real>& a,
                                            const SpaceCurvature<Real>& b) {
  return {chosen(which, a.first, b.first),
          {which ? a.h.xx : b.h.xx, which ? a.h.xy : b.h.xy, which ? a.h.xz : b.h.xz,
           which ? a.h.yy : b.h.yy, which ? a.h.yz : b.h.yz, which ? a.h.zz : b.h.zz}};
}

/// Half width over which a sphere's cameras are joined, and its inverse.
template <class Real>
struct HullWidth {
  Real w, per_w;
};
template <class Real>
PALPATE_FORMULA HullWidth<Real> hull_width(Real radius) {
  return {kHullCorner * radius, (1.0f / kHullCorner) / radius};
}
/// Difference within which cameras are taken to agree: W.
template <class Real>
PALPATE_FORMULA Real agreement(Real radius) {
  return kAgreement + 2.0f * kHullCorner * radius;
}
/// Largest amount by which the joined value of so many cameras is below that of one of them: a ball
/// that is free by more than that for one camera is free. `agreed` stays up to W 4 / 27 / 2 below
/// the greater.
template <class Real>
PALPATE_FORMULA Real free_margin(int num_cameras, Real radius) {
  return static_cast<float>(num_cameras - 1) * 0.0741f * agreement(radius);
}
/// Largest amount by which a remembered surface and the one before it, joined by the lesser of
/// both, are below each of them.
template <class Real>
PALPATE_FORMULA Real front_margin(Real radius) {
  return (0.25f * kHullCorner) * radius;
}
/// Returns the distance beyond which all is equally free. So a surface that appears in a frame has
/// contact from the beginning of the blend with the last one, however far behind it was free.
/// Values up to `extent` count, which is the radius but for the parts of balls.
template <class Real>
PALPATE_FORMULA Real free_limit(Real radius, Real extent) {
  const Real own = 2.0f * radius + agreement(radius), least = extent + kLimitCorner * radius;
  return own < least ? least : own;
}

/// Distance beyond which a surface has not come before another one.
template <class Real>
PALPATE_FORMULA Real front_limit(Real radius) {
  return free_limit(radius, radius) + kHullCorner * radius;
}

/// Returns the greater of two, rounded; `Sample` is a SpaceGradient or a SpaceCurvature.
template <class Sample, class Real>
PALPATE_FORMULA Sample greater_of(const Sample& a, const Sample& b, const HullWidth<Real>& width) {
  const Real one = Real{} + 1.0f;
  const Sample apart = plus(b, -one, a);
  return plus(a, one,
              composed(even_corner(first_of(apart).phi + width.w, width.w, width.per_w), apart));
}
/// Returns the lesser of two, rounded.
template <class Sample, class Real>
PALPATE_FORMULA Sample lesser_of(const Sample& a, const Sample& b, const HullWidth<Real>& width) {
  const Real one = Real{} + 1.0f;
  const Sample apart = plus(a, -one, b);
  return plus(a, -one,
              composed(even_corner(first_of(apart).phi + width.w, width.w, width.per_w), apart));
}

/// Joins two cameras: the greater value, or less where they differ by less than `wide`, down to
/// their mean where they are equal. Noise makes the greater of two too great; cameras that agree
/// shall be better than one.
template <class Sample, class Real>
PALPATE_FORMULA Sample agreed(const Sample& a, const Sample& b, Real wide) {
  const Real one = Real{} + 1.0f;
  const Sample apart = plus(b, -one, a);
  const Real d = first_of(apart).phi, size = d < Real{} ? -d : d, per_wide = one / wide;
  const Real y = size * per_wide, x = y > one ? one : y;
  const Real beyond = y > one ? size - wide : Real{};
  const Real sign = d < Real{} ? -one : one;
  const auto is_bent = x == y;
  return plus(a, one,
              composed<Real>({0.5f * (d + wide * x * x * (2.0f - x) + beyond),
                              0.5f * (one + sign * x * (4.0f - 3.0f * x)),
                              is_bent ? (2.0f - 3.0f * x) * per_wide : Real{}},
                             apart));
}

/// Returns the lesser one of phi and free_limit, by phi.
template <class Real>
PALPATE_FORMULA Curved<Real> limited(Real phi, Real radius, Real extent) {
  // Values up to the extent stay as they are.
  const Real k = kLimitCorner * radius;
  const Curved<Real> above =
      even_corner(phi - free_limit(radius, extent) + k, k, (1.0f / kLimitCorner) / radius);
  return {phi - above.value, 1.0f - above.slope, -above.bend};
}

/// Returns a camera's sample at `at` (from_u, from_v, inverse_depth), in space along its axes.
template <class Real, class At>
PALPATE_FORMULA SpaceGradient<Real> in_space(const FieldFrame& frame, const At& at,
                                             const ImageGradient<Real>& g) {
  const Gradient3<Real> n = to_space(g, at.from_u, at.from_v, at.inverse_depth, frame.fx, frame.fy);
  return {g.phi, n.x, n.y, n.z};
}
template <class Real, class At>
PALPATE_FORMULA SpaceCurvature<Real> in_space(const FieldFrame& frame, const At& at,
                                              const ImageCurvature<Real>& c) {
  return {in_space(frame, at, c.first),
          hessian_in_space(c, at.from_u, at.from_v, at.inverse_depth, frame.fx, frame.fy)};
}
/// Returns it in other axes.
template <class Real>
PALPATE_FORMULA SpaceGradient<Real> turned(const float (&R)[3][3], const SpaceGradient<Real>& s) {
  const Gradient3<Real> n = turned(R, Gradient3<Real>{s.x, s.y, s.z});
  return {s.phi, n.x, n.y, n.z};
}
template <class Real>
PALPATE_FORMULA SpaceCurvature<Real> turned(const float (&R)[3][3], const SpaceCurvature<Real>& s) {
  return {turned(R, s.first), turned(R, s.h)};
}
/// Returns a camera's sample in the world. `Sample` is an ImageGradient or an ImageCurvature.
template <class At, class Sample>
PALPATE_FORMULA auto rotated_to_world(const float (&R_WC)[3][3], const FieldFrame& frame,
                                      const At& at, const Sample& sample) {
  return turned(R_WC, in_space(frame, at, sample));
}
/// Returns it limited, for balls of this radius.
template <class Real, class At, class Sample>
PALPATE_FORMULA auto in_world(const float (&R_WC)[3][3], const FieldFrame& frame, const At& at,
                              const Sample& sample, Real radius, Real extent) {
  const auto space = rotated_to_world(R_WC, frame, at, sample);
  return composed(limited(first_of(space).phi, radius, extent), space);
}

/// Interpolates between a camera's two moments.
template <class Space, class Real>
PALPATE_FORMULA Space interpolated(const Space& older, const Space& newer, Real progress) {
  return plus(older, progress, plus(newer, Real{} - 1.0f, older));
}
/// Limits the field near a camera's eye to that right before it. `before`: the distance before the
/// eye, less kMinDepth.
template <class Space, class Real>
PALPATE_FORMULA Space before_eye(const float (&R_WC)[3][3], const Space& seen, Real before,
                                 Real radius) {
  const Real zero{};
  Space plane{};
  set(plane, SpaceGradient<Real>{before, R_WC[0][2] - zero, R_WC[1][2] - zero, R_WC[2][2] - zero});
  return lesser_of(seen, plane, hull_width(radius));
}

// The join itself is fed one view after another: the loops differ, what they compute does not.
// `Index` is the number of a camera, one for each element. Elements in `which` are joined.

/// The value on which views agree, and the camera that has the greatest one.
template <class Space, class Real, class Index>
struct AgreedViews {
  Space value{};
  Real most = Real{} - 1e9f;
  Index who{};
  bool is_empty = true;

  PALPATE_FORMULA void add(const Space& here, int camera, Real radius) {
    value = is_empty ? here : agreed(value, here, agreement(radius));
    const auto is_more = first_of(here).phi > most;
    who = is_more ? Index{} + camera : who;
    most = is_more ? first_of(here).phi : most;
    is_empty = false;
  }
};
/// The least value of views, and the camera that has it.
template <class Space, class Real, class Index>
struct LeastView {
  Space value{};
  Index who{};
  bool is_empty = true;

  PALPATE_FORMULA void add(const Space& here, int camera, Real radius) {
    const auto is_less = first_of(here).phi < first_of(value).phi;
    const Index that = Index{} + camera;
    who = is_empty ? that : (is_less ? that : who);
    value = is_empty ? here : lesser_of(value, here, hull_width(radius));
    is_empty = false;
  }
};
/// The hull of all views so far.
template <class Space, class Real, class Index>
struct JoinedViews {
  Space hull{};
  Real seen_phi{};  ///< of seen-free and remembered space, without the fields
  Index decider{};  ///< the camera that has the greatest value, -1: none

  using Agreed = AgreedViews<Space, Real, Index>;
  using Least = LeastView<Space, Real, Index>;

  /// Begins with the seen-free space of all cameras.
  PALPATE_FORMULA void see(const Agreed& seen) {
    hull = seen.value;
    decider = seen.who;
    seen_phi = first_of(hull).phi;
  }
  /// Joins remembered free space, limited by the surfaces seen now.
  PALPATE_FORMULA void remember(const Agreed& known, const Least& shown, Real radius,
                                const auto& which) {
    const HullWidth<Real> width = hull_width(radius);
    const auto is_known = first_of(known.value).phi < first_of(shown.value).phi;
    take(shifted(lesser_of(known.value, shown.value, width), -width.w),
         is_known ? known.who : shown.who, width, which);
    seen_phi = first_of(hull).phi;
  }
  /// Joins the fields: space that no camera sees has the value on which all of them agree.
  PALPATE_FORMULA void close(const Least& fields, Real radius, const auto& which) {
    take(shifted(fields.value, -agreement(radius)), Index{} - 1, hull_width(radius), which);
  }
  PALPATE_FORMULA auto is_unseen() const {
    return seen_phi < Real{} - static_cast<float>(kSeenBehind);
  }

 private:
  PALPATE_FORMULA void take(const Space& other, const Index& who, const HullWidth<Real>& width,
                            const auto& which) {
    const auto is_other = first_of(other).phi > first_of(hull).phi;
    decider = which & is_other ? who : decider;
    hull = chosen(which, greater_of(hull, other, width), hull);
  }
};

}}  // namespace palpate::v0
