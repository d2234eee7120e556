// The part of a tool that one camera by itself has not seen, on a GPU: the rules of unseen_in_group
// (field_kernel.cpp), of which this is the text for threads.
#pragma once

#include "src/contact/field/field_elements_cuda.cuh"

namespace palpate { inline namespace v0 {

/// The fields of a camera by itself on a GPU. The second one, of a memory, shows what is measured
/// now.
struct OneCamera {
  DepthFieldView fields[2];
  std::int32_t num = 0;  ///< 0: not one by itself
};

namespace {

// True if a pixel was measured, or lies inside a measured surface.
__device__ inline bool is_measured(const DepthFieldView& field, int column, int row, float slope) {
  if (!(slope > 0)) return false;
  if (field.filled_behind == nullptr) return true;
  const std::uint32_t word = field.filled_behind[row * field.filled_stride + column / 32];
  return (word >> column % 32 & 1) == 0;
}

// True if the camera has seen a point of its frame.
__device__ inline bool is_seen_by(const OneCamera& camera, const FieldFrame& frame,
                                  const float (&p)[3]) {
  const DepthFieldLevel& image = camera.fields[0].levels[0];
  if (!(p[2] > kMinDepth)) return false;
  const ElementLook at = look_at(frame, p);
  const float u = at.from_u + (frame.cx + 0.5f), v = at.from_v + (frame.cy + 0.5f);
  if (!(u >= 0 && v >= 0 && u < static_cast<float>(image.width) &&
        v < static_cast<float>(image.height))) {
    return false;
  }
  const int column = static_cast<int>(u), row = static_cast<int>(v);
  for (int k = 0; k < camera.num; ++k) {
    const DepthFieldLevel& level = camera.fields[k].levels[0];
    const float* const plane = level.planes + 2 * (std::ptrdiff_t{row} * level.stride + column);
    if (!is_measured(camera.fields[k], column, row, plane[1])) return false;
    if (k > 0) continue;  // behind a new surface space is remembered
    if (!(plane[0] - at.depth * plane[1] >= -static_cast<float>(kSeenBehind))) return false;
  }
  return true;
}

// Returns the unseen volume (m3) of the elements of this lane, in every `step`-th cluster from
// `first` on.
__device__ inline double unseen_volume(const OneCamera& camera, const ElementsView& elements,
                                       const FieldFrame& frame, int first, int step) {
  double sum = 0;
  for (int cluster = first; cluster < elements.num_clusters; cluster += step) {
    const Element e = element_of(elements, cluster, frame);
    if (is_seen_by(camera, frame, e.p)) continue;
    const float ball = static_cast<float>(4 * kPi / 3) * e.radius * e.radius * e.radius;
    sum += static_cast<double>(e.factor * ball);
  }
  return sum;
}

}  // namespace
}}  // namespace palpate::v0
