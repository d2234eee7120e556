// Memory of one pixel (docs/decisions/0033-memory.md): shared code for CPU
// and GPU.
#pragma once

#include <cstdint>

#include "palpate/field/depth_field.h"
#include "src/field/pyramid/field_pixels.h"

namespace palpate { inline namespace v0 {

/// Smallest number of frames that show a surface before it is remembered: an object that flies
/// through the image, or a wrong measurement, for one frame is not.
inline constexpr std::int32_t kMinSeen = 3;
/// Depth that stands for "nothing is in front here": a surface out of reach of any sphere, not a
/// hole, which its surroundings would close.
inline constexpr float kNothingInFront = 1000.0f;

struct MemoryRule {
  float horizon = 0;  ///< s
  float step = 0;     ///< as MemoryOptions
};
inline MemoryRule memory_rule(const MemoryOptions& options) {
  return {static_cast<float>(options.horizon), static_cast<float>(options.step)};
}

/// Options of the field of surfaces in front.
inline DepthFieldOptions options_of_in_front(const DepthFieldOptions& field,
                                             const MemoryOptions& memory) {
  DepthFieldOptions options;
  options.fill_levels = field.fill_levels;
  options.unseen = UnseenSpace::free;
  options.thickness = memory.thickness / 2;  // from there on out of the back
  return options;
}

struct PixelMemory {
  TangentPlane plane;  ///< as it was seen last
  float depth = 0;     ///< when it was seen first, which later depths are compared with; 0: nothing
  float hidden = 0;    ///< time since it was last seen, s
  std::int32_t num_seen = 0;  ///< number of frames, at most kMinSeen
};

/// A pixel's frame, split into surfaces behind and in front.
struct MemoryPlanes {
  TangentPlane behind, in_front;
};

/// Updates a pixel by the current plane, at depth z (m) if z is positive, `interval` s after the
/// frame before.
PALPATE_HOSTDEV inline MemoryPlanes remember(const TangentPlane& now, float z,
                                             const MemoryRule& rule, float interval,
                                             PixelMemory& memory) {
  const TangentPlane nothing{kNothingInFront, 1};
  const float step = rule.step * memory.depth;
  const bool is_seen = z > 0, is_hidden = z < memory.depth - step;
  const bool is_same = is_seen && !is_hidden && !(z > memory.depth + step);
  memory.hidden = is_same ? 0 : memory.hidden + interval;
  const bool is_remembered = memory.num_seen >= kMinSeen && !(memory.hidden > rule.horizon);
  if (is_same) {
    memory.num_seen = memory.num_seen < kMinSeen ? memory.num_seen + 1 : kMinSeen;
    memory.plane = now;
    return {now, nothing};
  }
  if (!is_seen) return {is_remembered ? memory.plane : TangentPlane{}, TangentPlane{}};
  if (is_hidden && is_remembered) return {memory.plane, now};
  memory = {now, z, 0, 1};  // it begins, was contradicted or has been forgotten
  return {now, nothing};
}

}}  // namespace palpate::v0
