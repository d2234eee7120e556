// The pipeline of a run: its parts for a frame, a pose and a tick, for any clock: every run, live
// or on a simulated clock, repeated or tried with other settings, is wired here and nowhere else.
//
//   DepthFrame -> SurfaceTimeline -> ContactPart -> HandPart -> wrench
//
// A live loop gives each part a thread of its own; Pipeline joins them in one.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/contact/body_contact.h"
#include "palpate/run/records.h"
#include "palpate/run/run_loop.h"
#include "src/bodies/internal/moving_bodies.h"
#include "src/run/region_lookup.h"

namespace palpate { inline namespace v0 {

/// Scale of contacts in newtons, and the other settings of contacts that a run can change.
struct ContactScale {
  VolumeStiffness volume;
  FrictionOptions friction = {};  ///< for objects without their own
  double grip = 0;                ///< N/m: of what sticks to the tool
  BodyOptions bodies = {};
  ObjectFrictions object_frictions = {};  ///< of all objects, see frictions_of
  bool wants_noise = false;
};

/// From a pose to a contact: the tool against surfaces and objects.
class ContactPart {
 public:
  /// `tool` must outlive it, and so must the shapes of `objects`, which have their friction until
  /// `use`. `moving`: those of them that move; null if none does.
  ContactPart(const Tool& tool, std::unique_ptr<ContactQuery> query, const ContactScale& scale,
              const std::vector<SceneObject>& objects = {}, BodyMethod bodies = BodyMethod::field,
              std::unique_ptr<MovingBodies> moving = nullptr);
  /// Sets where the query is, which measures pairs of tool and objects there, too. Error: too
  /// little memory there.
  Status measure_at(const Place& place);

  /// Uses `scale` from the next measurement on. It has the friction of as many objects as there
  /// are. No allocation.
  void use(const ContactScale& scale) noexcept;
  /// Sets the material regions of each camera.
  void set_regions(std::vector<RegionLookup> regions) { regions_ = std::move(regions); }
  /// Takes over the poses of moving objects from the part before.
  void take_over(const ContactPart& before) noexcept;

  /// Measures the tool at record.X_WT: fills in penetration, objects and, with the stiffness that
  /// was measured last, `contact`, whose time is the record's `contact.time`. Then moves objects by
  /// the time since the measurement before. No allocation.
  void measure(std::span<const SurfaceBlend> cameras, bool with_stiffness,
               ContactRecord& record) noexcept;
  /// True if contacts have a stiffness that can be measured; if not, that of `measure` is right.
  bool has_stiffness() const noexcept;

  /// The tool's query.
  const ContactQuery& query() const { return *query_; }

 private:
  struct ToolAt {
    double time = 0;  // s
    Pose X_WT;
  };
  void set_contact(ContactRecord& record) const noexcept;
  ContactPatch patch_at(std::span<const SurfaceBlend> cameras, const Pose& X_WT) const noexcept;
  /// Returns `sum` plus the normal forces of all objects on the tool, N, one by one.
  double plus_object_forces(double sum) const noexcept;
  /// Sets the frictions of the tool's contact with objects. `all_forces` > 0: sum over them, N.
  void take_frictions(double all_forces, ContactPatch& objects) const noexcept;
  void place_bodies(ContactRecord& record) noexcept;
  void carry(const Pose& X_WT) noexcept;
  void move_bodies(std::span<const SurfaceBlend> cameras, ContactRecord& record) noexcept;
  MovingBodies::Push push_on(int body, const Pose& X_WT, double dt) const noexcept;

  BodyMethod bodies_;
  BodyWorld world_;            // the tool, then the objects
  const ContactQuery* query_;  // the tool's, owned by the world
  MassProperties tool_mass_;
  bool is_on_cpu_ = true;
  ContactScale scale_;
  std::unique_ptr<MovingBodies> moving_;
  std::vector<MovingBodies::Push> pushes_;  // of the tool on each of them
  std::vector<Twist> velocities_;           // of each at the last measurement
  std::vector<RegionLookup> regions_;
  std::optional<ToolAt> before_;  // at the last measurement
  Stiffness stiffness_;           // measured last
  ContactPatch patch_;            // likewise, or of this measurement if there is no stiffness
  Twist scene_V_W_;               // part of its ground's motion that cameras measure
};

/// State of the run that a tick cannot know by itself.
struct TickFlags {
  bool is_stopping = false;         ///< the force is to fade out
  bool is_force_requested = false;  ///< the force is to return after a fault
  bool is_suspended = false;        ///< no force until the program resumes
  bool has_sensor_failed = false, has_backend_failed = false;
};

/// From a device's state and the last contact to a wrench.
class HandPart {
 public:
  HandPart(std::unique_ptr<Coupling> coupling, SafetyFilter safety, double tick_seconds);

  /// Sets the start of the run, s on the device's clock; times of records count from it.
  void set_start_time(double time) { start_time_ = time; }
  /// `known` has number 0 if nothing has been measured yet. Fills in all of `record` but the time
  /// that it took. Never allocates, locks or waits.
  void tick(const DeviceState& state, const ContactRecord& known, const TickFlags& flags,
            TickRecord& record) noexcept;
  /// Changes revision and coupling from the next tick on. Another coupling takes the tool over
  /// where it is, and `coupling` then holds the one before; null: the coupling stays.
  void change(std::uint32_t revision, std::unique_ptr<Coupling>& coupling) noexcept;

