#include "src/ros/tf_history.h"

#include <algorithm>

#include "src/ros/tf_tree.h"

namespace palpate {
namespace {

constexpr double kMostApart = 1;  // s, from what was told

}  // namespace

void TfHistory::add(const RosStampedTransform& transform, bool is_static) {
  const std::string child = plain_frame(transform.child);
  if (links_.size() >= kMostFrames && !links_.contains(child)) return;
  Link& link = links_[child];
  link.parent = plain_frame(transform.parent);
  link.is_static = is_static;
  if (is_static) link.X_PC.clear();
  link.X_PC.push_back({transform.time, transform.X_PC});
}

void TfHistory::sort() {
  for (auto& [child, link] : links_) {
    std::ranges::stable_sort(link.X_PC, {}, &TimedPose::time);
    const auto twice = std::ranges::unique(link.X_PC, {}, &TimedPose::time);
    link.X_PC.erase(twice.begin(), twice.end());
  }
}

std::vector<std::string> TfHistory::ancestors(const std::string& frame) const {
  std::vector<std::string> chain{plain_frame(frame)};
  for (auto link = links_.find(chain.back()); link != links_.end() && chain.size() < kMostFrames;
       link = links_.find(chain.back())) {
    chain.push_back(link->second.parent);
  }
  return chain;
}

std::optional<Pose> TfHistory::in_parent(const std::string& frame, double time) const {
  const Link& link = links_.at(frame);
  if (!link.is_static &&
      (time < link.X_PC.front().time - kMostApart || time > link.X_PC.back().time + kMostApart)) {
    return std::nullopt;
  }
  return pose_at(link.X_PC, time);
}

std::optional<Pose> TfHistory::find(const std::string& a, const std::string& b, double time) const {
  const std::vector<std::string> of_a = ancestors(a), of_b = ancestors(b);
  const auto met = std::ranges::find_first_of(of_b, of_a);
  if (met == of_b.end()) return std::nullopt;
  const auto up = [&](const std::vector<std::string>& chain) -> std::optional<Pose> {
    Pose X_MF;
    for (const std::string& frame : chain) {
      if (frame == *met) return X_MF;
      const auto X_PF = in_parent(frame, time);
      if (!X_PF) return std::nullopt;
      X_MF = *X_PF * X_MF;
    }
    return std::nullopt;
  };
  const auto X_MA = up(of_a), X_MB = up(of_b);
  if (!X_MA || !X_MB) return std::nullopt;
  return inverse(*X_MA) * *X_MB;
}

bool TfHistory::is_moving(const std::string& a, const std::string& b) const {
  const auto moves = [&](const std::string& frame) {
    const auto link = links_.find(frame);
    if (link == links_.end()) return false;
    const auto& poses = link->second.X_PC;
    return std::ranges::any_of(
        poses, [&](const TimedPose& pose) { return !(pose.X_WT == poses.front().X_WT); });
  };
  std::vector<std::string> chain = ancestors(a);
  std::ranges::move(ancestors(b), std::back_inserter(chain));
  return std::ranges::any_of(chain, moves);
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
