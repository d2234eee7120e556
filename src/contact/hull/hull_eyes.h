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
  FieldPair() = default;
  explicit FieldPair(const MeasureJob& job) : grid(job.fields[0]) {
    for (int f = 0; f < job.num_fields; ++f) pixels[f] = pixels_of(job.fields[f]);
  }

  Grid grid;
  Pixels pixels[2];
};

// A camera, prepared for a group of clusters.
struct Eye {
  Eye(const HullCamera& of, bool has_memory)
      : camera(&of), seen_free(of.seen_free), field(of.field), num_fields(of.field.num_fields) {
    if (has_memory || of.has_in_front) in_front = FieldPair(of.in_front);
    if (of.is_remembered) remembered = FieldPair(of.remembered);
  }

  /// Returns the seat of moment f.
  int seat(int f) const { return camera->has_moved ? f : 0; }

  const HullCamera* camera;
  FieldPair seen_free, field, in_front, remembered;
  int num_fields;
};

// Samples of one camera for the vectors of a cluster.
template <class Sample>
struct EyeAnswer {
  EyeAnswer() {}

  Lanes lanes[2][kNumVectors];      // elements in the camera, by seat
  VecF before[2][kNumVectors];      // distance before the eye, by seat
  Sample samples[2][kNumVectors];   // of seen_free by moment
  std::uint32_t used = 0;           // bits of the vectors that are sampled
  bool queries_in_front = false;    // else nothing in front is near
  Sample in_front[2][kNumVectors];  // by moment
  union {
    InSpace<Sample> front[2][kNumVectors];  // the same in the world, with wider pixels
  };
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

// Interpolates between a camera's two moments; at(f) is the value at moment f.
template <class F>
[[gnu::always_inline]] inline auto between(const Eye& eye, const F& at) {
  if (eye.num_fields == 1) return at(0);
  return interpolated(at(1), at(0), splat(eye.camera->progress));
}

// Bounds of the planes that each camera shows around a ball of elements; nearest is 0 where a bound
// shows none of them to be free.
struct Bounds {
  static constexpr int kMaxMisses = 3;

  DepthTile of[kMaxCameras];
  int misses[kMaxCameras] = {};  ///< balls for which a camera had no bound, one after the other
};

DepthTile lesser_of(const DepthTile& a, const DepthTile& b) {
  return {std::min(a.nearest, b.nearest), std::min(a.min_slope, b.min_slope)};
}
// True if the camera sees all elements in a ball well in front of everything, in its frames from
// first to last. `bound`: of all of them, if somebody asks.
bool sees_free(const MeasureJob& job, const FieldFrame& frame, int first, int last,
               const Cluster& ball, float largest_radius, float distance,
               DepthTile* bound = nullptr) {
  const DepthFieldView& field = job.fields[0];
  const BallWindow window =
      window_of(frame, ball, largest_radius, field.tiles_wide, field.tiles_high);
  const auto last_u = static_cast<float>(field.levels[0].width - 1);
  const auto last_v = static_cast<float>(field.levels[0].height - 1);
  if (!window.is_before_camera() || window.first_u < 0 || window.first_v < 0 ||
      window.last_u > last_u || window.last_v > last_v) {
    return false;
  }
  bool is_free = true;
  for (int f = first; f <= last && is_free; ++f) {
    is_free = are_behind(job.fields[f], window, distance);
  }
  if (bound == nullptr || is_free) return is_free;
  *bound = bound_of(job.fields[first], window, distance);
  if (last > first && is_known(*bound)) {
    *bound = lesser_of(*bound, bound_of(job.fields[last], window, distance));
  }
  return false;
}
// True for all its frames.
bool sees_free(const HullCamera& camera, const MeasureJob& job, const Cluster& ball,
               float largest_radius, float distance, DepthTile* bound = nullptr) {
  if (!camera.has_moved) {
    return sees_free(job, job.frame, 0, job.num_fields - 1, ball, largest_radius, distance, bound);
  }
  return sees_free(job, job.frame, 0, 0, ball, largest_radius, distance) &&
         sees_free(job, camera.older.frame, 1, 1, ball, largest_radius, distance);
}
// True if some camera sees all elements in a ball to be free. The one that did so last, `freed_by`,
// is asked first, and who had no bound for a few balls no more. Else `bounds` are those of all.
bool is_seen_free(const HullJob& job, const Cluster& ball, float largest_radius, int& freed_by,
                  Bounds& bounds) {
  for (int i = 0; i < job.num_seeing; ++i) {
    const int k = i == 0 ? freed_by : (i <= freed_by ? i - 1 : i);
    const HullCamera& camera = job.cameras[k];
    bounds.of[k] = {};
    if (!camera.may_see() || (i > 0 && bounds.misses[k] >= Bounds::kMaxMisses)) continue;
    float distance = largest_radius + free_margin(job.num_seeing, largest_radius);
    if (camera.has_in_front) distance += front_margin(largest_radius);
    if (sees_free(camera, camera.seen_free, ball, largest_radius, distance, &bounds.of[k]) &&
        (!camera.has_in_front ||
         sees_free(camera, camera.in_front, ball, largest_radius, distance))) {
      freed_by = k;
      bounds.misses[k] = 0;
      return true;
    }
    bounds.misses[k] = is_known(bounds.of[k]) ? 0 : bounds.misses[k] + 1;
  }
  return false;
}
// Finds the elements of a vector that bounds show to be free: those above `enough` are.
VecI is_free_by(const HullJob& job, const Bounds& bounds, const ElementRows& rows, std::size_t slot,
                VecF enough) {
  // A little more than the largest amount by which rounding may lower what is sampled.
  const VecF margin = free_margin(job.num_seeing, load(rows.radius + slot));
  const VecF limit = 1.0001f * (max(enough, VecF{}) + margin) + 1e-6f;
  VecI is_free{};
  for (int k = 0; k < job.num_seeing; ++k) {
    const DepthTile& bound = bounds.of[k];
    if (!is_known(bound)) continue;
    const FieldFrame& frame = job.cameras[k].seen_free.frame;
    const float(&r)[3] = frame.R_WT[2];
    const VecF z = r[0] * load(rows.x + slot) + r[1] * load(rows.y + slot) +
                   r[2] * load(rows.z + slot) + frame.p_WC[2];
    is_free |= min(bound.min_slope * (bound.nearest - z), z - kMinDepth) > limit;
  }
  return is_free;
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