  bool has_tool() const { return has_tool_; }
  /// Returns the pose in which a hand in this state would hold the tool.
  Pose held_pose(const DeviceState& state) const noexcept { return coupling_->held_pose(state); }
  std::uint64_t num_ticks() const { return num_ticks_; }

 private:
  double step_seconds(const DeviceState& state) noexcept;
  void end_without_force(TickRecord& record) noexcept;

  std::unique_ptr<Coupling> coupling_;
  /// Safety status while the device gets no wrench; but its num_faults is of the whole run.
  SafetyStatus status_without_force_;
  SafetyFilter safety_;
  const double tick_seconds_;
  std::uint32_t revision_ = 0;
  std::uint64_t num_ticks_ = 0;
  bool has_tool_ = false, is_stopping_ = false;
  double start_time_ = 0, last_state_time_ = 0, first_tick_ = 0;
};

/// Frame of a camera.
struct CameraFrame {
  std::int64_t number = -1;  ///< of the camera; -1: none
  double capture_time = 0;   ///< s
};

/// Surfaces that a query is measured against: a blend of each camera, then the key frames of moving
/// cameras, each at the progress of its camera. No allocation.
class CameraViews {
 public:
  explicit CameraViews(std::size_t num_cameras) : frames_(num_cameras) {
    views_.reserve(std::max<std::size_t>(num_cameras, kMaxCameras));
    begin();
  }
  /// Drops the key frames, for the next query.
  void begin() { views_.resize(frames_.size()); }
  /// Sets the view of a camera, once for each query, and its newest frame.
  void show(std::size_t camera, const CameraFrame& frame, const SurfaceBlend& blend,
            std::span<const SurfaceBlend> key_frames) {
    frames_[camera] = frame;
    views_[camera] = blend;
    for (const SurfaceBlend& view : key_frames) {
      if (views_.size() == views_.capacity()) return;
      views_.push_back(view);
      views_.back().progress = blend.progress;
    }
  }
  std::span<const SurfaceBlend> all() const { return views_; }
  std::size_t num_cameras() const { return frames_.size(); }
  /// Returns the capture time of the oldest of the newest frames, s; `none` if there is no frame.
  double capture_time(double none) const;
  /// Returns the record of a contact that is to be measured at `time`, s, with the tool at X_WT;
  /// without its revision and numbers.
  ContactRecord record(const Pose& X_WT, double time, double start_time) const;

 private:
  std::vector<CameraFrame> frames_;
  std::vector<SurfaceBlend> views_;
};

/// Returns the ending of a run after the last frame of one of its cameras.
std::string frames_have_ended(const std::string& name, std::size_t camera, std::size_t num_cameras);
/// An error of one of several cameras, by its name.
Error error_of_camera(const Error& error, const std::string& name, std::size_t camera,
                      std::size_t num_cameras);
/// Returns the error that StepStatus::backend_failed stands for.
Error lost_backend();

/// Creates the timeline of one camera, with the backend, the GPU and the options of the settings.
/// All moving cameras together keep no more key frames than a query can take (kMaxCameras).
/// `first_period`, s, replaces time.first_period unless it is 0.
Result<SurfaceTimeline> make_surfaces(std::span<const DepthStreamInfo> streams, std::size_t camera,
                                      const RunSettings& settings, int num_spare = 0,
                                      double first_period = 0);
inline Result<SurfaceTimeline> make_surfaces(const DepthStreamInfo& stream,
                                             const RunSettings& settings) {
  return make_surfaces({&stream, 1}, 0, settings);
}
/// The same, with `threads` for queries too, which may be null and must outlive it.
Result<std::unique_ptr<ContactPart>> make_contact_part(std::shared_ptr<const ToolIndex> index,
                                                       const RunSettings& settings,
                                                       const ContactScale& scale,
                                                       ThreadPool* threads = nullptr);
/// Adds the regions of the settings, as these cameras see them.
Result<std::unique_ptr<ContactPart>> make_contact_part(std::shared_ptr<const ToolIndex> index,
                                                       std::span<const DepthStreamInfo> streams,
                                                       const RunSettings& settings,
                                                       const ContactScale& scale,
                                                       ThreadPool* threads = nullptr);

/// Adds notes for humans: each once, and at most kMaxNotes in a run.
inline constexpr std::size_t kMaxNotes = 100;
void add_notes(std::vector<std::string>& notes, const std::vector<std::string>& news);

/// The parts of a run, made from its settings.
struct RunParts {
  std::unique_ptr<Coupling> coupling;
  std::vector<SurfaceTimeline> timelines;  ///< of each camera; empty: the present ones stay
  std::unique_ptr<ContactPart> contact;
  bool needs_timelines = false, needs_contact = false;  ///< made, or left out
  CouplingOptions checked_coupling;
  ContactScale scale;
  std::vector<std::string> notes;  ///< for humans
};
struct RunPartsOptions {
  /// Settings of a running loop, whose unchanged parts are left out; null: none runs.
  const RunSettings* before = nullptr;
  int num_spare_surfaces = 0;           ///< see SurfaceTimeline
  ThreadPool* query_threads = nullptr;  ///< for queries too; must outlive them
  bool leaves_out_large = false;        ///< the timelines and the contact part
};
/// Errors: settings out of range, the backend, a device that cannot be used; no camera, more than
/// kMaxCameras, or several with a method that takes one.
Result<RunParts> make_run_parts(const std::shared_ptr<const ToolIndex>& index,
                                std::span<const DepthStreamInfo> streams, const DeviceInfo& device,
                                const RunSettings& settings, const RunPartsOptions& options = {});
inline Result<RunParts> make_run_parts(const std::shared_ptr<const ToolIndex>& index,
                                       const DepthStreamInfo& stream, const DeviceInfo& device,
                                       const RunSettings& settings,
                                       const RunPartsOptions& options = {}) {
  return make_run_parts(index, {&stream, 1}, device, settings, options);
}

/// All parts in one thread, without a clock: the same calls give the same bits.
class Pipeline {
 public:
  /// `tool` must outlive it. Errors: see make_run_parts; safety options out of range.
  static Result<Pipeline> create(const Tool& tool, std::vector<DepthStreamInfo> streams,
                                 const DeviceInfo& device, const RunSettings& settings);
  static Result<Pipeline> create(const Tool& tool, const DepthStreamInfo& stream,
                                 const DeviceInfo& device, const RunSettings& settings) {
    return create(tool, std::vector{stream}, device, settings);
  }
  static Result<Pipeline> create(const Tool&&, const DepthStreamInfo&, const DeviceInfo&,
                                 const RunSettings&) = delete;

