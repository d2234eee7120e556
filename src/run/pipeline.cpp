// All parts of a run in one thread, without a clock: see Pipeline.
#include "src/run/internal/pipeline.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "src/run/setting_changes.h"

namespace palpate { inline namespace v0 {

void add_notes(std::vector<std::string>& notes, const std::vector<std::string>& news) {
  for (const std::string& note : news) {
    if (notes.size() == kMaxNotes) return;
    if (std::ranges::find(notes, note) == notes.end()) notes.push_back(note);
  }
}

Pipeline::Pipeline(std::shared_ptr<const ToolIndex> index, std::vector<DepthStreamInfo> streams,
                   const DeviceInfo& device, const RunSettings& settings,
                   std::unique_ptr<ThreadPool> pool, RunParts parts, SafetyFilter safety)
    : index_(std::move(index)),
      streams_(std::move(streams)),
      device_(device),
      settings_(settings),
      checked_coupling_(parts.checked_coupling),
      notes_(std::move(parts.notes)),
      pool_(std::move(pool)),
      timelines_(std::move(parts.timelines)),
      contacts_(std::move(parts.contact)),
      hand_(std::make_unique<HandPart>(std::move(parts.coupling), std::move(safety),
                                       1 / device.rate)),
      cameras_(streams_.size()),
      seen_(streams_.size()),
      num_camera_frames_(streams_.size()) {}

Result<Pipeline> Pipeline::create(const Tool& tool, std::vector<DepthStreamInfo> streams,
                                  const DeviceInfo& device, const RunSettings& settings) {
  auto pool = std::make_unique<ThreadPool>(std::clamp(settings.num_threads, 0, 256));
  RunPartsOptions options;
  if (settings.num_threads > 1) options.query_threads = pool.get();
  auto index = ToolIndex::create(tool);
  auto parts = make_run_parts(index, streams, device, settings, options);
  if (!parts) return parts.error();
  auto safety = SafetyFilter::create(device.limits, settings.safety);
  if (!safety) return safety.error();
  return Pipeline(std::move(index), std::move(streams), device, settings, std::move(pool),
                  *std::move(parts), *std::move(safety));
}

double CameraViews::capture_time(double none) const {
  double oldest = std::numeric_limits<double>::infinity();
  for (const CameraFrame& frame : frames_) {
    if (frame.number >= 0) oldest = std::min(oldest, frame.capture_time);
  }
  return std::isfinite(oldest) ? oldest : none;
}

ContactRecord CameraViews::record(const Pose& X_WT, double time, double start_time) const {
  ContactRecord record;
  record.time = time - start_time;
  record.X_WT = X_WT;
  record.contact.time = time;
  record.capture_time = capture_time(time);
  record.cameras.num = static_cast<std::uint32_t>(frames_.size());
  for (std::size_t k = 0; k < frames_.size(); ++k) {
    record.cameras.of[k] = {frames_[k].number, views_[k].progress};
  }
  return record;
}

SurfaceStats Pipeline::push(const DepthFrame& frame, double time, std::size_t camera) {
  ++num_frames_;
  const CameraFrame now{num_camera_frames_[camera]++, time};
  if (!pending_) {
    seen_[camera] = now;
    return timelines_[camera].push(frame, time, *pool_);
  }
  // A query never mixes surfaces made with the old settings and with the new ones: these wait until
  // all cameras have one.
  const SurfaceStats stats = pending_->timelines[camera].push(frame, time, *pool_);
  pending_->seen[camera] = now;
  frame_revision_ = pending_->revision;
  const bool has_all = std::all_of(pending_->seen.begin(), pending_->seen.end(),
                                   [](const CameraFrame& one) { return one.number >= 0; });
  if (has_all) use(*pending_);
  return stats;
}

const ContactRecord& Pipeline::measure(const Pose& X_WT, double time) noexcept {
  bool has_failed = false;
  cameras_.begin();
  for (std::size_t k = 0; k < timelines_.size(); ++k) {
    cameras_.show(k, seen_[k], timelines_[k].at(time), timelines_[k].key_frames());
    has_failed = has_failed || !timelines_[k].status();
  }
  ContactRecord contact = cameras_.record(X_WT, time, start_time_);
  contact.revision = surface_revision_;
  contact.number = contact_.number + 1;
  contact.frame_number = num_frames_ - 1;
  const bool is_coupled = settings_.coupling.kind != CouplingKind::none;
  contacts_->measure(cameras_.all(), is_coupled || has_friction(settings_), contact);
  if (contact.penetration.status.has(StepStatus::backend_failed) || has_failed) {
    has_backend_failed_ = true;
    return contact_;
  }
  return contact_ = contact;
}

const TickRecord& Pipeline::tick(const DeviceState& state, TickFlags flags) noexcept {
  const bool has_time = std::isfinite(state.time);
  if (!has_begun_ && has_time) {
    start_time_ = state.time;
    hand_->set_start_time(start_time_);
    has_begun_ = true;
  }
  const bool is_prescribed = settings_.coupling.kind == CouplingKind::none;
  const bool can_measure = num_frames_ > 0 && !has_backend_failed_ && has_time;
  if (is_prescribed && can_measure &&
      (hand_->has_tool() || (state.is_valid && is_finite(state.X_BH)))) {
    measure(hand_->held_pose(state), state.time);
  }
  flags.has_backend_failed = flags.has_backend_failed || has_backend_failed_;
  hand_->tick(state, contact_, flags, record_);
  if (!is_prescribed && can_measure && hand_->has_tool()) measure(record_.step.X_WT, state.time);
  return record_;
}

Status Pipeline::change(const RunSettings& settings) {
  if (const Status status = check_change(settings_, settings); !status) return status;
  RunPartsOptions options;
  options.before = &settings_;
  if (settings_.num_threads > 1) options.query_threads = pool_.get();
  auto parts = make_run_parts(index_, streams_, device_, settings, options);
  if (!parts) return parts.error();
  ++revision_;
  hand_->change(revision_, parts->coupling);
  checked_coupling_ = parts->checked_coupling;
  add_notes(notes_, parts->notes);
  settings_ = settings;
  Pending news{revision_, std::move(parts->timelines), std::move(parts->contact), parts->scale,
               std::vector<CameraFrame>(streams_.size())};
  if (pending_ && news.timelines.empty()) {
    news.timelines = std::move(pending_->timelines);
    news.seen = std::move(pending_->seen);
  }
  if (pending_ && !news.contact) news.contact = std::move(pending_->contact);
  pending_ = std::move(news);
  if (pending_->timelines.empty()) use(*pending_);
  return Done{};
}

void Pipeline::use(Pending& pending) {
  if (!pending.timelines.empty()) {
    timelines_ = std::move(pending.timelines);
    seen_ = std::move(pending.seen);
  }
  if (pending.contact) {
    pending.contact->take_over(*contacts_);
    contacts_ = std::move(pending.contact);
  }
  contacts_->use(pending.scale);
  surface_revision_ = frame_revision_ = pending.revision;
  pending_.reset();
}

Status Pipeline::status() const {
  for (const SurfaceTimeline& timeline : timelines_) {
    if (!timeline.status()) return timeline.status();
  }
  if (!has_backend_failed_) return Done{};
  return lost_backend();
}

}}  // namespace palpate::v0
