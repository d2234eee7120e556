// A run: its settings, the loops that drive it, and the pictures that they give.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/contact/body_contact.h"
#include "palpate/contact/contact.h"
#include "palpate/core/core.h"
#include "palpate/field/sensor.h"
#include "palpate/haptics/coupling.h"
#include "palpate/haptics/safety.h"
#include "palpate/run/records.h"

namespace palpate::inline v0 {

// Everything that decides the numbers of a run, beside tool, frames and hand.

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
  OutputOptions output;
  /// Of each camera, which stands still; null, or fewer than cameras: none.
  std::vector<std::shared_ptr<const MaterialRegions>> regions;
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
  add_settings(t, s.output);
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

// Pictures of a run for humans who look on: how the spheres are, and the surface.

/// Who looks at contacts while they are made, each at pictures of its own.
enum class Onlooker { page, robots };
inline constexpr std::size_t kNumOnlookers = 2;

/// How every sphere of the tool was at one contact.
struct ContactPicture {
  std::uint64_t contact_number = 0, frame_number = 0;
  Pose X_WT;
  BodyPoses bodies;  ///< of objects that move
  SpherePicture spheres;
};

/// The newest surface, as it was estimated: per pixel a point with normal and depth-change vector.
struct SurfacePicture {
  std::uint64_t frame_number = 0;
  int width = 0, height = 0;
  std::vector<Vec3f> points, normals;  ///< NaN where there is none
  std::vector<Vec3f> edges;            ///< depth-change vectors; empty if they are not looked for
};

inline void make_surface_picture(const PointCloud& seen, std::uint64_t frame_number,
                                 SurfacePicture& picture) {
  picture.frame_number = frame_number;
  picture.width = seen.width();
  picture.height = seen.height();
  picture.points.resize(seen.size());
  picture.normals.resize(seen.size());
  picture.edges.resize(seen.has_edges() ? seen.size() : 0);
  for (std::size_t i = 0; i < seen.size(); ++i) {
    picture.points[i] = seen.point(i);
    picture.normals[i] = seen.normal(i);
    if (seen.has_edges()) picture.edges[i] = seen.edge(i);
  }
}

// A run while it goes on: live, or on a simulated clock.
//
// Live, five threads are joined by triple buffers (thesis Fig. 4.1):
//
//   sensor --> surface --> contact <==> haptic (the device's own thread) --> publishing
//
// The haptic thread works on the last LocalContact and never waits for a query; queries look at the
// newest surfaces and never wait for a frame.
//
// On a simulated clock one thread does all in turn, and the same input gives the same bits.

/// What is recorded or shown while the loop runs. Called from the publishing thread alone; may take
/// its time: what does not fit into the queues meanwhile is counted as lost, and the loop goes on.
struct RunObserver {
  std::function<void(const FrameRecord&, const DepthFrame&)> on_frame = {};
  std::function<void(const ContactRecord&)> on_contact = {};
  std::function<void(std::span<const TickRecord>)> on_ticks = {};
  /// Once a second of ticks, before the tick that it names.
  std::function<void(const HandMoment&)> on_moment = {};
  /// Before the first frame, contact or tick of a new revision; not for revision 0.
  std::function<void(std::uint32_t revision, const RunSettings&)> on_settings = {};
  /// What the loop has done by itself, for humans.
  std::function<void(std::string_view)> on_note = {};
};

/// Stages, each with what it took and how late it was.
struct LoopTimes {
  LatencyHistogram haptic_compute, haptic_period, contact_compute, surface_compute;
  /// haptic_compute without the time in which the scheduler ran others on that core.
  LatencyHistogram haptic_cpu;
  LatencyHistogram contact_age, sensor_to_force;
};

struct LoopReport {
  std::uint64_t num_ticks = 0, num_contacts = 0, num_frames = 0;
  std::uint64_t num_missed = 0;  ///< ticks whose own computing took longer than a tick
  std::uint64_t num_lost_records = 0;
  std::uint64_t num_left_out = 0;  ///< frames that came while the one before was being worked on
  std::uint64_t num_spared_stiffnesses = 0;  ///< contacts that came with an older stiffness
  std::vector<std::string> notes;  ///< e.g. that the scheduler refused real time, and what to do
  /// Who was run how, e.g. "surface", "nice -5"; empty on a simulated clock.
  std::vector<std::pair<std::string, std::string>> scheduling;
  /// s, of the run, with a page drawn less, smaller images, fewer spheres: see loop.thin_out.
  double page_thinned = 0, image_thinned = 0, spheres_thinned = 0;
  Fault fault = Fault::none;     ///< the lasting one that has ended the loop
  std::uint32_t num_faults = 0;  ///< that the safety filter has found, passing ones too
  double seconds = 0;            ///< on the run's clock
  std::string ending;  ///< what has ended the run by itself, e.g. "the depth frames have ended"
};

/// Of a loop on a simulated clock.
struct SimulatedClock {
  /// Time stamp of the frame that is felt from the beginning on: time 0. None: that of the first
  /// frame, of each camera.
  std::optional<double> zero = {};
  bool ends_with_frames = true;  ///< one period after a camera's last one; else that one stays
  bool keeps_pace = false;       ///< no tick comes before its time, for humans who look on
};

class RunLoop {
 public:
  /// `tool`, `sources` and `device` must outlive it. Several cameras are joined to a depth hull (by
  /// the field). Errors: settings out of range, the backend.
  static Result<std::unique_ptr<RunLoop>> create(const Tool& tool, const DepthSources& sources,
                                                 HapticDevice& device, const RunSettings& settings,
                                                 RunObserver observer = {});
  static Result<std::unique_ptr<RunLoop>> create(const Tool&&, const DepthSources&, HapticDevice&,
                                                 const RunSettings&, RunObserver = {}) = delete;
  /// On the device's simulated clock: tick after tick as fast as can be, in a thread of its own,
  /// which the observer is called from. Nothing is lost. A frame becomes current at the first tick
  /// that is not before its time stamp; of several the newest.
  static Result<std::unique_ptr<RunLoop>> create(const Tool& tool, const DepthSources& sources,
                                                 SteppedDevice& device, const RunSettings& settings,
                                                 RunObserver observer, const SimulatedClock& clock);
  virtual ~RunLoop() = default;  ///< stops

