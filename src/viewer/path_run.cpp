// A run on a simulated clock, as it was recorded.
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "palpate/io/atomic_file.h"
#include "palpate/io/depth_files.h"
#include "palpate/session/recording.h"
#include "palpate/session/run_folder.h"
#include "src/viewer/frame_periods.h"
#include "src/viewer/recorded_run.h"
#include "src/viewer/shown.h"

namespace palpate {
namespace fs = std::filesystem;
namespace {

HapticSettings haptic_settings(const RunSettings& run) {
  HapticSettings settings;
  copy_settings(settings_of(run), settings_of(settings));
  return settings;
}

std::string_view take_line(std::string_view& text) {
  const std::size_t end = std::min(text.find('\n'), text.size());
  const std::string_view line = text.substr(0, end);
  text.remove_prefix(std::min(end + 1, text.size()));
  return line;
}

/// The first numbers of a line, as many as there are.
template <std::size_t n>
std::size_t parse_numbers(std::string_view line, std::array<double, n>& values) {
  std::size_t num = 0;
  const char* at = line.data();
  const char* const end = at + line.size();
  while (num < n) {
    const auto [stop, error] = std::from_chars(at, end, values[num]);
    if (error != std::errc{}) break;
    ++num;
    if (stop == end) break;
    at = stop + 1;
  }
  return num;
}

struct FrameFile {
  double time = 0;
  fs::path path;
};

/// depth.txt, as the recorder wrote it and load_recording checked it.
Result<std::vector<FrameFile>> read_frame_list(const fs::path& folder) {
  const auto text = read_file(folder / "depth.txt");
  if (!text) return text.error();
  std::vector<FrameFile> files;
  for (std::string_view rest = *text; !rest.empty();) {
    const std::string_view line = take_line(rest);
    std::array<double, 1> time;
    const std::size_t space = line.find(' ');
    if (line.starts_with('#') || space == std::string_view::npos) continue;
    if (parse_numbers(line, time) == 1) files.push_back({time[0], folder / line.substr(space + 1)});
  }
  return files;
}

/// What a tick felt.
struct Felt {
  float volume = 0, query_seconds = 0;
  std::array<float, 6> measure{};  ///< force and torque
};

class PathRun final : public RecordedRun {
 public:
  PathRun(const fs::path& folder, Recording recording, std::vector<FrameFile> files)
      : recording_(std::move(recording)),
        settings_(haptic_settings(recording_.settings)),
        files_(std::move(files)),
        periods_(recording_.frames->info(), settings_.time),
        scale_(force_shown(recording_.tool, settings_.contact)) {
    for (const FrameFile& file : files_) periods_.add(file.time);
    read_felt(folder);
  }

  const Tool& tool() const override { return recording_.tool; }
  const DepthStreamInfo& stream() const override { return recording_.frames->info(); }
  HapticSettings settings(std::uint32_t) override { return settings_; }
  double duration() override { return tick_time(recording_.poses.size()); }
  std::size_t num_frames() override { return files_.size(); }
  std::uint64_t frame_number(std::size_t index) override { return index; }
  double period_after(std::size_t index) override { return periods_.after(index); }
  double felt_from(std::size_t index) override;
  Result<RecordedFrame> read_frame(std::size_t index) override;
  Result<RecordedQuery> query_at(double time) override;
  Result<std::vector<ViewSample>> samples(double after, double until) override;
  std::vector<RecordedMark> marks() override { return {}; }
  std::string note() override { return note_; }

 private:
  double tick_time(std::size_t tick) const {
    return static_cast<double>(tick) / recording_.settings.rate;
  }
  std::size_t last_tick(double time) const;
  void read_felt(const fs::path& folder);

