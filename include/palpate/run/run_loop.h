// A run: its settings, its loops (live or simulated clock), and display data.
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

namespace palpate { inline namespace v0 {

// All settings that determine the numbers of a run, besides tool, frames and hand.

/// Live on a CPU, `field` only: computes a surface only where the tool can be until the next frames
/// replace it. The rest is computed if the display needs it.
struct WindowOptions {
  bool enabled = true;
  /// Minimum expected speed of the hand, m/s; the tool's is `motion_scale` times that where it is
  /// above 1. If the tool moves faster, twice its speed.
  double speed = 0.5;
};
inline void add_settings(SettingTable& t, WindowOptions& o) {
  t.section("window");
  t.add("enabled", o.enabled, "live on a CPU, field: process frames only around the tool");
  t.add("speed", o.speed, {0, 100, "m/s"},
        "minimum expected speed of the hand (the tool's: times motion_scale, if that is above 1); "
        "for a faster tool, twice its speed");
}

/// Returns the filter of the depth that is usual with a method: the thesis' own with its methods.
constexpr Smoothing usual_smoothing(MethodKind method) {
  return method == MethodKind::field ? Smoothing::adaptive : Smoothing::bilateral;
}

/// All settings of a run, as in a settings file (docs/settings.md).
struct RunSettings {
  ContactOptions contact;
  SurfaceOptions surface;
  DepthFieldOptions field;
  TimeOptions time;
  WindowOptions window;
  /// Backend of surfaces and queries; none: the fastest one on this machine.
  std::optional<Backend> backend = Backend::cpu;
  int sensing_gpu = 0, contact_gpu = 0;
  int num_threads = 0;         ///< for surfaces
  int binning = 1;             ///< surfaces use images smaller by this factor
  int num_spheres = 0;         ///< queries use the first N spheres of the tool; 0: all
  bool may_thin = true;        ///< live: compute less before the force is lost
  double contact_rate = 1000;  ///< queries per second, at most
  bool wants_std = false;      ///< ContactWants::noise, in records and all that is made of them
  CouplingOptions coupling;    ///< checked by the loop
  SafetyOptions safety;
  bool wants_real_time = true;  ///< SCHED_FIFO and locked memory if permitted
  std::vector<SceneObject> objects;
  BodyOptions bodies;  ///< of moving objects
  OutputOptions output;
  /// One per camera, which must not move; null, or fewer than cameras: none.
  std::vector<std::shared_ptr<const MaterialRegions>> regions;
};
inline void add_settings(SettingTable& t, RunSettings& s) {
  add_settings(t, s.contact);
  add_settings(t, s.surface);
  add_settings(t, s.field);
  add_settings(t, s.time);
  add_settings(t, s.window);
  t.section("loop");
  t.add("backend", s.backend, "backend of surfaces and queries; auto: a GPU if there is one");
  t.add("sensing_gpu", s.sensing_gpu, {0, 63}, "cuda: GPU index for surfaces");
  t.add("contact_gpu", s.contact_gpu, {0, 63}, "cuda: GPU index for queries");
  t.add("threads", s.num_threads, {0, 256, "threads"},
        "for surfaces, and the maximum for queries of large tools; 0: one per core");
  t.add("binning", s.binning, {1, kMaxBinning, "pixels"},
        "depth pixels combined along each side before the surface is computed");
  t.add("spheres", s.num_spheres, {0, 1 << 30, "spheres"},
        "queries use the first N spheres of the tool; 0: all");
  t.add("thin_out", s.may_thin,
        "live, on a busy computer: update the page less, then bin images or use fewer "
        "spheres, before the force is lost");
  t.add("contact_rate", s.contact_rate, {1, 100000, "Hz"}, "maximum queries per second");
  t.add("std", s.wants_std,
        "standard deviations of volume, force and torque by the noise of the depth, in wrench.csv, "
        "recording, plots and ROS 2 messages; method field");
  t.add("real_time", s.wants_real_time, "real-time scheduling and locked memory if permitted");
  add_settings(t, s.coupling);
  add_settings(t, s.safety);
  add_settings(t, s.bodies);
  t.section("objects");
  for (SceneObject& object : s.objects) add_settings(t, object);
  add_settings(t, s.output);
}

/// True if a change of settings keeps the state of the surfaces, or of the coupling; otherwise that
/// part restarts, with the tool in place. Replay does the same.
bool keeps_surfaces(const RunSettings& before, const RunSettings& after);
bool keeps_coupling(const RunSettings& before, const RunSettings& after);
/// True if some objects move.
bool has_moving_objects(const RunSettings& settings);
/// True if anything that the tool may touch has friction or damping.
bool has_friction(const RunSettings& settings);
/// True if queries read depth-change vectors.
bool needs_depth_change(const RunSettings& settings);
/// True if this setting cannot change during a run.
bool is_fixed_while_running(const Setting& setting);

// Display data of a run: states of the spheres, and the surface.

/// Consumers of contact pictures; each requests its own.
enum class PictureConsumer { page, robots };
inline constexpr std::size_t kNumPictureConsumers = 2;

/// State of every sphere of the tool at one contact.
struct ContactPicture {
  std::uint64_t contact_number = 0, frame_number = 0;
  Pose X_WT;
  BodyPoses bodies;  ///< of moving objects
  SpherePicture spheres;
};

/// The newest surface: per pixel a point with normal and depth-change vector.
struct SurfacePicture {
  std::uint64_t frame_number = 0;
  int width = 0, height = 0;
  std::vector<Vec3f> points, normals;  ///< NaN if invalid
  std::vector<Vec3f> edges;            ///< depth-change vectors; empty if they are not computed
};

// A current run: live, or on a simulated clock.
//
// Live, five threads are connected by triple buffers (thesis Fig. 4.1):
//
//   sensor --> surface --> contact <==> haptic (the device's own thread) --> publishing
//
// The haptic thread uses the last LocalContact and never waits for a query; queries use the newest
// surfaces and never wait for a frame.
//
// On a simulated clock one thread does everything in sequence; the same input gives the same bits.

/// Callbacks during a run. Called only from the publishing thread; may take time: records that do
/// not fit into the queues are dropped and counted, and the loop continues.
struct RunObserver {
  std::function<void(const FrameRecord&, const DepthFrame&)> on_frame = {};
  std::function<void(const ContactRecord&)> on_contact = {};
  std::function<void(std::span<const TickRecord>)> on_ticks = {};
  /// Before the first frame, contact or tick of a new revision; not for revision 0.
  std::function<void(std::uint32_t revision, const RunSettings&)> on_settings = {};
  /// Automatic actions of the loop, for display.
  std::function<void(std::string_view)> on_note = {};
};

/// Durations and ages of the stages.
struct LoopTimes {
  LatencyHistogram haptic_compute, haptic_period, contact_compute, surface_compute;
  /// haptic_compute without the time in which the scheduler ran other threads on that core.
  LatencyHistogram haptic_cpu;
  LatencyHistogram contact_age, sensor_to_force;
};

/// Summary of a loop: counters, and why it ended.
struct LoopReport {
  std::uint64_t num_ticks = 0, num_contacts = 0, num_frames = 0;
  std::uint64_t num_missed = 0;  ///< ticks whose computation took longer than a tick
  std::uint64_t num_lost_records = 0;
  std::uint64_t num_left_out = 0;  ///< frames that arrived while the previous one was processed
  std::uint64_t num_spared_stiffnesses = 0;  ///< contacts that reused an older stiffness
  std::vector<std::string> notes;  ///< e.g. that the scheduler refused real time, and what to do
  /// Scheduling of each thread, e.g. "surface", "nice -5"; empty on a simulated clock.
  std::vector<std::pair<std::string, std::string>> scheduling;
  /// s, with fewer page updates, smaller images, fewer spheres: see loop.thin_out.
  double page_thinned = 0, image_thinned = 0, spheres_thinned = 0;
  Fault fault = Fault::none;     ///< what ended the loop; device: it was lost
  std::uint32_t num_faults = 0;  ///< found by the safety filter, including temporary ones
  double seconds = 0;            ///< on the run's clock
  std::string ending;            ///< reason for the end, e.g. "the depth frames have ended"
};

/// Options of a loop on a simulated clock.
struct SimulatedClock {
  /// Timestamp of the frame that is current at time 0. None: that of the first frame, for each
  /// camera.
  std::optional<double> zero = {};
  bool ends_with_frames = true;  ///< one period after a camera's last frame; else it is held
  bool keeps_pace = false;       ///< ticks follow real time, for display
};

/// The loop of a run: depth frames to surfaces, surfaces and poses to contacts, contacts to the
/// wrench on the device. Live in threads of its own, or on a simulated clock.
class RunLoop {
 public:
  /// Creates a live loop. `tool`, `sources` and `device` must outlive it. Several cameras are
  /// combined to a depth hull (`field` only). Errors: settings out of range, the backend.
  static Result<std::unique_ptr<RunLoop>> create(const Tool& tool, const DepthSources& sources,
                                                 HapticDevice& device, const RunSettings& settings,
                                                 RunObserver observer = {});
  static Result<std::unique_ptr<RunLoop>> create(const Tool&&, const DepthSources&, HapticDevice&,
                                                 const RunSettings&, RunObserver = {}) = delete;
  /// Creates a loop on the device's simulated clock: as fast as possible, in its own thread, which
  /// also calls the observer. Nothing is dropped. A frame becomes current at the first tick at or
  /// after its timestamp; of several the newest.
  static Result<std::unique_ptr<RunLoop>> simulate(const Tool& tool, const DepthSources& sources,
                                                   SteppedDevice& device,
                                                   const RunSettings& settings,
                                                   const SimulatedClock& clock = {},
                                                   RunObserver observer = {});
  static Result<std::unique_ptr<RunLoop>> simulate(const Tool&&, const DepthSources&,
                                                   SteppedDevice&, const RunSettings&,
                                                   const SimulatedClock& = {},
                                                   RunObserver = {}) = delete;
  virtual ~RunLoop() = default;  ///< stops the loop

