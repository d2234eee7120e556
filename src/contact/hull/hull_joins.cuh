// The hull on the GPU: samples of all views joined into one value for an element, and the test for
// clusters that a camera sees to be free, which need no samples.
#pragma once

#include "src/contact/field/field_elements_cuda.cuh"
#include "src/contact/hull/hull_views.cuh"
#include "src/contact/internal/hull_rules.h"

namespace palpate { inline namespace v0 { namespace {

// Joined value of all views for a ball of this radius, and the camera that decides it (-1: none);
// view(number) is the value of one of them.
template <class Space>
struct Joined {
  Space hull;
  float seen_phi;  // of seen-free and remembered space, without the fields
  int decider;

  __device__ void take(const Space& other, float radius, int camera) {
    if (first_of(other).phi > first_of(hull).phi) decider = camera;
    hull = greater_of(hull, other, hull_width(radius));
  }
};
template <class Space>
__device__ bool is_unseen(const Joined<Space>& at) {
  return at.seen_phi < -static_cast<float>(kSeenBehind);
}
template <class Space>
__device__ Space shifted(const Space& by, float phi) {
  Space shift{};
  set(shift, SpaceGradient<float>{phi});
  return plus(by, 1.0f, shift);
}

// Joins the seen-free space of the cameras.
template <class Space, int kMaxViews, class View>
__device__ Joined<Space> join_seen(const HullQuery<kMaxViews>& query, float radius,
                                   const View& view) {
  Joined<Space> now{view(0), 0, 0};
  float most = first_of(now.hull).phi;
  for (int k = 1; k < query.num_seeing; ++k) {
    const Space here = view(k);
    if (first_of(here).phi > most) now.decider = k;
    most = first_of(here).phi > most ? first_of(here).phi : most;
    now.hull = agreed(now.hull, here, agreement(radius));
  }
  now.seen_phi = first_of(now.hull).phi;
  return now;
}
// Joins memories, too: they count where no camera sees a surface now.
template <class Space, int kMaxViews, class View>
__device__ void join_memories(const HullQuery<kMaxViews>& query, float radius, const View& view,
                              Joined<Space>& to) {
  const HullWidth<float> width = hull_width(radius);
  Space shown = view(0);
  int who = 0, who_knows = 0;
  float most = -1e9f;
  for (int k = 1; k < query.num_seeing; ++k) {
    const Space here = view(k);
    if (first_of(here).phi < first_of(shown).phi) who = k;
    shown = lesser_of(shown, here, width);
  }
  if (!(first_of(shown).phi > first_of(to.hull).phi)) return;
  Space known{};
  bool is_first = true;
  for (int k = 0; k < query.num_cameras; ++k) {
    if (!query.eyes[k].is_remembered) continue;
    const Space here = view(query.num_seeing + k);
    known = is_first ? here : agreed(known, here, agreement(radius));
    is_first = false;
    if (first_of(here).phi > most) who_knows = k;
    most = first_of(here).phi > most ? first_of(here).phi : most;
  }
  if (first_of(known).phi < first_of(shown).phi) who = who_knows;
  to.take(shifted(lesser_of(known, shown, width), -width.w), radius, who);
  to.seen_phi = first_of(to.hull).phi;
}
// Joins the fields: space that no camera sees has the value on which all of them agree.
template <class Space, int kMaxViews, class View>
__device__ Space join_fields(const HullQuery<kMaxViews>& query, float radius, const View& view) {
  Space least = view(query.num_seeing);
  for (int k = 1; k < query.num_cameras; ++k) {
    least = lesser_of(least, view(query.num_seeing + k), hull_width(radius));
  }
  return shifted(least, -agreement(radius));
}
// True if an element touches by what was joined so far: more views may still raise its value.
template <class Space, int kMaxViews>
__device__ bool needs_wider(const HullQuery<kMaxViews>& query, const Joined<Space>& at,
                            float extent) {
  return !query.is_alone && first_of(at.hull).phi < extent;
}

// True if a field of the camera has all elements in a ball well in front of everything. The warp
// together.
__device__ bool sees_free(const HullEye& eye, const FieldLook (&fields)[2], const Cluster& ball,
                          float distance) {
  for (int f = 0; f < eye.num_fields; ++f) {
    const FieldLook& look = fields[f];
    const BallWindow window =
        window_of(look.frame, ball, distance, look.tiles_wide, look.tiles_high);
    if (!window.is_before_camera() || window.first_u < 0 || window.first_v < 0 ||
        window.last_u > look.grid.width - 1.0f || window.last_v > look.grid.height - 1.0f ||
        !is_in_front(look, ball, distance)) {
      return false;
    }
  }
  return true;
}
template <int kMaxViews>
__device__ bool is_seen_free(const HullQuery<kMaxViews>& query, int cluster) {
  const Cluster& ball = query.elements.clusters[cluster];
  const float largest = query.elements.largest_radius[cluster];
  for (int k = 0; k < query.num_seeing; ++k) {
    const HullEye& eye = query.eyes[k];
    float distance = largest + free_margin(query.num_seeing, largest);
    if (eye.has_in_front) distance += front_margin(largest);
    if (sees_free(eye, eye.seen_free, ball, distance) &&
        (!eye.has_in_front || sees_free(eye, eye.in_front, ball, distance))) {
      return true;
    }
  }
  return false;
}
// True if a surface that came before a remembered one may be near.
template <int kMaxViews>
__device__ bool queries_in_front(const HullQuery<kMaxViews>& query, int view, int cluster) {
  const HullEye& eye = eye_of(query, view);
  if (!eye.has_in_front) return false;
  const float distance = front_limit(query.elements.largest_radius[cluster]);
  return !sees_free(eye, eye.in_front, query.elements.clusters[cluster], distance);
}

}}}  // namespace palpate::v0
