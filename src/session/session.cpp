#include "palpate/session/session.h"

#include <chrono>
#include <utility>

namespace palpate {
namespace {

using Clock = std::chrono::steady_clock;

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
                 SurfaceEstimator surface, std::unique_ptr<ContactQuery> query)
    : settings_(settings),
      pool_(std::move(pool)),
      surface_(std::move(surface)),
      query_(std::move(query)) {}

Result<Session> Session::create(const Tool& tool, const DepthStreamInfo& stream,
                                const RunSettings& settings) {
  if (const Status status = check(settings); !status) return status.error();
  auto surface =
      SurfaceEstimator::create(stream.width, stream.height, stream.intrinsics, settings.surface);
  if (!surface) return surface.error();
  auto pool = std::make_unique<ThreadPool>(settings.num_threads);
  auto chosen = choose_contact_query(settings, tool, *pool);
  if (!chosen) return chosen.error();
  RunSettings used = settings;
  used.backend = chosen->backend;
  return Session(used, std::move(pool), *std::move(surface), std::move(chosen->query));
}

FrameRecord Session::take_frame(const DepthFrame& frame, double time) {
  FrameRecord record;
  record.time = time;
  const auto start = Clock::now();
  record.surface = surface_.update(frame, *pool_);
  record.surface_seconds = seconds_since(start);
  query_->set_cloud(surface_.cloud());
  ++num_frames_;
  return record;
}

TickRecord Session::tick(double time, const Pose& X_WT) {
  TickRecord record;
  record.time = time;
  record.X_WT = X_WT;
  record.frame = num_frames_ - 1;
  const auto start = Clock::now();
  record.penetration = query_->query(X_WT, settings_.contact);
  record.query_seconds = seconds_since(start);
  return record;
}

}  // namespace palpate
