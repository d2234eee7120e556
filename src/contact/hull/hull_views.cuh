// Cameras of a hull on the GPU, and their samples for one element of the tool. The words are those
// of hull_kernel.cpp, but that a thread has one element here instead of a vector of them.
#pragma once

#include <cstdint>
#include <type_traits>

#include "src/contact/field/field_elements_cuda.cuh"
#include "src/contact/internal/hull_rules.h"

namespace palpate { inline namespace v0 {

// A camera on the GPU: its fields, the newer one first.
struct HullEye {
  FieldLook seen_free[2], field[2], in_front[2], remembered[2];
  float R_WC[2][3][3] = {};
  float progress = 1;
  std::int32_t num_fields = 1;
  bool has_moved = false;     // between its frames
  bool has_in_front = false;  // a camera by itself, with a memory
  bool is_remembered = false;
  std::int32_t number = 0;  // in the call
};

// The cameras of a query; an argument of kernels. Few cameras make it short.
constexpr int kFewCameras = 4;
template <int kMaxViews>
struct HullQuery {
  std::int32_t num_cameras = 0;
  std::int32_t num_seeing = 0;  ///< cameras that show something now come first
  bool has_memory = false;
  bool is_alone = false;  ///< as HullJob
  HullEye eyes[kMaxViews];
};

/// A tool and its pose, in the world and in all cameras.
template <int kMaxViews>
struct PosedTool {
  ElementsView elements;
  FieldFrame in_world;
  FieldFrame in_eyes[kMaxViews][2];  ///< by seat
};

namespace {

template <class Sample>
using InSpace = std::conditional_t<std::is_same_v<Sample, Curvature>, SpaceCurvature<float>,
                                   SpaceGradient<float>>;

// An element of the tool: its center, from the tool's center of mass, its radius, and the extent up
// to which values count.
struct Ball {
  float x, y, z, radius, extent;
};
// Computes the center of a ball in the frame of a camera.
__device__ inline void place(const FieldFrame& frame, const Ball& ball, float (&p)[3]) {
  for (int row = 0; row < 3; ++row) {
    const float(&r)[3] = frame.R_WT[row];
    p[row] = r[0] * ball.x + r[1] * ball.y + r[2] * ball.z + frame.p_WC[row];
  }
}

// Interpolates a field between the camera's two frames; behind the camera all is free, or blocked
// if it `is_closed`.
template <class Sample>
__device__ InSpace<Sample> between(const HullEye& eye, const FieldFrame (&frames)[2],
                                   const FieldLook (&fields)[2], const Ball& ball, bool is_closed,
                                   bool queries_in_front) {
  InSpace<Sample> now{};
  float p[3] = {};
#pragma unroll 1
  for (int f = 0; f < eye.num_fields; ++f) {
    const int seat = eye.has_moved ? f : 0;
    const FieldFrame& frame = frames[seat];
    place(frame, ball, p);
    InSpace<Sample> here{};
    if (p[2] > kMinDepth) {
      const ElementLook at = look_at(frame, p);
      here = in_world(eye.R_WC[seat], frame, at, query_deep<Sample>(fields[f], at, ball.radius),
                      ball.radius, ball.extent);
      if (queries_in_front) {
        const auto front = rotated_to_world(eye.R_WC[seat], frame, at,
                                            query_deep<Sample>(eye.in_front[f], at, ball.radius));
        here = lesser_of(here, front, hull_width(ball.radius));
      }
    } else {
      set(here, SpaceGradient<float>{free_limit(ball.radius, ball.extent)});
    }
    const float before = p[2] - kMinDepth;
    if (is_closed && eye.has_moved) here = before_eye(eye.R_WC[seat], here, before, ball.radius);
    now = f == 0 ? here : interpolated(here, now, eye.progress);
  }
  return is_closed && !eye.has_moved ? before_eye(eye.R_WC[0], now, p[2] - kMinDepth, ball.radius)
                                     : now;
}

// A view is one field of one camera. First the seen-free space of each camera, then the fields; for
// memories the surfaces that each camera sees, then the remembered free space of each.
template <int kMaxViews>
__device__ int num_views(const HullQuery<kMaxViews>& query) {
  return query.is_alone ? 1 : query.num_seeing + query.num_cameras;
}
template <int kMaxViews>
__device__ int eye_of(const HullQuery<kMaxViews>& query, int view) {
  return view < query.num_seeing ? view : view - query.num_seeing;
}
template <class Sample, int kMaxViews>
__device__ InSpace<Sample> query_view(const HullQuery<kMaxViews>& query,
                                      const PosedTool<kMaxViews>& tool, int view, const Ball& ball,
                                      bool queries_in_front) {
  const bool is_seen = view < query.num_seeing;
  const int k = eye_of(query, view);
  const HullEye& eye = query.eyes[k];
  return between<Sample>(eye, tool.in_eyes[k], is_seen ? eye.seen_free : eye.field, ball,
                         is_seen && !query.is_alone, queries_in_front);
}
template <class Sample, int kMaxViews>
__device__ InSpace<Sample> query_memory(const HullQuery<kMaxViews>& query,
                                        const PosedTool<kMaxViews>& tool, int view,
                                        const Ball& ball) {
  const bool is_seen = view < query.num_seeing;
  const int k = eye_of(query, view);
  const HullEye& eye = query.eyes[k];
  if (!is_seen && !eye.is_remembered) return {};
  return between<Sample>(eye, tool.in_eyes[k], is_seen ? eye.in_front : eye.remembered, ball,
                         !is_seen, false);
}

// True if a ball has a value. A single camera knows nothing of the space behind its eye.
template <int kMaxViews>
__device__ bool is_complete(const HullQuery<kMaxViews>& query, const PosedTool<kMaxViews>& tool,
                            const Ball& ball) {
  if (!query.is_alone) return true;
  const HullEye& eye = query.eyes[0];
  for (int seat = 0; seat < (eye.has_moved ? eye.num_fields : 1); ++seat) {
    float p[3];
    place(tool.in_eyes[0][seat], ball, p);
    if (!(p[2] > kMinDepth)) return false;
  }
  return true;
}

}  // namespace
}}  // namespace palpate::v0
