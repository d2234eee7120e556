// Cameras prepared for the elements of a hull, the steps of one camera's sample, and the test
// whether a camera sees a whole ball of elements to be free, which then needs no samples. The words
// are explained in hull_kernel.cpp. Included by that file only.
#pragma once

#include <type_traits>

#include "src/contact/field/packed_samples.h"
#include "src/contact/hull/depth_hull.h"
#include "src/contact/internal/hull_rules.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

template <class Sample>
using InSpace = std::conditional_t<std::is_same_v<Sample, Curvature>, SpaceCurvature<VecF>,
                                   SpaceGradient<VecF>>;

// One of a camera's fields at its two moments, the newer one first.
struct FieldPair {
  explicit FieldPair(const MeasureJob& job) : grid(job.fields[0]) {
    for (int f = 0; f < job.num_fields; ++f) pixels[f] = pixels_of(job.fields[f]);
  }

  Grid grid;
  Pixels pixels[2];
};

// A camera, prepared for a group of clusters.
struct Eye {
  explicit Eye(const HullCamera& of)
      : camera(&of),
        seen_free(of.seen_free),
        field(of.field),
        in_front(of.in_front),
        remembered(of.remembered),
        num_fields(of.field.num_fields) {}

  /// Returns the seat of moment f.
  int seat(int f) const { return camera->has_moved ? f : 0; }

  const HullCamera* camera;
  FieldPair seen_free, field, in_front, remembered;
  int num_fields;
};

// Samples of one camera for the vectors of a cluster.
template <class Sample>
struct EyeAnswer {
  Lanes lanes[2][kNumVectors];            // elements in the camera, by seat
  VecF before[2][kNumVectors];            // distance before the eye, by seat
  Sample samples[2][kNumVectors];         // of seen_free by moment
  std::uint32_t used = 0;                 // bits of the vectors that are sampled
  bool queries_in_front = false;          // else nothing in front is near
  Sample in_front[2][kNumVectors];        // by moment
  InSpace<Sample> front[2][kNumVectors];  // the same in the world, with wider pixels
};

/// Calls f(i) for each bit i that is set.
template <class F>
[[gnu::always_inline]] inline void for_each(std::uint32_t bits, const F& f) {
  for (; bits != 0; bits &= bits - 1) f(__builtin_ctz(bits));
}

// Samples a field at moment f for some vectors.
template <class Sample>
void sample(const FieldPair& field, int f, const Lanes* lanes, std::uint32_t vectors, Sample* to) {
  VecI all[kNumVectors] = {};
  for_each(vectors, [&](int i) { all[i] = splat(-1); });
  sample_together<kNumVectors>(field.grid, field.pixels[f], lanes, all, kNumVectors, 1, to);
}
// Samples wider pixels, too, where elements in `which` are deep.
template <class Sample>
void deepen(const FieldPair& field, int f, const Lanes* lanes, const VecI* which,
            std::uint32_t vectors, Sample* known) {
  VecI deep[kNumVectors] = {};
  for_each(vectors, [&](int i) { deep[i] = which[i]; });
  deepen_together<kNumVectors>(field.grid, field.pixels[f], lanes, deep, kNumVectors, known);
}

// Interpolates between a camera's two moments.
template <class Space>
[[gnu::always_inline]] inline Space between(const Eye& eye, const Space (&moments)[2]) {
  if (eye.num_fields == 1) return moments[0];
  return interpolated(moments[1], moments[0], splat(eye.camera->progress));
}

// True if the camera sees all elements in a ball well in front of everything, in its frames from
// first to last.
bool sees_free(const MeasureJob& job, const FieldFrame& frame, int first, int last,
               const Cluster& ball, float largest_radius, float distance) {
  const DepthFieldView& field = job.fields[0];
  const BallWindow window =
      window_of(frame, ball, largest_radius, field.tiles_wide, field.tiles_high);
  const auto last_u = static_cast<float>(field.levels[0].width - 1);
  const auto last_v = static_cast<float>(field.levels[0].height - 1);
  if (!window.is_before_camera() || window.first_u < 0 || window.first_v < 0 ||
      window.last_u > last_u || window.last_v > last_v) {
    return false;
  }
  for (int v = window.top; v <= window.bottom; ++v) {
    for (int u = window.left; u <= window.right; ++u) {
      for (int f = first; f <= last; ++f) {
        const DepthTile& tile = job.fields[f].tiles[v * field.tiles_wide + u];
        if (!is_behind(tile, window.farthest, distance)) return false;
      }
    }
  }
  return true;
}
// True for all its frames.
bool sees_free(const HullCamera& camera, const MeasureJob& job, const Cluster& ball,
               float largest_radius, float distance) {
  const int last = camera.has_moved ? 0 : job.num_fields - 1;
  return sees_free(job, job.frame, 0, last, ball, largest_radius, distance) &&
         (!camera.has_moved ||
          sees_free(job, camera.older.frame, 1, 1, ball, largest_radius, distance));
}
// True if some camera sees all elements in a ball to be free. The one that did so last, `freed_by`,
// is asked first.
bool is_seen_free(const HullJob& job, const Cluster& ball, float largest_radius, int& freed_by) {
  for (int i = 0; i < job.num_seeing; ++i) {
    const int k = i == 0 ? freed_by : (i <= freed_by ? i - 1 : i);
    const HullCamera& camera = job.cameras[k];
    if (!camera.may_see()) continue;
    float distance = largest_radius + free_margin(job.num_seeing, largest_radius);
    if (camera.has_in_front) distance += front_margin(largest_radius);
    if (sees_free(camera, camera.seen_free, ball, largest_radius, distance) &&
        (!camera.has_in_front ||
         sees_free(camera, camera.in_front, ball, largest_radius, distance))) {
      freed_by = k;
      return true;
    }
  }
  return false;
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
