#include "src/haptics/contact_stage.h"

#include <algorithm>
#include <utility>

#include "src/core/monotonic_clock.h"
#include "src/haptics/real_time.h"

namespace palpate {
namespace {

constexpr int kPriority = 70;              // below the haptic thread
constexpr std::size_t kNumRecords = 4096;  // some seconds
/// Of a tick, from its begin on: by then it has published where the tool is.
constexpr double kAfterTick = 0.05;
constexpr auto kFailed = static_cast<std::uint32_t>(StepStatus::backend_failed);

/// With room for every sphere: a picture allocates nothing.
ContactPicture blank_picture(std::size_t num_spheres) {
  ContactPicture picture;
  picture.states.resize(num_spheres);
  picture.planes.resize(num_spheres);
  return picture;
}

}  // namespace

ContactStage::ContactStage(std::unique_ptr<BlendedQuery> query, SurfaceStage& surfaces,
                           const Settings& settings, LatencyHistogram& contact_compute)
    : query_(std::move(query)),
      surfaces_(surfaces),
      settings_(settings),
      contact_compute_(contact_compute),
      schedule_(1 / settings.rate),
      records_(settings.keeps_records ? kNumRecords : 0),
      pictures_(blank_picture(settings.num_spheres)) {}

void ContactStage::start(double start_time) {
  settings_.start_time = start_time;
  thread_ = std::thread([this] { work(); });
}

void ContactStage::stop() noexcept {
  is_stopping_.store(true, std::memory_order_release);
  if (thread_.joinable()) thread_.join();
}

void ContactStage::move_tool(const ToolMoment& tool) noexcept { tools_.publish(tool); }

const KnownContact& ContactStage::newest() noexcept {
  contacts_.refresh();
  return contacts_.value();
}

void ContactStage::work() {
  if (settings_.wants_real_time) real_time_error_.store(ask_for_real_time(kPriority));
  while (!is_stopping_.load(std::memory_order_acquire)) {
    if (tools_.refresh() && is_due(tools_.value().time)) {
      measure(tools_.value());
    } else {
      sleep_until(next_look(monotonic_now()));
    }
  }
}

/// Shortly after the next tick is expected. One that is late is looked for again and again, less
/// often the longer it is silent.
double ContactStage::next_look(double now) const {
  const double tick = settings_.tick_seconds;
  const double expected =
      std::max(tools_.value().time + tick, next_due_ - tick / 2) + kAfterTick * tick;
  const double late = now - expected;
  return late < 0 ? expected : now + std::clamp(late / 4, tick / 16, tick);
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

/// A change that needs other surfaces has been offered before these, so it is seen with them.
void ContactStage::take_change() {
  ContactChange* const change = changes_.look();
  if (change == nullptr || surfaces_.taken().revision < change->surface_revision) return;
  revision_ = change->revision;
  settings_.contact = change->contact;
  settings_.rate = change->rate;
  settings_.scale = change->scale;
  if (change->query) std::swap(query_, change->query);
  schedule_ = StiffnessSchedule(1 / settings_.rate);
  next_due_ = 0;
  changes_.settle();
}

void ContactStage::measure(const ToolMoment& tool) {
  const double begin = monotonic_now();
  const SurfaceMoment moment = moment_at(begin);
  take_change();
  query_->set_moment(moment);
  const Penetration penetration = query_->query(tool.X_WT, settings_.contact);
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
    stiffness_ = query_->stiffness();
    has_new_stiffness_ = true;
    end = monotonic_now();
    schedule_.took(measured - begin, end - measured);
  } else {
    schedule_.took(measured - begin);
    num_spared_.fetch_add(1, std::memory_order_relaxed);
  }
  publish(tool, penetration);
  contact_compute_.record(static_cast<std::int64_t>(1e9 * (end - begin)));
  if (wants_picture_.exchange(false, std::memory_order_relaxed)) make_picture(tool);
}

void ContactStage::publish(const ToolMoment& tool, const Penetration& penetration) {
  const LiveSurfaces& surfaces = surfaces_.taken();
  const std::uint64_t number = num_contacts() + 1;
  const LocalContact contact =
      local_contact(penetration, stiffness_, tool.X_WT, settings_.centre_of_mass_T, settings_.scale,
                    tool.time, tool.time - surfaces.capture_time);
  contacts_.publish({contact, number, surfaces.frame_number, surfaces.capture_time});
  if (settings_.keeps_records) {
    records_.push({revision_, tool.time - settings_.start_time, tool.X_WT, penetration, number,
                   surfaces.frame_number, progress_, surfaces.capture_time, contact,
                   has_new_stiffness_});
  }
  num_contacts_.store(number, std::memory_order_release);
}

void ContactStage::make_picture(const ToolMoment& tool) {
  ContactPicture& picture = pictures_.draft();
  picture.contact_number = num_contacts();
  picture.frame_number = surfaces_.taken().frame_number;
  picture.X_WT = tool.X_WT;
  const auto states = query_->states();
  const auto planes = query_->planes();
  picture.states.assign(states.begin(), states.end());
  picture.planes.assign(planes.begin(), planes.end());
  pictures_.publish();
}

}  // namespace palpate
