#include "src/ros/tf_tree.h"

#include <algorithm>
#include <vector>

namespace palpate::inline v0 {

void TfTree::add(const RosStampedTransform& transform) {
  const std::string child = plain_frame(transform.child);
  const std::lock_guard lock(mutex_);
  if (links_.size() >= kMaxFrames && !links_.contains(child)) return;
  links_[child] = {plain_frame(transform.parent), transform.X_PC, transform.time};
}

const TfTree::Link* TfTree::parent_of(const std::string& frame) const {
  const auto link = links_.find(frame);
  return link == links_.end() ? nullptr : &link->second;
}

std::optional<TfTree::Found> TfTree::find(const std::string& a, const std::string& b) const {
  const std::lock_guard lock(mutex_);
  // From A up to its root, and from B up to the first of these.
  struct Step {
    std::string frame;
    Pose X_FA;
    double time;
  };
  const auto older = [](double one, double other) {
    return one == 0 ? other : other == 0 ? one : std::min(one, other);
  };
  std::vector<Step> steps{{plain_frame(a), {}, 0}};
  while (const Link* link = parent_of(steps.back().frame)) {
    const Step& last = steps.back();
    if (steps.size() > kMaxFrames) return std::nullopt;
    steps.push_back({link->parent, link->X_PC * last.X_FA, older(last.time, link->time)});
  }
  std::string frame = plain_frame(b);
  Pose X_FB;
  double time = 0;
  for (std::size_t i = 0; i < kMaxFrames; ++i) {
    const auto met = std::ranges::find(steps, frame, &Step::frame);
    if (met != steps.end()) return Found{inverse(met->X_FA) * X_FB, older(time, met->time)};
    const Link* const link = parent_of(frame);
    if (link == nullptr) return std::nullopt;
    X_FB = link->X_PC * X_FB;
    time = older(time, link->time);
    frame = link->parent;
  }
  return std::nullopt;
}

}  // namespace palpate::inline v0
