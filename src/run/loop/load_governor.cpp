#include "src/run/loop/load_governor.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace palpate { inline namespace v0 {
namespace {

constexpr double kWindow = 1;  // s
constexpr int kMaxHalvings = 3, kSmallestSide = 30, kMinSpheres = 50;

}  // namespace

void LoadCounts::count_ages(const LoopTimes& times, const SafetyOptions& limits, double frame_rate,
                            double contact_rate, double tick_rate) {
  const double frame = frame_rate > 0 ? 2.5 / frame_rate : 0;
  const double contact = 1.5 / std::min(contact_rate, tick_rate);
  const auto num_above = [](const LatencyHistogram& ages, double limit, double share,
                            double usual) {
    return ages.num_above(
        static_cast<std::int64_t>(1e9 * std::max(share * limit, std::min(0.9 * limit, usual))));
  };
  old_frames = num_above(times.sensor_to_force, limits.max_sensor_age, 0.5, frame);
  ageing_frames = num_above(times.sensor_to_force, limits.max_sensor_age, 0.25, frame);
  old_contacts = num_above(times.contact_age, limits.max_contact_age, 0.5, contact);
  ageing_contacts = num_above(times.contact_age, limits.max_contact_age, 0.25, contact);
}

LoadGovernor::LoadGovernor(const DepthStreamInfo& stream, const RunSettings& settings,
                           std::size_t num_spheres)
    : stream_(stream),
      num_spheres_(num_spheres),
      whole_(settings),
      relief_(make_relief(settings)) {}

/// Returns a relief with as many steps as image and tool allow.
LoadRelief LoadGovernor::make_relief(const RunSettings& settings) const {
  int image = 0, spheres = 0;
  const int side = std::min(stream_.width, stream_.height) / settings.binning;
  while (image < kMaxHalvings - 1 && side >> (image + 1) >= kSmallestSide &&
         settings.binning << (image + 1) <= kMaxBinning) {
    ++image;
  }
  while (spheres < kMaxHalvings && num_requested() >> (spheres + 1) >= kMinSpheres) ++spheres;
  return {image, spheres};
}

/// Returns the number of spheres without any steps.
std::size_t LoadGovernor::num_requested() const {
  const auto some = static_cast<std::size_t>(std::max(whole_.num_spheres, 0));
  return some == 0 ? num_spheres_ : std::min(some, num_spheres_);
}

RunSettings LoadGovernor::thinned(const RunSettings& settings, const ReliefSteps& steps) const {
  RunSettings less = settings;
  less.binning = whole_.binning << steps.image;
  less.num_spheres =
      steps.spheres > 0 ? static_cast<int>(num_requested() >> steps.spheres) : whole_.num_spheres;
  return less;
}

LoadGovernor::Decision LoadGovernor::look(double now, const RunSettings& present,
                                          const LoadCounts& counts) {
  const RunSettings decided = thinned(present, applied_);
  if (decided.binning != present.binning || decided.num_spheres != present.num_spheres) {
    whole_ = present;
    relief_ = make_relief(present);
    applied_ = {};
  }
  if (window_start_ < 0) begin_window(now, counts);
  const double seconds = now - window_start_;
  if (seconds < kWindow) return {};
  const LoadCounts before = counted_;
  begin_window(now, counts);
  if (applied_.page > 0) page_ += seconds;
  if (applied_.image > 0) image_ += seconds;
  if (applied_.spheres > 0) spheres_ += seconds;
  const auto share = [&](std::uint64_t LoadCounts::*count) {
    const double ticks = static_cast<double>(counts.ticks - before.ticks);
    return static_cast<double>(counts.*count - before.*count) / std::max(ticks, 1.0);
  };
  LoadWindow window;
  window.seconds = seconds;
  window.old_frames = share(&LoadCounts::old_frames);
  window.old_contacts = share(&LoadCounts::old_contacts);
  window.ageing = std::max(share(&LoadCounts::ageing_frames), share(&LoadCounts::ageing_contacts));
  window.has_frames = counts.frames > before.frames;
  window.has_page = counts.pictures > before.pictures;
  if (!relief_.look(window)) return {};
  const ReliefSteps last = std::exchange(applied_, relief_.steps());
  Decision decision;
  decision.note = describe_relief(last, applied_, whole_.binning, num_requested());
  if (applied_.image != last.image || applied_.spheres != last.spheres) {
    decision.settings = thinned(present, applied_);
  }
  return decision;
}

void LoadGovernor::begin_window(double now, const LoadCounts& counts) {
  window_start_ = now;
  counted_ = counts;
}

void LoadGovernor::give_up(const RunSettings& present) {
  whole_ = present;
  relief_ = LoadRelief(0, 0);
  applied_ = {};
}

std::string describe_relief(const ReliefSteps& before, const ReliefSteps& after, int binning,
                            std::size_t num_spheres) {
  std::string text;
  const auto add = [&text](const std::string& part) { text += (text.empty() ? "" : ", ") + part; };
  if (after.page != before.page) {
    add(after.page > 0 ? "pages are drawn less often" : "pages are drawn as usual");
  }
  if (after.image != before.image) {
    const int side = binning << after.image;
    add(side == 1 ? "depth images are used in full"
                  : "depth images are made " + std::to_string(side) + " times smaller");
  }
  if (after.spheres != before.spheres) {
    add(std::to_string(num_spheres >> after.spheres) + " of " + std::to_string(num_spheres) +
        " spheres are used");
  }
  if (text.empty()) return text;
  const bool is_more =
      after.page + after.image + after.spheres > before.page + before.image + before.spheres;
  return (is_more ? "the computer is overloaded: " : "the load is lower again: ") + text +
         " from now on";
}

std::string time_thinned(const LoopReport& report) {
  std::string text;
  const auto add = [&text](double seconds, const char* what) {
    if (seconds <= 0) return;
    text += (text.empty() ? "" : ", ") + std::string("for ") +
            std::to_string(std::lround(seconds)) + " s " + what;
  };
  add(report.page_thinned, "pages were drawn less often");
  add(report.image_thinned, "depth images were made smaller");
  add(report.spheres_thinned, "fewer spheres were used");
  if (text.empty()) return text;
  return text +
         ", because the computer was overloaded; close other programs, or use smaller images, "
         "fewer spheres or a GPU";
}

}}  // namespace palpate::v0
