#include "src/ros/tf_history.h"

#include <algorithm>
#include <iterator>

#include "src/ros/by_time.h"
#include "src/ros/tf_tree.h"

namespace palpate {

void TfHistory::add(const RosStampedTransform& transform, bool is_static) {
  const std::string child = plain_frame(transform.child);
  if (links_.size() >= kMostFrames && !links_.contains(child)) return;
  Link& link = links_[child];
  link.parent = plain_frame(transform.parent);
  link.is_static = is_static;
  if (is_static) link.X_PC.clear();
  std::vector<TimedPose>& poses = link.X_PC;
  // A clock that was set back has started anew.
  if (!poses.empty() && transform.time < poses.back().time - kept_seconds_) poses.clear();
  insert_by_time(poses, TimedPose{transform.time, transform.X_PC});
  // One that is too old is kept, so that there is one before all the others.
  const double oldest = poses.back().time - kept_seconds_;
  const auto first = std::ranges::lower_bound(poses, oldest, {}, &TimedPose::time);
  if (first - poses.begin() > 1) poses.erase(poses.begin(), std::prev(first));
}

std::vector<std::string> TfHistory::ancestors(const std::string& frame) const {
  std::vector<std::string> chain{plain_frame(frame)};
  for (auto link = links_.find(chain.back()); link != links_.end() && chain.size() < kMostFrames;
       link = links_.find(chain.back())) {
    chain.push_back(link->second.parent);
  }
  return chain;
}

std::optional<Pose> TfHistory::in_parent(const std::string& frame, double time,
                                         double most_apart) const {
  const Link& link = links_.at(frame);
  if (!link.is_static && nearest_in_time(link.X_PC, time) > most_apart) return std::nullopt;
  return pose_at(link.X_PC, time);
}

std::optional<TfHistory::Chains> TfHistory::chains_between(const std::string& a,
                                                           const std::string& b) const {
  Chains chains{ancestors(a), ancestors(b)};
  const auto met = std::ranges::find_first_of(chains.of_b, chains.of_a);
  if (met == chains.of_b.end()) return std::nullopt;
  chains.of_a.erase(std::ranges::find(chains.of_a, *met), chains.of_a.end());
  chains.of_b.erase(met, chains.of_b.end());
  return chains;
}

std::optional<Pose> TfHistory::find(const std::string& a, const std::string& b, double time,
                                    double most_apart) const {
  const auto chains = chains_between(a, b);
  if (!chains) return std::nullopt;
  const auto up = [&](const std::vector<std::string>& chain) -> std::optional<Pose> {
    Pose X_MF;
    for (const std::string& frame : chain) {
      const auto X_PF = in_parent(frame, time, most_apart);
      if (!X_PF) return std::nullopt;
      X_MF = *X_PF * X_MF;
    }
    return X_MF;
  };
  const auto X_MA = up(chains->of_a), X_MB = up(chains->of_b);
  if (!X_MA || !X_MB) return std::nullopt;
  return inverse(*X_MA) * *X_MB;
}

double TfHistory::known_until(const std::string& a, const std::string& b) const {
  constexpr double kForEver = std::numeric_limits<double>::infinity();
  const auto chains = chains_between(a, b);
  if (!chains) return -kForEver;
  double until = kForEver;
  for (const auto* chain : {&chains->of_a, &chains->of_b}) {
    for (const std::string& frame : *chain) {
      const Link& link = links_.at(frame);
      if (!link.is_static) until = std::min(until, link.X_PC.back().time);
    }
  }
  return until;
}

bool TfHistory::is_moving(const std::string& a, const std::string& b) const {
  const auto moves = [&](const std::string& frame) {
    const auto& poses = links_.at(frame).X_PC;
    return std::ranges::any_of(
        poses, [&](const TimedPose& pose) { return !(pose.X_WT == poses.front().X_WT); });
  };
  const auto chains = chains_between(a, b);
  return chains &&
         (std::ranges::any_of(chains->of_a, moves) || std::ranges::any_of(chains->of_b, moves));
}

std::vector<std::string> TfHistory::frames() const {
  std::vector<std::string> frames;
  for (const auto& [child, link] : links_) {
    frames.push_back(child);
    if (!links_.contains(link.parent)) frames.push_back(link.parent);
  }
  std::ranges::sort(frames);
  const auto twice = std::ranges::unique(frames);
  frames.erase(twice.begin(), twice.end());
  return frames;
}

}  // namespace palpate
