// The place of a vector of spheres in one image, and the nearest space there. Included by kernel
// files only.
#pragma once

#include "src/contact/clearance/search/image_search.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

// Signed distances to the planes of an image's border, positive in front of all of it.
struct BorderDistance {
  VecF value;
  VecI number;
};
PALPATE_LANE_INLINE BorderDistance border_distance(const Image& image, const CameraPoint<VecF>& p) {
  BorderDistance least{splat(kFarAway), VecI{}};
  for (int k = 0; k < 4; ++k) {
    const float(&n)[3] = image.border[k];
    const VecF d = n[0] * p.x + n[1] * p.y + n[2] * p.z;
    least.number = select(d < least.value, splat(k), least.number);
    least.value = min(d, least.value);
  }
  return least;
}

// The place of points in an image, and their own pixels.
struct Sight {
  VecI is_solid;  // the point is
  VecI is_in_image;
  VecI column, row;
  VecF depth;
};
PALPATE_LANE_INLINE Sight sight_of(const Image& image, const SphereLanes& spheres) {
  const CameraPoint<VecF>& p = spheres.at;
  Sight sight;
  const VecI is_in_front = p.z > splat(1e-3f);
  const VecF per_z = 1.0f / select(is_in_front, p.z, splat(1.0f));
  const VecF u = p.x * per_z * image.fx + (image.cx + 0.5f);
  const VecF v = p.y * per_z * image.fy + (image.cy + 0.5f);
  sight.is_in_image = is_in_front & (u >= VecF{}) & (v >= VecF{}) &
                      (u < splat(static_cast<float>(image.width))) &
                      (v < splat(static_cast<float>(image.height)));
  const VecI column = sight.column = select(sight.is_in_image, to_int(u), VecI{});
  const VecI row = sight.row = select(sight.is_in_image, to_int(v), VecI{});
  const VecI place = ((row >> 2) * image.blocks_wide[0] + (column >> 2)) * kPerBlock +
                     ((row & 3) << 2) + (column & 3);
  const VecF depth = sight.depth = gather(image.nearest[0], place);
  sight.is_solid = sight.is_in_image & (p.z >= depth) & (p.z <= depth + image.solid_behind);
  if (image.is_blocked_outside != 0) sight.is_solid |= ~sight.is_in_image;
  return sight;
}

PALPATE_LANE_INLINE SphereLanes spheres_at(const ClearanceJob& job, const ClearanceCamera& camera,
                                           std::size_t slot) {
  const ClusterView& c = job.spheres;
  const VecF x = load(&c.x[slot]), y = load(&c.y[slot]), z = load(&c.z[slot]);
  const auto row = [&](int k) {
    const float(&r)[3] = camera.R_CT[k];
    return r[0] * x + r[1] * y + r[2] * z + camera.p_CT[k];
  };
  return {{row(0), row(1), row(2)}, load(&c.radius[slot])};
}

// A border in place of a pixel: -2 - its number.
PALPATE_LANE_INLINE VecI border_pixel(VecI number) { return ~number + (-1); }

// Takes the border of an image where it is nearer than what a lane has.
PALPATE_LANE_INLINE void offer_border(const Image& image, const SphereLanes& spheres, VecI lanes,
                                      Found& found) {
  const BorderDistance border = border_distance(image, spheres.at);
  const VecF d = max(border.value, VecF{});
  const VecI is_nearer = lanes & (d * d < found.distance2);
  found.distance2 = select(is_nearer, d * d, found.distance2);
  found.pixel = select(is_nearer, border_pixel(border.number), found.pixel);
}

// Finds the nearest solid space in an image, or border, from outside of it. `kSingle`: for one
// lane.
template <bool kSingle>
PALPATE_LANE_CODE inline void look_outside(const Image& image, const SphereLanes& spheres,
                                           VecI lanes, float& best, float enough, bool is_shared,
                                           Found& found) {
  if (image.is_blocked_outside != 0) offer_border(image, spheres, lanes, found);
  if (!is_any_set(lanes)) return;
  ImageSearch<true, kSingle> search(image, spheres, lanes, found, best, enough, is_shared);
  search.run();
  if (is_shared) best = search.best();
}

// The nearest free space in an image, from inside of its solid space. `kSingle`: for one lane.
template <bool kSingle>
PALPATE_LANE_CODE inline void look_inside(const Image& image, const SphereLanes& spheres,
                                          const Sight& sight, VecI lanes, float best,
                                          Found& found) {
  if (!is_any_set(lanes)) return;
  if (image.is_blocked_outside == 0) {
    offer_border(image, spheres, lanes & sight.is_in_image, found);
  }
  ImageSearch<false, kSingle>(image, spheres, lanes, found, best, 0, false).run();
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
