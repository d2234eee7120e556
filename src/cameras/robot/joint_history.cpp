#include "src/cameras/robot/joint_history.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <unordered_set>
#include <utility>

#include "src/core/internal/message_text.h"
#include "src/io/internal/text_scanner.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kShortestBase =
    0.02;  // s between the samples of a velocity, so that noise stays small

/// From a to b; of an endless joint not more than half a turn.
double way(double a, double b, bool is_endless) {
  return is_endless ? std::remainder(b - a, 2 * std::numbers::pi) : b - a;
}

}  // namespace

JointHistory::JointHistory(std::vector<Joint> joints, double kept_seconds)
    : joints_(std::move(joints)), kept_seconds_(kept_seconds), samples_(joints_.size()) {
  for (std::size_t i = 0; i < joints_.size(); ++i) numbers_.emplace(joints_[i].name, i);
}

void JointHistory::add(std::string_view joint, double time, double position) {
  const auto number = numbers_.find(joint);
  if (number == numbers_.end()) return;
  if (!(std::abs(position) <= kLargestPosition)) {
    Impossible& newest = impossible_[number->second];
    const bool is_reported = std::abs(newest.position) > kLargestPosition;  // that is kept
    newest = {is_reported && std::isnan(position) ? newest.position : position, true};
    return;
  }
  const auto impossible = impossible_.find(number->second);
  if (impossible != impossible_.end()) impossible->second.is_newest = false;
  insert_by_time(samples_[number->second], time, position, kept_seconds_);
}

double JointHistory::known_until() const {
  double until = std::numeric_limits<double>::infinity();
  for (const auto& samples : samples_) {
    until = std::min(until, samples.empty() ? -std::numeric_limits<double>::infinity()
                                            : samples.rbegin()->first);
  }
  return until;
}

Result<double> JointHistory::at(std::size_t joint, double time, double max_age,
                                bool may_stay) const {
  const auto& [name, is_endless] = joints_[joint];
  const ByTime<double>& samples = samples_[joint];
  if (may_stay && samples.size() == 1) return samples.begin()->second;
  if (samples.empty() || nearest_in_time(samples, time) > max_age) {
    const auto impossible = impossible_.find(joint);
    const bool is_reason = impossible != impossible_.end() && impossible->second.is_newest;
    const std::string why = !is_reason ? ""
                            : std::isnan(impossible->second.position)
                                ? "; it is told to be at NaN"
                                : "; it was told to be where no joint is";
    char text[80] = "'";
    if (!samples.empty()) {
      std::snprintf(text, sizeof text, "' within %.3g s, the nearest is %.3g s away", max_age,
                    nearest_in_time(samples, time));
    }
    return Error{Errc::unavailable, "no state for joint '" + shown(name) + text + why};
  }
  const auto after = samples.lower_bound(time);
  if (after == samples.begin()) return after->second;
  const auto& [time_before, before] = *std::prev(after);
  if (after != samples.end()) {
    const double share = (time - time_before) / (after->first - time_before);
    return before + share * way(before, after->second, is_endless);
  }
  const auto base = samples.upper_bound(time_before - kShortestBase);
  if (base == samples.begin()) return before;
  const auto& [time_from, from] = *std::prev(base);
  if (time_before - time_from > max_age + kShortestBase) return before;
  const double speed = way(from, before, is_endless) / (time_before - time_from);
  return before + speed * (time - time_before);
}

std::string JointHistory::impossible() const {
  for (const auto& [joint, reported] : impossible_) {
    if (std::isnan(reported.position)) continue;
    char text[40];
    std::snprintf(text, sizeof text, "' is at %.3g rad or m", reported.position);
    return "joint '" + shown(joints_[joint].name) + text;
  }
  return "";
}

std::string JointHistory::missing() const {
  std::string names;
  for (std::size_t i = 0; i < joints_.size(); ++i) {
    if (!samples_[i].empty()) continue;
    const auto impossible = impossible_.find(i);
    const bool is_nan = impossible != impossible_.end() && std::isnan(impossible->second.position);
    names += (names.empty() ? "" : ", ") + shown(joints_[i].name) + (is_nan ? " (at NaN)" : "");
  }
  return names;
}

Status read_joint_table(std::string_view text, const std::string& name, JointHistory& history) {
  std::vector<std::string> joints;
  double last = 0;
  int num_rows = 0;
  std::string_view rest = without_mark(text);
  for (int line_number = 1; !rest.empty(); ++line_number) {
    const std::string_view line = take_line(rest);
    const auto bad = [&](const std::string& what) {
      return Error{Errc::bad_input, name + " line " + std::to_string(line_number) + " " + what};
    };
    std::string words(line.substr(0, line.find('#')));
    std::ranges::replace_if(
        words, [](char c) { return c == ',' || c == ';' || c == '"'; }, ' ');
    std::string_view left = words;
    std::vector<std::string_view> cells;
    for (auto word = take_word(left); !word.empty(); word = take_word(left)) cells.push_back(word);
    if (cells.empty()) continue;
    if (joints.empty()) {
      if (cells.size() < 2 || parse_number<double>(cells[0])) {
        return bad("must name the columns: time, then joints; e.g. 'time,elbow,wrist'");
      }
      joints.assign(cells.begin() + 1, cells.end());
      std::unordered_set<std::string_view> known;
      for (const std::string& joint : joints) {
        if (joint == "time") return bad("must have the time as its first column");
        if (known.insert(joint).second) continue;
        return bad("has two columns '" + joint.substr(0, 40) + "'; leave one of them out");
      }
      continue;
    }
    if (cells.size() != joints.size() + 1) {
      return bad("has " + std::to_string(cells.size()) + " values, not one for each of the " +
                 std::to_string(joints.size() + 1) + " columns");
    }
    std::vector<double> numbers;
    for (const std::string_view cell : cells) {
      const auto number = parse_number<double>(cell);
      if (!number || !std::isfinite(*number)) {
        return bad("has '" + std::string(cell.substr(0, 40)) + "' where a finite number is needed");
      }
      if (!numbers.empty() && std::abs(*number) > kLargestPosition) {
        return bad("has '" + std::string(cell.substr(0, 40)) +
                   "' where a position is needed: at most a million rad or m");
      }
      numbers.push_back(*number);
    }
    if (num_rows++ > 0 && numbers[0] < last) return bad("goes back in time");
    last = numbers[0];
    for (std::size_t i = 0; i < joints.size(); ++i) history.add(joints[i], last, numbers[i + 1]);
  }
  if (num_rows > 0) return Done{};
  return Error{
      Errc::bad_input,
      name +
          " has no joint positions; the first line names the columns, e.g. 'time,elbow,wrist', and "
          "each other line has a time in s and positions in rad or m"};
}

}}  // namespace palpate::v0
