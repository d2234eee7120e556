// What a camera that stands still remembers of what is hidden now: a hand before a table does not
// make everything behind it solid.
#pragma once

#include "palpate/settings/setting_table.h"

namespace palpate {

enum class DepthMemory {
  off,  ///< every frame by itself: all that lies behind its surface is solid
  /// Each pixel keeps the farthest surface that it has seen since that was last contradicted. What
  /// comes before it is as thick as MemoryOptions::thickness, and behind that is what was seen.
  on,
};
constexpr auto names_of(DepthMemory) { return std::array{"off", "on"}; }

/// "Remembering for ever": MemoryOptions::horizon, s.
inline constexpr double kForEver = 1e6;

struct MemoryOptions {
  DepthMemory kind = DepthMemory::off;
  /// What has been hidden for longer is forgotten, s: then all behind what hides it is solid, from
  /// one frame to the next, also where a tool is.
  double horizon = kForEver;
  double thickness = 0.06;  ///< of what comes before what is remembered, m
  /// Share of the depth: what is nearer than what is remembered by more comes before it, and what
  /// is farther by more contradicts it. Wider than the camera's noise.
  double step = 0.02;
};
inline void add_settings(SettingTable& t, MemoryOptions& o) {
  t.add("memory", o.kind,
        "by the field, a camera that stands still: what lies behind something that has come before "
        "it stays known");
  t.add("memory_horizon", o.horizon, {0, kForEver, "s"},
        "memory: what has been hidden for longer is forgotten; 1000000: nothing is");
  t.add("memory_thickness", o.thickness, {1e-3, 10, "m"},
        "memory: of what has come before what is remembered");
  t.add("memory_step", o.step, {1e-3, 1},
        "memory: share of the depth; what is nearer by more has come before what is remembered, "
        "what is farther by more contradicts it");
}

}  // namespace palpate
