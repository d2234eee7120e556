#include "src/ros/internal/tf_tree.h"

#include <algorithm>
#include <limits>
#include <vector>

namespace palpate { inline namespace v0 {

void TfTree::add(const RosStampedTransform& transform, bool is_static, double time) {
  const std::string child = plain_frame(transform.child);
  const std::lock_guard lock(mutex_);
  if (links_.size() >= kMaxFrames && !links_.contains(child)) return;
  links_[child] = {plain_frame(transform.parent), transform.X_PC, is_static, time};
}

void TfTree::clear() {
  const std::lock_guard lock(mutex_);
  links_.clear();
}

const TfTree::Link* TfTree::parent_of(const std::string& frame) const {
  const auto link = links_.find(frame);
  return link == links_.end() ? nullptr : &link->second;
}

std::optional<TfTree::Found> TfTree::find(const std::string& a, const std::string& b) const {
  const std::lock_guard lock(mutex_);
  // From A up to its root, and from B up to the first of these.
  constexpr double kForEver = std::numeric_limits<double>::infinity();
  struct Times {
    double oldest = kForEver, newest = -kForEver;
    Times with(const Times& other) const {
      return {std::min(oldest, other.oldest), std::max(newest, other.newest)};
    }
    Times with(const Link& link) const {
      return link.is_static ? *this : with(Times{link.time, link.time});
    }
  };
  struct Step {
    std::string frame;
    Pose X_FA;
    Times times;
  };
  std::vector<Step> steps{{plain_frame(a), {}, {}}};
  while (const Link* link = parent_of(steps.back().frame)) {
    const Step& last = steps.back();
    if (steps.size() > kMaxDepth) return std::nullopt;
    steps.push_back({link->parent, link->X_PC * last.X_FA, last.times.with(*link)});
  }
  std::string frame = plain_frame(b);
  Pose X_FB;
  Times times;
  for (std::size_t i = 0; i < kMaxDepth; ++i) {
    const auto met = std::ranges::find(steps, frame, &Step::frame);
    if (met != steps.end()) {
      const auto [oldest, newest] = times.with(met->times);
      return Found{inverse(met->X_FA) * X_FB, oldest, newest};
    }
    const Link* const link = parent_of(frame);
    if (link == nullptr) return std::nullopt;
    X_FB = link->X_PC * X_FB;
    times = times.with(*link);
    frame = link->parent;
  }
  return std::nullopt;
}

}}  // namespace palpate::v0
