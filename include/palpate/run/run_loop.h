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
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/core/latency_histogram.h"
#include "palpate/run/pictures.h"
#include "palpate/run/records.h"
#include "palpate/run/settings.h"

namespace palpate {

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
  virtual void ask_for_contact_picture() noexcept = 0;
  virtual void ask_for_surface_picture() noexcept = 0;
  /// The newest picture if there is a new one, else null; valid until the next call. One reader.
  virtual const ContactPicture* new_contact_picture() noexcept = 0;
  virtual const SurfacePicture* new_surface_picture() noexcept = 0;
};

}  // namespace palpate
