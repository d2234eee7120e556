// Everything that decides the numbers of a run, beside tool, frames and hand.
#pragma once

#include <optional>
#include <vector>

#include "palpate/bodies/scene_object.h"
#include "palpate/cloud/depth_binning.h"
#include "palpate/contact/contact_query.h"
#include "palpate/field/surface_timeline.h"
#include "palpate/haptics/coupling.h"
#include "palpate/haptics/safety.h"

namespace palpate {

/// Live on a CPU, by the field: a frame is made into a surface where the tool can be until the next
/// ones replace it, and around as far as that takes. The rest follows if a picture needs it.
struct WindowOptions {
  bool enabled = true;
  /// How fast the tool is always expected to move, m/s; if it moves faster, twice its speed.
  double speed = 0.5;
};
inline void add_settings(SettingTable& t, WindowOptions& o) {
  t.section("window");
  t.add("enabled", o.enabled,
        "live on a CPU, by the field: make surfaces where the tool can be, not everywhere");
  t.add("speed", o.speed, {0, 100, "m/s"},
        "how fast the tool is expected to move at least; a faster one is given room for twice its "
        "speed");
}

struct RunSettings {
  ContactOptions contact;
  SurfaceOptions surface;
  DepthFieldOptions field;
  TimeOptions time;
  WindowOptions window;
  /// Where surfaces and queries are computed; none: the fastest one that works here.
  std::optional<Backend> backend = Backend::cpu;
  int sensing_gpu = 0, contact_gpu = 0;
  int num_threads = 0;         ///< for surfaces
  int binning = 1;             ///< surfaces are made of images so many times smaller
  int num_spheres = 0;         ///< queries ask so many of the tool's spheres; 0: all
  bool may_thin = true;        ///< live: less is computed before the force is lost
  double contact_rate = 1000;  ///< queries per second, at most
  CouplingOptions coupling;    ///< checked by the loop
  SafetyOptions safety;
  bool wants_real_time = true;  ///< SCHED_FIFO and locked memory where that is allowed
  std::vector<SceneObject> objects;
  BodyOptions bodies;  ///< of objects that move
};
inline void add_settings(SettingTable& t, RunSettings& s) {
  add_settings(t, s.contact);
  add_settings(t, s.surface);
  add_settings(t, s.field);
  add_settings(t, s.time);
  add_settings(t, s.window);
  t.section("loop");
  t.add("backend", s.backend,
        "where surfaces and queries are computed; auto: on a GPU if there is one");
  t.add("sensing_gpu", s.sensing_gpu, {0, 63}, "cuda: which GPU makes the surfaces");
  t.add("contact_gpu", s.contact_gpu, {0, 63}, "cuda: which GPU computes queries");
  t.add("threads", s.num_threads, {0, 256, "threads"},
        "for surfaces, and at most so many for queries of large tools; 0: one per core");
  t.add("binning", s.binning, {1, kMaxBinning, "pixels"},
        "of the depth image become one, along each side, before its surface is made");
  t.add("spheres", s.num_spheres, {0, 1 << 30, "spheres"},
        "of the tool, the first ones, are asked by queries; 0: all");
  t.add("thin_out", s.may_thin,
        "live: before the force is lost because the computer cannot keep up, draw the page less, "
        "then make images smaller (binning) or ask fewer spheres, until it can");
  t.add("contact_rate", s.contact_rate, {1, 100000, "Hz"}, "queries per second, at most");
  t.add("real_time", s.wants_real_time,
        "real-time scheduling and locked memory where they are allowed");
  add_settings(t, s.coupling);
  add_settings(t, s.safety);
  add_settings(t, s.bodies);
}

/// What a running loop keeps when its settings are changed, with all that it has seen and felt so
/// far; what it does not keep begins anew, the tool where it is. A repetition does the same.
bool keeps_surfaces(const RunSettings& before, const RunSettings& after);
bool keeps_coupling(const RunSettings& before, const RunSettings& after);
/// Do some of the objects move?
bool has_moving_objects(const RunSettings& settings);
/// Does anything that the tool may touch have friction or damping?
bool has_friction(const RunSettings& settings);
/// Do queries read depth-change vectors?
bool needs_depth_change(const RunSettings& settings);
/// Can this setting not change while the loop runs?
bool is_fixed_while_running(const Setting& setting);

}  // namespace palpate
