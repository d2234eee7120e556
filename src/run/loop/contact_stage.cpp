#include "src/run/loop/contact_stage.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "src/core/internal/guarded.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/run/internal/real_time.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kPriority = 70;              // below the haptic thread
constexpr std::size_t kNumRecords = 8192;  // some seconds
/// Share of a tick after which the haptic thread has published the tool's pose.
constexpr double kAfterTick = 0.05;

/// Returns a picture with room for every sphere, so that filling it allocates nothing.
ContactPicture blank_picture(std::size_t num_spheres) {
  ContactPicture picture;
  picture.spheres.resize(num_spheres);
  return picture;
}

}  // namespace

ContactStage::ContactStage(std::unique_ptr<ContactPart> part, SurfaceStage& surfaces,
                           const Settings& settings, LatencyHistogram& contact_compute)
    : part_(std::move(part)),
      surfaces_(surfaces),
      settings_(settings),
      contact_compute_(contact_compute),
      views_(surfaces.num_cameras()),
      cameras_(surfaces.num_cameras()),
      schedule_(1 / settings.rate),
      records_(settings.keeps_records ? kNumRecords : 0),
      pictures_{TripleBuffer(blank_picture(settings.num_spheres)),
                TripleBuffer(blank_picture(settings.num_spheres))} {}

void ContactStage::start(double start_time, std::function<void(const Error&)> fail) {
  settings_.start_time = start_time;
  thread_ = std::thread([this, fail = std::move(fail)] { guarded([&] { work(); }, fail); });
}

void ContactStage::stop() noexcept {
  is_stopping_.store(true, std::memory_order_release);
  if (thread_.joinable()) thread_.join();
}

/// Reports no error: the contact thread does, which is granted or refused the same.
void ContactStage::begin_thread() { request_real_time(kPriority); }

void ContactStage::move_tool(const TimedToolPose& tool) noexcept { tools_.publish(tool); }

const ContactRecord& ContactStage::newest() noexcept {
  contacts_.refresh();
  return contacts_.value();
}

void ContactStage::work() {
  if (settings_.wants_real_time) real_time_error_.store(request_real_time(kPriority));
  while (!is_stopping_.load(std::memory_order_acquire)) {
    if (tools_.refresh() && is_due(tools_.value().time)) {
      measure(tools_.value());
    } else {
      sleep_until(next_look(monotonic_now()));
    }
  }
}

/// Returns the time of the next look, s: shortly after the next tick is expected. A late tick is
/// polled, less often the later it is; a leap of the device's clock is not waited for.
double ContactStage::next_look(double now) const {
  const double tick = settings_.tick_seconds;
  const double expected =
      std::max(tools_.value().time + tick, next_due_ - tick / 2) + kAfterTick * tick;
  if (!(expected < now + 1 / settings_.rate + 2 * tick)) return now + tick;
  const double late = now - expected;
  return late < 0 ? expected : now + std::clamp(late / 4, tick / 16, tick);
}

/// True if a query is due; half a tick early is in time, as ticks jitter.
bool ContactStage::is_due(double time) {
  if (!std::isfinite(time)) return false;
  // The device's clock was ahead for a while.
  if (next_due_ > time + 1 / settings_.rate + settings_.tick_seconds) next_due_ = time;
  if (time < next_due_ - settings_.tick_seconds / 2) return false;
  next_due_ = std::max(next_due_, time - settings_.tick_seconds) + 1 / settings_.rate;
  return true;
}