  /// Starts; returns when the device ticks. Errors: the device, the first frame.
  virtual Status start() = 0;
  /// After a fault: the force returns as soon as all is well, also in contact. From any thread.
  virtual void request_force() noexcept = 0;
  /// Live, for a program that is about to stand still (Ctrl-Z): the force fades as by a fault
  /// (Fault::loop) and stays away until `resume_force`; then it returns as after a late tick. Waits
  /// until it is off, for at most the fade and half a second.
  virtual void suspend_force() {}
  virtual void resume_force() noexcept {}
  /// Fades the force out, then ends all threads. Waits for DepthSource::next (see cancel there).
  virtual void stop() noexcept = 0;
  /// True from `start` until the loop has ended.
  virtual bool is_running() const noexcept = 0;
  /// The newest tick if there is a new one; from any thread except the haptic one, one reader.
  virtual std::optional<TickRecord> latest() noexcept = 0;
  /// Times of all stages so far; from any thread.
  virtual const LoopTimes& times() const noexcept = 0;
  /// Counters so far; from any thread that may wait.
  virtual LoopReport report() const = 0;
  /// An error once a source or device has failed permanently; the loop has then faded out.
  /// Temporary faults are in TickRecord::safety.
  virtual Status status() const = 0;

  // For display and control. From one thread that may wait, never the haptic one.