  Recording recording_;
  HapticSettings settings_;
  std::vector<FrameFile> files_;
  FramePeriods periods_;
  ForceScale scale_;
  std::vector<Felt> felt_;
  std::string note_;
};

/// wrench.csv and timing.csv of the run; what is missing is not shown.
void PathRun::read_felt(const fs::path& folder) {
  constexpr std::size_t kVolume = 8, kForce = 10;
  const auto wrenches = read_file(folder / "wrench.csv"), timing = read_file(folder / "timing.csv");
  std::string_view lines = wrenches ? std::string_view(*wrenches) : std::string_view();
  std::string_view times = timing ? std::string_view(*timing) : std::string_view();
  take_line(lines);
  take_line(times);
  felt_.reserve(recording_.poses.size());
  while (felt_.size() < recording_.poses.size()) {
    std::array<double, kForce + 6> values;
    if (parse_numbers(take_line(lines), values) < values.size()) break;
    Felt& felt = felt_.emplace_back();
    felt.volume = static_cast<float>(values[kVolume]);
    for (std::size_t i = 0; i < 6; ++i) felt.measure[i] = static_cast<float>(values[kForce + i]);
    std::array<double, 2> took;
    if (parse_numbers(take_line(times), took) == 2) {
      felt.query_seconds = static_cast<float>(1e-6 * took[1]);
    }
  }
  if (felt_.size() < recording_.poses.size()) {
    note_ = "wrench.csv of the run is missing or cut off: volume and force are not shown";
  } else if (!recording_.settings.objects.empty()) {
    note_ = "the run felt objects too, which the scene does not show";
  }
}

std::size_t PathRun::last_tick(double time) const {
  const std::size_t num = recording_.poses.size();
  auto tick = static_cast<std::size_t>(
      std::clamp(time * recording_.settings.rate, 0.0, static_cast<double>(num - 1)));
  while (tick > 0 && tick_time(tick) > time) --tick;
  while (tick + 1 < num && tick_time(tick + 1) <= time) ++tick;
  return tick;
}

double PathRun::felt_from(std::size_t index) {
  std::size_t tick = last_tick(files_[index].time);
  if (tick_time(tick) < files_[index].time) ++tick;
  return tick_time(tick);
}

Result<RecordedFrame> PathRun::read_frame(std::size_t index) {
  const FrameFile& file = files_[index];
  auto frame = load_depth_png(file.path, stream().unit);
  if (!frame) return frame.error();
  return RecordedFrame{{index, file.time, *std::move(frame)}, file.time};
}

Result<RecordedQuery> PathRun::query_at(double time) {
  const std::size_t tick = last_tick(time);
  const double now = tick_time(tick);
  const auto next = std::upper_bound(files_.begin(), files_.end(), now,
                                     [](double t, const FrameFile& file) { return t < file.time; });
  const auto frame = static_cast<std::size_t>(std::max<std::ptrdiff_t>(next - files_.begin(), 1));
  return RecordedQuery{now, now, recording_.poses[tick], frame - 1, std::nullopt, 0};
}

Result<std::vector<ViewSample>> PathRun::samples(double after, double until) {
  std::vector<ViewSample> samples;
  std::size_t tick = after < 0 ? 0 : last_tick(after) + 1;
  for (; tick < felt_.size() && tick_time(tick) <= until; ++tick) {
    const Felt& felt = felt_[tick];
    const auto& f = felt.measure;
    samples.push_back(sample_shown(tick_time(tick), recording_.poses[tick],
                                   {{f[0], f[1], f[2]}, {f[3], f[4], f[5]}}, felt.volume,
                                   felt.query_seconds, scale_));
  }
  return samples;
}

}  // namespace

Result<std::unique_ptr<RecordedRun>> open_path_run(const fs::path& folder) {
  const fs::path where = folder / kRecordingFolder;
  auto recording = load_recording(where);
  if (!recording) return recording.error();
  auto files = read_frame_list(where);
  if (!files) return files.error();
  if (files->empty()) {
    return Error{Errc::bad_input, where.string() + " holds no depth frame; record the run again"};
  }
  return std::unique_ptr<RecordedRun>(
      std::make_unique<PathRun>(folder, *std::move(recording), *std::move(files)));
}

}  // namespace palpate