  /// A frame of the camera's size that became current at `time`, s, later than its one before.
  SurfaceStats push(const DepthFrame& frame, double time, std::size_t camera = 0);
  /// The tool at a pose and time, which does not lie before the last frame's. No allocation.
  const ContactRecord& measure(const Pose& X_WT, double time) noexcept;
  /// One tick: what the hand feels of the last contact, then the contact where the tool is now; a
  /// prescribed path (CouplingKind::none) is measured where it is first. No allocation.
  const TickRecord& tick(const DeviceState& state, TickFlags flags = {}) noexcept;

  /// Changes settings from the next tick on. Parts that need other surfaces wait for the next
  /// frame. Errors: as of create(), or a setting that cannot change; nothing has changed then.
  Status change(const RunSettings& settings);

  const RunSettings& settings() const { return settings_; }
  std::uint32_t revision() const { return revision_; }
  /// Revision of the newest surface; contacts use it once each camera has one.
  std::uint32_t frame_revision() const { return frame_revision_; }
  const std::vector<std::string>& notes() const { return notes_; }
  /// Coupling options with the zeros filled in.
  const CouplingOptions& coupling() const { return checked_coupling_; }
  /// An error once the backend has failed.
  Status status() const;

  const ContactRecord& contact() const { return contact_; }
  const ContactQuery& query() const { return contacts_->query(); }
  /// Returns the newest cloud of one camera, in its frame, for pictures.
  PointCloud newest_cloud(std::size_t camera = 0) {
    return timelines_[camera].newest_cloud(*pool_);
  }
  /// Surfaces of the last measurement: one of each camera, then the key frames.
  std::span<const SurfaceBlend> cameras() const { return cameras_.all(); }

 private:
  /// A change that waits for a frame of each camera.
  struct Pending {
    std::uint32_t revision = 0;
    std::vector<SurfaceTimeline> timelines;
    std::unique_ptr<ContactPart> contact;
    ContactScale scale;
    std::vector<CameraFrame> seen;  // by its timelines
  };
  Pipeline(std::shared_ptr<const ToolIndex> index, std::vector<DepthStreamInfo> streams,
           const DeviceInfo& device, const RunSettings& settings, std::unique_ptr<ThreadPool> pool,
           RunParts parts, SafetyFilter safety);
  void use(Pending& pending);

  std::shared_ptr<const ToolIndex> index_;
  std::vector<DepthStreamInfo> streams_;
  DeviceInfo device_;
  RunSettings settings_;
  CouplingOptions checked_coupling_;
  std::vector<std::string> notes_;
  std::unique_ptr<ThreadPool> pool_;
  std::vector<SurfaceTimeline> timelines_;
  std::unique_ptr<ContactPart> contacts_;
  std::unique_ptr<HandPart> hand_;
  std::optional<Pending> pending_;
  std::uint32_t revision_ = 0, surface_revision_ = 0, frame_revision_ = 0;
  std::uint64_t num_frames_ = 0;
  double start_time_ = 0;
  bool has_begun_ = false, has_backend_failed_ = false;
  // One for each camera:
  CameraViews cameras_;
  std::vector<CameraFrame> seen_;
  std::vector<std::int64_t> num_camera_frames_;
  ContactRecord contact_;
  TickRecord record_;
};

}}  // namespace palpate::v0
