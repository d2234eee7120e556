// The hull on the GPU: samples of all views joined into one value for an element, and the test for
// clusters that a camera sees to be free, which need no samples.
#pragma once

#include "src/contact/field/field_elements_cuda.cuh"
#include "src/contact/hull/hull_views.cuh"
#include "src/contact/internal/hull_rules.h"

namespace palpate { inline namespace v0 { namespace {

template <class Space>
using Joined = JoinedViews<Space, float, int>;

// Joins the seen-free space of the cameras; view(number) is the value of one view.
template <class Space, int kMaxViews, class View>
__device__ Joined<Space> join_seen(const HullQuery<kMaxViews>& query, float radius,
                                   const View& view) {
  typename Joined<Space>::Agreed seen;
  for (int k = 0; k < query.num_seeing; ++k) seen.add(view(k), k, radius);
  Joined<Space> now;
  now.see(seen);
  return now;
}
// Joins memories, too: they count where no camera sees a surface now.
template <class Space, int kMaxViews, class View>
__device__ void join_memories(const HullQuery<kMaxViews>& query, float radius, const View& view,
                              Joined<Space>& to) {
  typename Joined<Space>::Least shown;
  for (int k = 0; k < query.num_seeing; ++k) shown.add(view(k), k, radius);
  if (!(first_of(shown.value).phi > first_of(to.hull).phi)) return;
  typename Joined<Space>::Agreed known;
  for (int k = 0; k < query.num_cameras; ++k) {
    if (query.eyes[k].is_remembered) known.add(view(query.num_seeing + k), k, radius);
  }
  to.remember(known, shown, radius, true);
}
// Joins the fields of all cameras, the other half of the views.
template <class Space, int kMaxViews, class View>
__device__ typename Joined<Space>::Least join_fields(const HullQuery<kMaxViews>& query,
                                                     float radius, const View& view) {
  typename Joined<Space>::Least least;
  for (int k = 0; k < query.num_cameras; ++k) least.add(view(query.num_seeing + k), k, radius);
  return least;
}
// True if an element touches by what was joined so far: more views may still raise its value.
template <class Space, int kMaxViews>
__device__ bool needs_wider(const HullQuery<kMaxViews>& query, const Joined<Space>& at,
                            float extent) {
  return !query.is_alone && first_of(at.hull).phi < extent;
}

// True if a field of the camera has all elements in a ball well in front of everything. The warp
// together.
__device__ bool sees_free(const HullEye& eye, const FieldFrame (&frames)[2],
                          const FieldLook (&fields)[2], const Cluster& ball, float distance) {
  for (int f = 0; f < eye.num_fields; ++f) {
    FieldLook look = fields[f];
    look.frame = frames[eye.has_moved ? f : 0];
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
__device__ bool is_seen_free(const HullQuery<kMaxViews>& query, const PosedTool<kMaxViews>& tool,
                             int cluster) {
  const Cluster& ball = tool.elements.clusters[cluster];
  const float largest = tool.elements.largest_radius[cluster];
  for (int k = 0; k < query.num_seeing; ++k) {
    const HullEye& eye = query.eyes[k];
    float distance = largest + free_margin(query.num_seeing, largest);
    if (eye.has_in_front) distance += front_margin(largest);
    if (sees_free(eye, tool.in_eyes[k], eye.seen_free, ball, distance) &&
        (!eye.has_in_front || sees_free(eye, tool.in_eyes[k], eye.in_front, ball, distance))) {
      return true;
    }
  }
  return false;
}
// True if a surface that came before a remembered one may be near.
template <int kMaxViews>
__device__ bool queries_in_front(const HullQuery<kMaxViews>& query,
                                 const PosedTool<kMaxViews>& tool, int view, int cluster) {
  const int k = eye_of(query, view);
  const HullEye& eye = query.eyes[k];
  if (!eye.has_in_front) return false;
  const float distance = front_limit(tool.elements.largest_radius[cluster]);
  return !sees_free(eye, tool.in_eyes[k], eye.in_front, tool.elements.clusters[cluster], distance);
}

}}}  // namespace palpate::v0