  /// Begins; returns when the device ticks. Errors: the device, the first frame.
  virtual Status start() = 0;
  /// After a fault: the force comes back as soon as all is well, also in contact. Any thread.
  virtual void ask_for_force() noexcept = 0;
  /// Fades the force out, then ends all threads.
  virtual void stop() noexcept = 0;
  virtual bool is_running() const noexcept = 0;
  /// The newest tick; any thread but the haptic one, one reader.
  virtual bool latest(TickRecord& record) noexcept = 0;
  virtual const LoopTimes& times() const noexcept = 0;
  virtual LoopReport report() const = 0;
  /// An error once a source or device has failed for good; the loop has then faded out. What passes
  /// is in TickRecord::safety.
  virtual Status status() const = 0;

  // For people who look on. From one thread that may wait, never the haptic one.

  /// Goes on with other settings: contact, surface, field, time, coupling, backend and contact rate
  /// as wanted; the rest (safety, threads, which GPUs, X_WB, X_HT) stays as it was at the start.
  /// The tool stays where it is; forces that jump go through the safety filter's slew limit.
  /// Returns when every stage has taken them, within two frames. Errors: as of create(), or a
  /// setting that cannot change: then nothing has changed; the loop has ended.
  virtual Status change(const RunSettings& settings) = 0;
  /// Whoever looks on is to do so less often: the computer is short of time.
  virtual bool is_short_of_time() const noexcept { return false; }
  /// As they are now: those of create() or of the last change, be it by the loop itself.
  virtual RunSettings settings() const = 0;
  /// While frames are held, the last one is seen again and again: the scene stands still, the hand
  /// goes on. On a simulated clock the hand stands still too. `step_frame` lets one more through.
  virtual void hold_frames(bool is_held) noexcept = 0;
  virtual void step_frame() noexcept = 0;
  /// Asks for a picture of the next contact or surface, which is made once the thread has told the
  /// others what it measured. Wait-free.
  virtual void ask_for_contact_picture(Onlooker who) noexcept = 0;
  virtual void ask_for_surface_picture() noexcept = 0;
  /// The newest picture if there is a new one, else null; valid until the next call. One reader, of
  /// contacts one of each kind.
  virtual const ContactPicture* new_contact_picture(Onlooker who) noexcept = 0;
  virtual const SurfacePicture* new_surface_picture() noexcept = 0;
};

}  // namespace palpate::inline v0
