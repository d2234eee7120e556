#include "palpate/session/session.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

namespace palpate {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kToolBody = 0;  // of the session's world

/// What `share` of a measure is.
Penetration faded(const Penetration& last, double share) {
  Penetration result;
  result.volume = share * last.volume;
  result.potential = share * last.potential;
  result.measure_W.force = share * last.measure_W.force;
  result.measure_W.torque = share * last.measure_W.torque;
  return result;
}

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

Status check(const RunSettings& settings) {
  if (Status status = check_settings(settings); !status) return status;
  if (!(settings.duration > 0)) {
    return Error{Errc::invalid_argument, "the duration must be longer than 0 s"};
  }
  for (const SceneObject& object : settings.objects) {
    if (object.shape == nullptr || !is_finite(object.X_WB)) {
      return Error{Errc::invalid_argument, "every object needs a shape and a finite pose"};
    }
  }
  return Done{};
}

Result<SurfaceTimeline> timeline_for(const DepthStreamInfo& stream, const RunSettings& settings) {
  std::optional<DepthFieldOptions> field;
  if (settings.contact.method == InsideMethod::field) field = settings.field;
  return SurfaceTimeline::create(stream, settings.surface, field, settings.time,
                                 {*settings.backend, settings.sensing_gpu});
}

}  // namespace

Result<ChosenQuery> choose_contact_query(const RunSettings& settings, const Tool& tool,
                                         ThreadPool& pool) {
  ContactCapacities capacities;
  capacities.gpu = settings.contact_gpu;
  if (settings.num_threads > 1) capacities.pool = &pool;
  const auto make = [&](Backend backend) -> Result<ChosenQuery> {
    auto query = make_contact_query(backend, tool, capacities);
    if (!query) return query.error();
    return ChosenQuery{backend, *std::move(query), {}};
  };
  if (settings.backend) return make(*settings.backend);
  auto cuda = make(Backend::cuda);
  if (cuda) return cuda;
  auto cpu = make(Backend::cpu);
  if (cpu) cpu->why_not_cuda = cuda.error().message;
  return cpu;
}

Status measure_pairs_at(Backend backend, const RunSettings& settings, BodyWorld& world) {
  if (backend == Backend::cpu) return Done{};
  return world.measure_pairs_by([&](const Tool& a, const Tool& b) {
    return make_body_pair_query(backend, a, b, settings.contact_gpu);
  });
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
  RunSettings used = settings;
  used.backend = settings.backend.value_or(Backend::cuda);
  auto timeline = timeline_for(stream, used);
  auto pool = std::make_unique<ThreadPool>(settings.num_threads);
  Result<ChosenQuery> chosen =
      timeline ? choose_contact_query(used, tool, *pool) : Result<ChosenQuery>(timeline.error());
  if (!chosen && !settings.backend) {
    used.backend = Backend::cpu;
    auto session = create(tool, stream, used);
    if (session) session->why_not_cuda_ = chosen.error().message;
    return session;
  }
  if (!chosen) return chosen.error();
  used.time.first_period = timeline->period();
  Session session(used, std::move(pool), *std::move(timeline), tool,
                  std::make_unique<BlendedQuery>(std::move(chosen->query)));
  const Status status = measure_pairs_at(*used.backend, used, session.world_);
  if (!status) return status.error();
  return session;
}

Result<Session> Session::create(const Tool& tool, const DepthStreamInfo& stream,
                                const RunSettings& settings, std::unique_ptr<ContactQuery> query) {
  if (const Status status = check(settings); !status) return status.error();
  RunSettings used = settings;
  used.backend = settings.backend.value_or(Backend::cpu);
  auto timeline = timeline_for(stream, used);
  if (!timeline) return timeline.error();
  used.time.first_period = timeline->period();
  return Session(used, std::make_unique<ThreadPool>(settings.num_threads), *std::move(timeline),
                 tool, std::make_unique<BlendedQuery>(std::move(query)));
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
  if (status_ && !timeline_.status()) status_ = timeline_.status();
  if (status_ && record.penetration.status.has(StepStatus::backend_failed)) {
    status_ = lost_backend();
  }
  if (status_) {
    last_good_ = record;
  } else {
    fade_out(record);
  }
  return record;
}

void Session::fade_out(TickRecord& record) {
  const double share = std::max(0.0, 1 - (record.time - last_good_.time) / kFadeTime);
  record.penetration = faded(last_good_.penetration, share);
  record.penetration.status = StepStatus::backend_failed;
  record.objects = faded(last_good_.objects, share);
  record.object_pairs = 0;
  is_faded_out_ = share == 0;
}

}  // namespace palpate
