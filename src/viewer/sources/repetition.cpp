#include "src/viewer/sources/repetition.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "src/run/internal/surface_picture.h"
#include "src/viewer/protocol/view_contact.h"

namespace palpate { inline namespace v0 {
namespace {

/// True if both settings make the same surfaces.
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

/// Makes the contact part on the backend of the run, or else on the CPU.
Status Repetition::make_part(RunSettings settings) {
  settings.objects.clear();  // spheres are shown as the cloud has them
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

/// Returns frames of each camera up to the one that the query rests on. A camera that was silent
/// for long is not searched for.
std::vector<Repetition::Lead> Repetition::leads_of(const RecordedQuery& query, int num_lead) {
  constexpr std::size_t kMaxSilentFrames = 64;  // frames of each of the others
  const std::size_t num_cameras = run_.streams().size(), num_requested = 1 + num_lead;
  std::vector<Lead> leads(num_cameras);
  std::size_t num_missing = num_cameras;
  const std::size_t farthest = (num_requested + kMaxSilentFrames) * num_cameras;
  for (std::size_t back = 0; back <= query.frame && back < farthest && num_missing > 0; ++back) {
    const auto [camera, number] = run_.camera_frame(query.frame - back);
    Lead& lead = leads[camera];
    if (number > query.cameras.of[camera].camera_frame || lead.size() == num_requested) continue;
    lead.insert(lead.begin(), query.frame - back);
    if (lead.size() == num_requested || number == 0) --num_missing;
  }
  return leads;
}

/// True if the timelines reach these frames by the next ones of each camera, and have all of the
/// last `num_used` of them.
bool Repetition::goes_on_to(const std::vector<Lead>& leads, std::size_t num_used) {
  if (cameras_.empty()) return false;
  for (std::size_t k = 0; k < cameras_.size(); ++k) {
    const Camera& camera = cameras_[k];
    if (leads[k].empty() != (camera.last < 0)) return false;
    if (leads[k].empty()) continue;
    const std::int64_t first = run_.camera_frame(leads[k].front()).second;
    const std::int64_t last = run_.camera_frame(leads[k].back()).second;
    if (camera.first > first || camera.last > last || camera.last + 1 < first) return false;
    const std::size_t first_used = leads[k].size() - std::min(leads[k].size(), num_used);
    if (run_.camera_frame(leads[k][first_used]).second <= camera.unused) return false;
  }
  return true;
}

Status Repetition::prepare(const std::vector<Lead>& leads, const RunSettings& settings) {
  cameras_.clear();
  RunSettings used = settings;
  used.backend = backend_;
  for (std::size_t k = 0; k < leads.size(); ++k) {
    const bool goes_on = !leads[k].empty() && run_.camera_frame(leads[k].front()).second > 0;
    const double first_period = goes_on ? run_.period_after(leads[k].front()) : 0;
    auto timeline = make_surfaces(run_.streams(), k, used, 0, first_period);
    if (!timeline) return timeline.error();
    cameras_.push_back({*std::move(timeline)});
  }
  return Done{};
}

Result<bool> Repetition::go_to(const RecordedQuery& query, const RunSettings& settings,
                               const std::function<bool()>& keep_going) {
  if (part_ == nullptr || options_ != settings.contact || num_spheres_ != settings.num_spheres) {
    if (const Status status = make_part(settings); !status) return status.error();
  }
  const std::vector<Lead> leads = leads_of(query, num_lead_frames(settings.time));
  const std::size_t num_used = 1 + static_cast<std::size_t>(num_blended_frames(settings.time));
  if (!makes_same_surfaces(settings, made_with_) || !goes_on_to(leads, num_used)) {
    made_with_ = settings;
    const Status status = prepare(leads, settings);
    if (!status) return status.error();
  }
  const bool is_as_recorded = run_.settings(query.revision).time.mode == settings.time.mode;
  if (views_.num_cameras() != leads.size()) views_ = CameraViews(leads.size());
  views_.clear();
  for (std::size_t k = 0; k < leads.size(); ++k) {
    Camera& camera = cameras_[k];
    std::size_t num_left = leads[k].size();
    for (const std::size_t index : leads[k]) {
      // Earlier frames matter only for averages.
      const bool is_used = num_left-- <= num_used;
      const PixelWindow window = is_used ? PixelWindow{} : PixelWindow{0, 0, 1, 1};
      const std::int64_t number = run_.camera_frame(index).second;
      if (number <= camera.last) continue;
      if (!keep_going()) return false;
      const auto frame = frames_.get(index);
      if (!frame) return frame.error();
      camera.clock = (*frame)->clock;
      camera.timeline.push((*frame)->shown.frame, camera.clock, pool_, window);
      if (camera.first < 0) camera.first = number;
      camera.last = number;
      if (!is_used) camera.unused = number;
      camera.index = index;
    }
    if (!camera.timeline.status()) return camera.timeline.status().error();
    if (camera.last < 0) continue;  // no frame yet
    views_[k] = camera.timeline.at(std::max(query.clock, camera.clock));
    if (is_as_recorded) views_[k].progress = query.cameras.of[k].progress;
    views_.remember(camera.timeline.key_frames(), views_[k].progress);
  }
  query_.X_WT = query.X_WT;
  return true;
}

const Penetration& Repetition::measure() {
  part_->measure(views_.all(), false, query_);
  return query_.penetration;
}

ViewSurface Repetition::surface() {
  ViewSurface shown;
  Camera& first = cameras_.front();
  make_surface_picture(first.timeline.newest_cloud(pool_), run_.frame_number(first.index), shown);
  return shown;
}

}}  // namespace palpate::v0
