#include "palpate/session/session.h"

#include <chrono>
#include <cmath>
#include <utility>

namespace palpate {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kToolBody = 0;  // of the session's world

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

Status check(const RunSettings& settings) {
  if (!(settings.rate >= 1 && settings.rate <= 100000)) {
    return Error{Errc::invalid_argument,
                 "the rate must be from 1 to 100000 ticks per second; 1000 is usual"};
  }
  if (!(settings.duration > 0)) {
    return Error{Errc::invalid_argument, "the duration must be longer than 0 s"};
  }
  if (settings.num_threads < 0 || settings.num_threads > 256) {
    return Error{Errc::invalid_argument,
                 "the number of threads must be from 0 (one per core) to 256"};
  }
  for (const SceneObject& object : settings.objects) {
    const Vec3d& t = object.X_WB.translation;
    const Quaternion& q = object.X_WB.rotation;
    if (object.shape == nullptr || !std::isfinite(t.x + t.y + t.z + q.x + q.y + q.z + q.w)) {
      return Error{Errc::invalid_argument, "every object needs a shape and a finite pose"};
    }
  }
  return Done{};
}

}  // namespace

Result<ChosenQuery> choose_contact_query(const RunSettings& settings, const Tool& tool,
                                         ThreadPool& pool) {
  ContactCapacities capacities;
  if (settings.num_threads > 1) capacities.pool = &pool;
  const auto make = [&](Backend backend) -> Result<ChosenQuery> {
    auto query = make_contact_query(backend, tool, capacities);
    if (!query) return query.error();
    return ChosenQuery{backend, *std::move(query)};
  };
  if (settings.backend) return make(*settings.backend);
  auto cuda = make(Backend::cuda);
  return cuda ? std::move(cuda) : make(Backend::cpu);
}

Session::Session(const RunSettings& settings, std::unique_ptr<ThreadPool> pool,
                 SurfaceTimeline timeline, const Tool& tool, std::unique_ptr<BlendedQuery> query)
    : settings_(settings),
      pool_(std::move(pool)),
      timeline_(std::move(timeline)),
      query_(query.get()) {
  world_.add_tool(tool, std::move(query));
  for (const SceneObject& object : settings_.objects) world_.add_object(*object.shape, object.X_WB);
}

Result<Session> Session::create(const Tool& tool, const DepthStreamInfo& stream,
                                const RunSettings& settings) {
  if (const Status status = check(settings); !status) return status.error();
  std::optional<DepthFieldOptions> field;
  if (settings.contact.method == InsideMethod::field) field = settings.field;
  auto timeline = SurfaceTimeline::create(stream, settings.surface, field, settings.time);
  if (!timeline) return timeline.error();
  auto pool = std::make_unique<ThreadPool>(settings.num_threads);
  auto chosen = choose_contact_query(settings, tool, *pool);
  if (!chosen) return chosen.error();
  RunSettings used = settings;
  used.backend = chosen->backend;
  used.time.first_period = timeline->period();
  return Session(used, std::move(pool), *std::move(timeline), tool,
                 std::make_unique<BlendedQuery>(std::move(chosen->query)));
}

FrameRecord Session::take_frame(const DepthFrame& frame, double time) {
  FrameRecord record;
  record.time = time;
  const auto start = Clock::now();
  record.surface = timeline_.push(frame, time, *pool_);
  record.surface_seconds = seconds_since(start);
  ++num_frames_;
  return record;
}

TickRecord Session::tick(double time, const Pose& X_WT) {
  TickRecord record;
  record.time = time;
  record.X_WT = X_WT;
  record.frame = num_frames_ - 1;
  const auto start = Clock::now();
  query_->set_moment(timeline_.at(time));
  world_.set_pose(kToolBody, X_WT);
  world_.measure(settings_.contact);
  record.query_seconds = seconds_since(start);
  const BodyMeasure& measured = world_.measured(kToolBody);
  record.penetration = measured.total();
  record.objects = measured.bodies;
  record.object_pairs = measured.num_pairs;
  return record;
}

}  // namespace palpate