  /// Applies new settings: contact, surface, field, time, coupling, backend, contact rate, bodies
  /// and the friction of objects; the rest (safety, threads, GPU indices, X_WB, X_HT, which objects
  /// there are) stays as at the start. The tool stays in
  /// place; the slew limit of the safety filter smooths force jumps. Returns when every stage uses
  /// them, within two frames. Errors: see create(), or a setting that cannot change: then nothing
  /// changes; the loop has ended; no frame or tick has come for a while: then the change comes with
  /// the next ones.
  virtual Status change(const RunSettings& settings) = 0;
  /// True if the computer is too slow: observers should poll less often.
  virtual bool is_short_of_time() const noexcept { return false; }
  /// The current settings: from create() or the last change, including automatic ones.
  virtual RunSettings settings() const = 0;
  /// While frames are held, the last one repeats: the scene stands still, the hand moves on. On a
  /// simulated clock the hand stands still too. `step_frame` releases one more.
  virtual void hold_frames(bool is_held) noexcept = 0;
  virtual void step_frame() noexcept = 0;
  /// Requests a picture of the next contact or surface, which is made after the measurement has
  /// been published. Wait-free.
  virtual void request_contact_picture(PictureConsumer who) noexcept = 0;
  virtual void request_surface_picture() noexcept = 0;
  /// The newest picture if there is a new one, else null; valid until the next call. One reader per
  /// consumer.
  virtual const ContactPicture* new_contact_picture(PictureConsumer who) noexcept = 0;
  virtual const SurfacePicture* new_surface_picture() noexcept = 0;
};

}}  // namespace palpate::v0
