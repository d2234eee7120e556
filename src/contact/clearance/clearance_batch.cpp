#include "src/contact/clearance/clearance_batch.h"

#include <algorithm>
#include <cstdint>

#include "src/contact/bodies/solid_contact.h"
#include "src/contact/index/tool_parts.h"

namespace palpate { inline namespace v0 {

SearchedBody searched_body(const Body& body) {
  const SolidField& field = parts_of(*body.placed().shape).solid_field();
  const Pose& X_WB = body.placed().X_WB;
  SearchedBody made{view_of(field), field.layout().origin, {}, {}};
  made.X_WB = {X_WB.translation, normalized(X_WB.rotation)};
  made.X_BW = inverse(made.X_WB);
  return made;
}

namespace {

class ClearanceBatchCpu final : public ClearanceBatch {
 public:
  ClearanceBatchCpu(std::span<const std::shared_ptr<const ToolIndex>> tools, ThreadPool& pool,
                    Isa isa)
      : pool_(pool), each_(static_cast<std::size_t>(pool.num_threads())) {
    for (const auto& tool : tools) queries_.emplace_back(*tool, isa);
  }

  Status take(std::span<const SurfaceView> surfaces, std::span<const Body> bodies) override {
    bodies_.clear();
    for (const Body& body : bodies) bodies_.push_back(searched_body(body));
    return scene_.update(surfaces, bodies_, pool_);
  }

  Status measure(const ScenePoses& poses, const ClearanceWants& wants, const Put& put) override {
    const auto [limit, smoothing, only_least] = wants;
    if (only_least && !poses.group_of_pose.empty() && !(smoothing > 0)) {
      measure_groups(poses, limit, put);
      return Done{};
    }
    for_poses(pool_, poses.X_WT.size(), [&](std::size_t thread, std::size_t i) {
      const Pose& X_WT = poses.X_WT[i];
      if (!is_finite(X_WT)) return;
      const ClearanceQuery& query = queries_[tool_of(poses, i)];
      put(i, smoothing > 0 ? query.measure_softly(scene_, X_WT, limit, smoothing, each_[thread])
                           : query.measure(scene_, X_WT, limit, limit));
    });
    return Done{};
  }

  Status any(const ScenePoses& poses, double margin, std::uint8_t* hits) override {
    std::fill_n(hits, num_groups_of(poses), std::uint8_t{0});
    for_poses(pool_, poses.X_WT.size(), [&](std::size_t, std::size_t i) {
      std::uint8_t& hit = hits[group_of(poses, i)];
      if (__atomic_load_n(&hit, __ATOMIC_RELAXED) != 0) return;  // of its group
      const Pose& X_WT = poses.X_WT[i];
      if (is_finite(X_WT) && !queries_[tool_of(poses, i)].is_within(scene_, X_WT, margin)) return;
      __atomic_store_n(&hit, std::uint8_t{1}, __ATOMIC_RELAXED);
    });
    return Done{};
  }

 private:
  /// Measures from the last pose on, as the hand of an arm is nearer than its base. Poses only have
  /// to beat those of their group that the same thread has measured just before.
  void measure_groups(const ScenePoses& poses, double limit, const Put& put) {
    struct Least {
      std::size_t group = SIZE_MAX;
      double value = 0;  // m
    };
    std::vector<Least> of_thread(each_.size());
    const std::size_t num = poses.X_WT.size();
    for_poses(pool_, num, [&](std::size_t thread, std::size_t k) {
      const std::size_t i = num - 1 - k, group = group_of(poses, i);
      Least& least = of_thread[thread];
      if (least.group != group) least = {group, limit};
      if (!is_finite(poses.X_WT[i])) return;
      const Clearance found =
          queries_[tool_of(poses, i)].measure(scene_, poses.X_WT[i], limit, least.value);
      least.value = std::min(least.value, found.value);
      put(i, found);
    });
  }

  ThreadPool& pool_;
  std::vector<ClearanceQuery> queries_;
  std::vector<SearchedBody> bodies_;
  ClearanceScene scene_;
  std::vector<std::vector<ClearanceHit>> each_;  // of each thread
};

}  // namespace

Result<std::unique_ptr<ClearanceBatch>> make_clearance_batch(
    std::span<const std::shared_ptr<const ToolIndex>> tools, const ExecutionOptions& execution) {
  return std::unique_ptr<ClearanceBatch>(
      std::make_unique<ClearanceBatchCpu>(tools, *execution.pool, execution.isa));
}

}}  // namespace palpate::v0
