#include "src/ros/internal/tf_history.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "src/ros/internal/tf_tree.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kMaxParents = 100;  // of one frame

}  // namespace

void TfHistory::add(const RosStampedTransform& transform, bool is_static) {
  const std::string child = plain_frame(transform.child);
  if (links_.size() >= kMaxFrames && !links_.contains(child)) return;
  Link& link = links_[child];
  const std::string parent = plain_frame(transform.parent);
  auto known = std::ranges::find(link.parents, parent);
  if (known == link.parents.end()) {
    if (link.parents.size() == kMaxParents) return;
    known = link.parents.insert(known, parent);
  }
  if (is_static || link.is_static) link.samples.clear();
  link.is_static = is_static;
  const auto number = static_cast<std::size_t>(known - link.parents.begin());
  insert_by_time(link.samples, transform.time, Sample{number, transform.X_PC}, kept_seconds_);
}

ByTime<TfHistory::Sample>::const_iterator TfHistory::Link::before(double time) const {
  const auto after = samples.upper_bound(time);
  return after == samples.begin() ? after : std::prev(after);
}

std::optional<Pose> TfHistory::Link::in_parent(double time, double max_gap) const {
  if (is_static) return samples.begin()->second.X_PC;
  const bool is_between = time >= samples.begin()->first && time <= samples.rbegin()->first;
  if (!is_between || nearest_in_time(samples, time) > max_gap) return std::nullopt;
  const auto at = before(time);
  const auto& [time_a, a] = *at;
  if (time_a == time) return a.X_PC;
  const auto& [time_b, b] = *std::next(at);
  if (a.parent != b.parent) return a.X_PC;
  return interpolate(a.X_PC, b.X_PC, (time - time_a) / (time_b - time_a));
}

std::vector<std::string> TfHistory::ancestors(const std::string& frame, double time) const {
  std::vector<std::string> chain{plain_frame(frame)};
  for (auto link = links_.find(chain.back()); link != links_.end() && chain.size() < kMaxDepth;
       link = links_.find(chain.back())) {
    chain.push_back(link->second.parent_at(time));
  }
  return chain;
}

std::optional<TfHistory::Chains> TfHistory::chains_between(const std::string& a,
                                                           const std::string& b,
                                                           double time) const {
  Chains chains{ancestors(a, time), ancestors(b, time)};
  const auto met = std::ranges::find_first_of(chains.of_b, chains.of_a);
  if (met == chains.of_b.end()) return std::nullopt;
  chains.of_a.erase(std::ranges::find(chains.of_a, *met), chains.of_a.end());
  chains.of_b.erase(met, chains.of_b.end());
  return chains;
}

std::optional<Pose> TfHistory::find(const std::string& a, const std::string& b, double time,
                                    double max_gap) const {
  const auto chains = chains_between(a, b, time);
  if (!chains) return std::nullopt;
  const auto up = [&](const std::vector<std::string>& chain) -> std::optional<Pose> {
    Pose X_MF;
    for (const std::string& frame : chain) {
      const auto X_PF = links_.at(frame).in_parent(time, max_gap);
      if (!X_PF) return std::nullopt;
      X_MF = *X_PF * X_MF;
    }
    return X_MF;
  };
  const auto X_MA = up(chains->of_a), X_MB = up(chains->of_b);
  if (!X_MA || !X_MB) return std::nullopt;
  return inverse(*X_MA) * *X_MB;
}

double TfHistory::known_until(const std::string& a, const std::string& b, double time) const {
  constexpr double kForEver = std::numeric_limits<double>::infinity();
  const auto chains = chains_between(a, b, time);
  if (!chains) return -kForEver;
  double until = kForEver;
  for (const auto* chain : {&chains->of_a, &chains->of_b}) {
    for (const std::string& frame : *chain) {
      const Link& link = links_.at(frame);
      if (!link.is_static) until = std::min(until, link.samples.rbegin()->first);
    }
  }
  return until;
}

bool TfHistory::is_moving(const std::string& a, const std::string& b) const {
  const auto moves = [&](const std::string& frame) {
    const Link& link = links_.at(frame);
    const Sample& first = link.samples.begin()->second;
    return std::ranges::any_of(link.samples, [&](const auto& each) {
      const Sample& sample = each.second;
      return sample.parent != first.parent || !(sample.X_PC == first.X_PC);
    });
  };
  const auto chains = chains_between(a, b, std::numeric_limits<double>::infinity());
  return chains &&
         (std::ranges::any_of(chains->of_a, moves) || std::ranges::any_of(chains->of_b, moves));
}

std::vector<std::string> TfHistory::frames() const {
  std::vector<std::string> frames;
  for (const auto& [child, link] : links_) {
    frames.push_back(child);
    for (const std::string& parent : link.parents) {
      if (!links_.contains(parent)) frames.push_back(parent);
    }
  }
  std::ranges::sort(frames);
  const auto twice = std::ranges::unique(frames);
  frames.erase(twice.begin(), twice.end());
  return frames;
}

}}  // namespace palpate::v0
