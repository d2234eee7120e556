#include "src/haptics/contact_stage.h"

#include <algorithm>
#include <utility>

#include "src/haptics/real_time.h"

namespace palpate {
namespace {

constexpr int kPriority = 70;              // below the haptic thread
constexpr std::size_t kNumRecords = 4096;  // some seconds
constexpr auto kFailed = static_cast<std::uint32_t>(StepStatus::backend_failed);

}  // namespace

ContactStage::ContactStage(std::unique_ptr<ContactQuery> query, SurfaceStage& surfaces,
                           const Settings& settings, LatencyHistogram& contact_compute)
    : query_(std::move(query)),
      surfaces_(surfaces),
      settings_(settings),
      contact_compute_(contact_compute),
      schedule_(1 / settings.rate),
      records_(settings.keeps_records ? kNumRecords : 0) {}

void ContactStage::start(double start_time) {
  settings_.start_time = start_time;
  thread_ = std::thread([this] { work(); });
}

void ContactStage::stop() noexcept {
  is_stopping_.store(true, std::memory_order_release);
  bell_.ring();
  if (thread_.joinable()) thread_.join();
}

void ContactStage::move_tool(const ToolMoment& tool) noexcept {
  tools_.publish(tool);
  bell_.ring();
}

const KnownContact& ContactStage::newest() noexcept {
  contacts_.refresh();
  return contacts_.value();
}

void ContactStage::work() {
  if (settings_.wants_real_time) real_time_error_.store(ask_for_real_time(kPriority));
  for (;;) {
    const std::uint32_t heard = bell_.count();
    if (is_stopping_.load(std::memory_order_acquire)) return;
    if (tools_.refresh() && is_due(tools_.value().time)) {
      measure(tools_.value());
    } else {
      bell_.wait(heard);
    }
  }
}

/// Half a tick early is in time: ticks do not come at the microsecond.
bool ContactStage::is_due(double time) {
  if (time < next_due_ - settings_.tick_seconds / 2) return false;
  next_due_ = std::max(next_due_, time - settings_.tick_seconds) + 1 / settings_.rate;
  return true;
}

SurfaceMoment ContactStage::moment_at(double time) {
  if (blend_.is_complete(time) && surfaces_.take() && surfaces_.taken().moment.progress < 1) {
    blend_.begin(time, surfaces_.taken().ready_time, surfaces_.taken().period);
  }
  SurfaceMoment moment = surfaces_.taken().moment;
  progress_ = moment.progress < 1 ? blend_.progress(time) : 1;
  moment.progress = progress_;
  return moment;
}

void ContactStage::measure(const ToolMoment& tool) {
  const double begin = monotonic_now();
  query_.set_moment(moment_at(begin));
  const Penetration penetration = query_.query(tool.X_WT, settings_.contact);
  if ((penetration.status & kFailed) != 0) {
    backend_failed_.store(true, std::memory_order_release);
    return;
  }
  const double measured = monotonic_now();
  double end = measured;
  has_new_stiffness_ = false;
  if (penetration.volume == 0 || settings_.contact.method != InsideMethod::field) {
    stiffness_ = {};
  } else if (schedule_.is_due()) {
    stiffness_ = query_.stiffness();
    has_new_stiffness_ = true;
    end = monotonic_now();
    schedule_.took(measured - begin, end - measured);
  } else {
    schedule_.took(measured - begin);
    num_spared_.fetch_add(1, std::memory_order_relaxed);
  }
  publish(tool, penetration);
  contact_compute_.record(static_cast<std::int64_t>(1e9 * (end - begin)));
}

void ContactStage::publish(const ToolMoment& tool, const Penetration& penetration) {
  const LiveSurfaces& surfaces = surfaces_.taken();
  const std::uint64_t number = num_contacts() + 1;
  const LocalContact contact =
      local_contact(penetration, stiffness_, tool.X_WT, settings_.centre_of_mass_T, settings_.scale,
                    tool.time, tool.time - surfaces.capture_time);
  contacts_.publish({contact, number, surfaces.frame_number, surfaces.capture_time});
  if (settings_.keeps_records) {
    records_.push({tool.time - settings_.start_time, tool.X_WT, penetration, number,
                   surfaces.frame_number, progress_, surfaces.capture_time, contact,
                   has_new_stiffness_});
  }
  num_contacts_.store(number, std::memory_order_release);
}

}  // namespace palpate
