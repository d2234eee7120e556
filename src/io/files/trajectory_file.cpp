#include "palpate/io/files.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <optional>
#include <span>
#include <string>

#include "src/cloud/internal/frame_limits.h"
#include "src/io/internal/atomic_file.h"
#include "src/io/internal/text_scanner.h"

namespace palpate { inline namespace v0 {
namespace {

/// Exactly `values.size()` finite numbers; otherwise what is wrong.
std::optional<std::string> parse_values(std::string_view text, std::span<double> values) {
  const auto desired = std::to_string(values.size());
  for (double& value : values) {
    const std::string_view word = take_word(text);
    if (word.empty()) return "has fewer than " + desired + " numbers";
    const auto number = parse_number<double>(word);
    if (!number || !std::isfinite(*number))
      return "has '" + std::string(word.substr(0, 40)) + "' where a finite number is needed";
    value = *number;
  }
  if (!take_word(text).empty()) return "has more than " + desired + " numbers";
  return std::nullopt;
}

/// Pose from tx ty tz qx qy qz qw; nullopt for the zero quaternion.
std::optional<Pose> pose_of_line(std::span<const double, 7> v) {
  // Scaled first, so that no square overflows or vanishes.
  const double largest = std::max({std::abs(v[3]), std::abs(v[4]), std::abs(v[5]), std::abs(v[6])});
  if (!(largest > 0)) return std::nullopt;
  return Pose{
      {v[0], v[1], v[2]},
      normalized(Quaternion{v[3] / largest, v[4] / largest, v[5] / largest, v[6] / largest})};
}

constexpr const char* kNoSeconds =
    ", as if in nanoseconds or the like; times are in seconds: divide nanoseconds by 1e9";

std::string shown(double number) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", number);
  return text;
}

}  // namespace

Result<std::vector<TimedPose>> load_trajectory(const std::filesystem::path& path) {
  const auto content = read_file(path);
  if (!content) return content.error();
  std::vector<TimedPose> poses;
  std::string_view rest = without_mark(*content);
  for (int line_number = 1; !rest.empty(); ++line_number) {
    const std::string_view line = take_line(rest);
    std::string_view words = line.substr(0, line.find('#'));
    if (std::string_view blank = words; take_word(blank).empty()) continue;
    const auto bad = [&](const std::string& what) {
      return Error{Errc::bad_input, path.string() + " line " + std::to_string(line_number) + " " +
                                        what + "; a line is 't tx ty tz qx qy qz qw'"};
    };
    std::array<double, 8> values;
    if (const auto trouble = parse_values(words, values)) return bad(*trouble);
    const auto pose = pose_of_line(std::span(values).subspan<1>());
    if (!pose) return bad("has a zero quaternion");
    if (!poses.empty() && values[0] < poses.back().time) return bad("goes back in time");
    if (!is_in_seconds(values[0])) return bad("has the time " + shown(values[0]) + kNoSeconds);
    poses.push_back({values[0], *pose});
  }
  if (poses.empty())
    return Error{Errc::bad_input,
                 path.string() + " has no pose; a line is 't tx ty tz qx qy qz qw'"};
  if (const double step = usual_step(poses); step > kLongestUsualStep) {
    return Error{Errc::bad_input,
                 path.string() + " has times that lie " + shown(step) + " apart" + kNoSeconds};
  }
  return poses;
}

Status save_trajectory(const std::vector<TimedPose>& poses, const std::filesystem::path& path) {
  std::string text = "# t tx ty tz qx qy qz qw\n";
  for (const auto& [time, X_WT] : poses) {
    const auto& [p, q] = X_WT;
    for (const double value : {time, p.x, p.y, p.z, q.x, q.y, q.z, q.w}) {
      std::array<char, 32> digits;
      const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
      text.append(digits.data(), end);
      text += ' ';
    }
    text.back() = '\n';
  }
  return write_file_atomically(path, text);
}

Result<Pose> parse_pose(std::string_view text) {
  std::array<double, 7> values;
  const auto bad = [](const std::string& what) {
    return Error{Errc::invalid_argument, "the pose " + what + "; give 'tx ty tz qx qy qz qw'"};
  };
  if (const auto trouble = parse_values(text, values)) return bad(*trouble);
  const auto pose = pose_of_line(values);
  if (!pose) return bad("has a zero quaternion");
  return *pose;
}

Pose pose_at(const std::vector<TimedPose>& poses, double time) {
  const auto after =
      std::upper_bound(poses.begin(), poses.end(), time,
                       [](double t, const TimedPose& pose) { return t < pose.time; });
  if (after == poses.begin()) return poses.front().X_WT;
  if (after == poses.end()) return poses.back().X_WT;
  const TimedPose &a = *(after - 1), &b = *after;
  return interpolate(a.X_WT, b.X_WT, (time - a.time) / (b.time - a.time));
}

}}  // namespace palpate::v0