/// Updates the views of all cameras to this time. Surfaces that a change has requested are used
/// once all cameras have them; until then those before stay, whose timelines the change keeps.
void ContactStage::look(double time) {
  oldest_revision_ = ~std::uint32_t{0};
  for (std::size_t k = 0; k < views_.size(); ++k) {
    if (views_[k].blend.is_complete(time)) surfaces_.take(k);
    oldest_revision_ = std::min(oldest_revision_, surfaces_.taken(k).revision);
  }
  // A change is offered before there are surfaces of it, so it is seen with them.
  const ContactChange* const change = changes_.look();
  const std::uint32_t awaited = change != nullptr && oldest_revision_ < change->surface_revision
                                    ? change->surface_revision
                                    : ~std::uint32_t{0};
  newest_frame_ = 0;
  cameras_.begin();
  for (std::size_t k = 0; k < views_.size(); ++k) {
    View& view = views_[k];
    const LiveSurfaces& taken = surfaces_.taken(k);
    if (taken.ready_time != view.surfaces.ready_time && taken.revision < awaited) {
      view.surfaces = taken;
      if (taken.blend.progress < 1)
        view.blend.begin(time, last_look_, taken.ready_time, taken.period);
    }
    cameras_[k] = view.surfaces.blend;
    if (cameras_[k].progress < 1) cameras_[k].progress = view.blend.progress(time);
    cameras_.remember(view.surfaces.key_frames.all(), cameras_[k].progress);
    newest_frame_ = std::max(newest_frame_, view.surfaces.frame_number);
  }
  last_look_ = time;
}

void ContactStage::take_change() {
  ContactChange* const change = changes_.look();
  if (change == nullptr || oldest_revision_ < change->surface_revision) return;
  revision_ = change->revision;
  settings_.rate = change->rate;
  if (change->part) {
    change->part->take_over(*part_);
    std::swap(part_, change->part);
    backend_failed_.store(false, std::memory_order_release);
  }
  part_->use(change->scale);
  schedule_ = StiffnessSchedule(1 / settings_.rate);
  next_due_ = 0;
  changes_.settle();
}

void ContactStage::measure(const TimedToolPose& tool) {
  const double begin = monotonic_now();
  look(begin);
  take_change();
  ContactRecord contact;
  contact.revision = revision_;
  contact.number = num_contacts() + 1;
  contact.time = tool.time - settings_.start_time;
  contact.X_WT = tool.X_WT;
  contact.frame_number = newest_frame_;
  contact.cameras.num = static_cast<std::uint32_t>(views_.size());
  for (std::size_t k = 0; k < views_.size(); ++k) {
    const LiveSurfaces& surfaces = views_[k].surfaces;
    contact.cameras.of[k] = {static_cast<std::int64_t>(surfaces.camera_frame),
                             cameras_[k].progress};
    contact.capture_time =
        k == 0 ? surfaces.capture_time : std::min(contact.capture_time, surfaces.capture_time);
  }
  contact.contact.time = tool.time;
  part_->measure(cameras_.all(), part_->has_stiffness() && schedule_.is_due(), contact);
  const bool has_failed = contact.penetration.status.has(StepStatus::backend_failed);
  backend_failed_.store(has_failed, std::memory_order_release);
  if (has_failed) return;  // a change may bring another part
  const double end = monotonic_now();
  schedule_.took(end - begin, contact.has_new_stiffness);
  if (part_->has_stiffness() && contact.penetration.volume > 0 && !contact.has_new_stiffness) {
    num_spared_.fetch_add(1, std::memory_order_relaxed);
  }
  if (contact.penetration.status.has(StepStatus::outside_window)) {
    num_outside_.fetch_add(1, std::memory_order_relaxed);
  }
  contacts_.publish(contact);
  if (settings_.keeps_records) records_.push(contact);
  num_contacts_.store(contact.number, std::memory_order_release);
  contact_compute_.record(static_cast<std::int64_t>(1e9 * (end - begin)));
  for (std::size_t who = 0; who < kNumPictureConsumers; ++who) {
    if (!wants_picture_[who].exchange(false, std::memory_order_relaxed)) continue;
    make_picture(contact, pictures_[who].draft());
    pictures_[who].publish();
  }
}

void ContactStage::make_picture(const ContactRecord& contact, ContactPicture& picture) {
  picture.contact_number = num_contacts();
  picture.frame_number = newest_frame_;
  picture.X_WT = contact.X_WT;
  picture.bodies = contact.bodies;
  // No more than there was room for at the start.
  picture.spheres.resize(part_->query().index()->tool().spheres().size());
  part_->query().measure(cameras_.all(), contact.X_WT, picture.spheres.wants());
}

}}  // namespace palpate::v0
