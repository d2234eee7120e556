#include "src/viewer/repetition.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "src/viewer/shown.h"

namespace palpate {
namespace {

/// Are surfaces made alike with these?
bool makes_same_surfaces(const RunSettings& a, const RunSettings& b) {
  const auto has_field = [](const RunSettings& settings) {
    return settings.contact.method == MethodKind::field;
  };
  return has_same_settings(a.surface, b.surface) && has_same_settings(a.field, b.field) &&
         has_same_settings(a.time, b.time) && has_field(a) == has_field(b) &&
         a.binning == b.binning;
}

}  // namespace

Repetition::Repetition(RecordedRun& run)
    : run_(run), frames_(run), pool_(0), index_(ToolIndex::create(run.tool())) {}

/// On the backend of the run if it is there.
Status Repetition::make_part(RunSettings settings) {
  backend_ = settings.backend.value_or(Backend::cpu);
  auto part = make_contact_part(index_, settings, {});
  if (!part && backend_ != Backend::cpu) {
    settings.backend = backend_ = Backend::cpu;
    note_ = "the run was computed on a GPU; it is shown as the CPU computes it";
    part = make_contact_part(index_, settings, {});
  }
  if (!part) return part.error();
  part_ = *std::move(part);
  options_ = settings.contact;
  num_spheres_ = settings.num_spheres;
  return Done{};
}

Status Repetition::prepare(std::size_t first, const RunSettings& settings) {
  timeline_.reset();
  RunSettings used = settings;
  used.backend = backend_;
  if (first > 0 && run_.period_after(first) > 0) used.time.first_period = run_.period_after(first);
  auto timeline = make_surfaces(run_.stream(), used);
  if (!timeline) return timeline.error();
  timeline_ = *std::move(timeline);
  first_ = next_ = first;
  return Done{};
}

Result<bool> Repetition::go_to(const RecordedQuery& query, const RunSettings& settings,
                               const std::function<bool()>& keep_going) {
  if (part_ == nullptr || options_ != settings.contact || num_spheres_ != settings.num_spheres) {
    if (const Status status = make_part(settings); !status) return status.error();
  }
  const int lead = num_lead_frames(settings.time);
  const auto num_lead = std::min(query.frame, static_cast<std::size_t>(lead));
  const std::size_t wanted_first = query.frame - num_lead;
  const bool is_near = query.frame + 1 >= next_ && query.frame <= next_ + num_lead;
  if (!timeline_ || !makes_same_surfaces(settings, made_with_) || !is_near ||
      first_ > wanted_first) {
    made_with_ = settings;
    const Status status = prepare(wanted_first, settings);
    if (!status) return status.error();
  }
  double clock = 0;
  for (; next_ <= query.frame; ++next_) {
    if (!keep_going()) return false;
    const auto frame = frames_.get(next_);
    if (!frame) return frame.error();
    clock = (*frame)->clock;
    timeline_->push((*frame)->shown.frame, clock, pool_);
  }
  if (!timeline_->status()) return timeline_->status().error();
  asked_.X_WT = query.X_WT;
  moment_ = timeline_->at(std::max(query.clock, clock));
  const bool is_as_recorded = run_.settings(query.revision).time.mode == settings.time.mode;
  if (query.progress && is_as_recorded) moment_.progress = *query.progress;
  return true;
}

const Penetration& Repetition::measure() {
  part_->measure(moment_, false, asked_);
  return asked_.penetration;
}

ViewSurface Repetition::surface(std::uint64_t frame_number) {
  ViewSurface shown;
  make_surface_picture(timeline_->newest_cloud(pool_), frame_number, shown);
  return shown;
}

}  // namespace palpate
