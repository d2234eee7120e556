// What happens at a frame and at a tick, whoever keeps the clock; and the run on a simulated clock.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/cloud/surface_estimator.h"
#include "palpate/contact/blended_query.h"
#include "palpate/contact/body_world.h"
#include "palpate/contact/contact_query.h"
#include "palpate/core/result.h"
#include "palpate/field/depth_field.h"
#include "palpate/run/pipeline.h"
#include "palpate/session/probe_choice.h"

namespace palpate {

/// Everything that decides the numbers of a run, beside tool, frames and poses.
struct RunSettings {
  double rate = 1000;                                         ///< ticks per second
  double duration = std::numeric_limits<double>::infinity();  ///< seconds; ticks at t < duration
  bool end_with_source = true;  ///< stop one frame period after the last frame
  ContactOptions contact;
  SurfaceOptions surface;
  DepthFieldOptions field;  ///< for the method `field`
  TimeOptions time;
  std::vector<SceneObject> objects;
  /// Where surfaces and queries are computed; nullopt: the fastest one that works here.
  std::optional<Backend> backend = Backend::cpu;
  int sensing_gpu = 0, contact_gpu = 0;  ///< by CUDA: which GPU makes the surfaces, which queries
  /// For surfaces and queries. 0: surfaces on one thread per core, queries on the caller's alone,
  /// which is fastest for all but the largest tools.
  int num_threads = 0;
  /// How the path was chosen, if nobody gave one. Kept and reported; decides nothing.
  std::optional<ProbeChoice> probe;
};
inline void add_settings(SettingTable& t, RunSettings& s) {
  add_settings(t, s.contact);
  add_settings(t, s.surface);
  add_settings(t, s.field);
  add_settings(t, s.time);
  t.section("loop");
  t.add("backend", s.backend,
        "where surfaces and queries are computed; auto: on a GPU if there is one");
  t.add("sensing_gpu", s.sensing_gpu, {0, 63}, "cuda: which GPU makes the surfaces");
  t.add("contact_gpu", s.contact_gpu, {0, 63}, "cuda: which GPU computes queries");
  t.add("threads", s.num_threads, {0, 256, "threads"},
        "0: one per core for surfaces, one for queries");
  t.add("contact_rate", s.rate, {1, 100000, "Hz"}, "queries per second");
}

/// A frame that became current.
struct FrameRecord {
  double time = 0;  ///< seconds since the first frame
  SurfaceStats surface;
  double surface_seconds = 0;  ///< compute time
};

/// One tick of the haptic clock.
struct TickRecord {
  double time = 0;  ///< seconds
  Pose X_WT;
  Penetration penetration;        ///< cloud and objects, see BodyMeasure::total
  Penetration objects;            ///< the objects' share of it
  std::int64_t object_pairs = 0;  ///< spheres of tool and objects that overlap
  int frame = 0;                  ///< index of the current frame
  double query_seconds = 0;       ///< compute time
};

/// A query and the backend that was found for it.
struct ChosenQuery {
  Backend backend = Backend::cpu;
  std::unique_ptr<ContactQuery> query;
  std::string why_not_cuda;  ///< if the fastest one was asked for and this is another
};
/// A query by `backend`, `contact_gpu` and `num_threads` of the settings. `tool` and `pool` must
/// outlive it.
Result<ChosenQuery> choose_contact_query(const RunSettings& settings, const Tool& tool,
                                         ThreadPool& pool);

/// Pairs of the bodies in `world` are measured where queries are. Error: too little memory there.
Status measure_pairs_at(Backend backend, const RunSettings& settings, BodyWorld& world);

/// The loop body: surfaces from frames, wrenches from poses. `tool` must outlive it.
class Session {
 public:
  /// Errors: settings out of range, an object without shape, image size, backend not available.
  static Result<Session> create(const Tool& tool, const DepthStreamInfo& stream,
                                const RunSettings& settings);
  /// The same with a query that was made elsewhere, and surfaces by `settings.backend`.
  static Result<Session> create(const Tool& tool, const DepthStreamInfo& stream,
                                const RunSettings& settings, std::unique_ptr<ContactQuery> query);

  /// Makes `frame` (of the stream's size) the one that the next ticks feel, or go towards.
  FrameRecord take_frame(const DepthFrame& frame, double time);
  /// One measurement. No allocation. When the backend has failed, what was felt last fades to zero
  /// over kFadeTime instead of vanishing at once, and StepStatus::backend_failed is set.
  TickRecord tick(double time, const Pose& X_WT);
  static constexpr double kFadeTime = 0.05;  ///< s

  /// An error once the backend has failed.
  const Status& status() const { return status_; }
  /// It has failed, and nothing is felt any more.
  bool is_faded_out() const { return is_faded_out_; }

  /// The settings, with what was chosen for `backend` and for the first period.
  const RunSettings& settings() const { return settings_; }
  /// Why the CUDA backend is not used although the fastest one was asked for; else empty.
  const std::string& why_not_cuda() const { return why_not_cuda_; }
  /// SurfaceTimeline::newest_cloud and at.
  PointCloud newest_cloud() const { return timeline_.newest_cloud(); }
  SurfaceMoment moment_at(double time) const { return timeline_.at(time); }
  const ContactQuery& query() const { return *query_; }

 private:
  Session(const RunSettings& settings, std::unique_ptr<ThreadPool> pool, SurfaceTimeline timeline,
          const Tool& tool, std::unique_ptr<BlendedQuery> query);
  void fade_out(TickRecord& record);

  RunSettings settings_;
  std::unique_ptr<ThreadPool> pool_;
  SurfaceTimeline timeline_;
  BodyWorld world_;      // the tool, then the objects
  BlendedQuery* query_;  // the tool's, owned by the world
  int num_frames_ = 0;
  std::string why_not_cuda_;
  Status status_ = Done{};
  bool is_faded_out_ = false;
  TickRecord last_good_;
};

/// All that a run produced.
struct RunLog {
  RunSettings settings;  ///< as used
  DepthStreamInfo stream;
  std::vector<FrameRecord> frames;
  std::vector<TickRecord> ticks;
  bool interrupted = false;      ///< a callback asked to stop
  std::string failure;           ///< why the run ended early: the backend failed; else empty
  std::string why_not_cuda;      ///< Session::why_not_cuda
  std::size_t deepest_tick = 0;  ///< largest volume; the first one if there are several
  DepthFrame deepest_frame;      ///< the frame that was current then
};

/// Longest run, to bound memory.
inline constexpr std::size_t kMaxTicks = 5'000'000;

/// Pose of the tool at a tick.
using PoseFunction = std::function<Pose(std::size_t tick, double time)>;

struct RunCallbacks {
  /// The session before its first frame; it stays until the run is over. For looking on from the
  /// other callbacks. May be empty.
  std::function<void(const Session& session)> on_session = {};
  /// A frame has just become current. An error ends the run. May be empty.
  std::function<Status(std::size_t index, double time, const DepthFrame& frame)> on_frame = {};
  /// After every tick; return false to stop. May be empty.
  std::function<bool(const TickRecord& tick)> on_tick = {};
};

/// Runs on a simulated clock: tick k is at time k / rate, and a frame becomes current at the first
/// tick that is not before its time stamp (relative to the first frame). The same inputs give the
/// same numbers, compute times aside. If the backend fails, the run ends when the force has faded
/// out. Errors: settings out of range; no frame; what the source or a callback reports.
Result<RunLog> run_session(const Tool& tool, DepthSource& source, const PoseFunction& X_WT,
                           const RunSettings& settings, const RunCallbacks& callbacks = {});

}  // namespace palpate
