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
      : pool_(pool),
        kernels_(clearance_kernels(isa)),
        workers_(static_cast<std::size_t>(pool.num_threads())) {
    for (const auto& tool : tools) queries_.emplace_back(*tool, isa);
  }

  Status take(std::span<const SurfaceView> surfaces, std::span<const Body> bodies,
              std::optional<CallerStream>) override {
    bodies_.clear();
    for (const Body& body : bodies) bodies_.push_back(searched_body(body));
    return scene_.update(surfaces, bodies_, pool_);
  }

  Status measure(const ScenePoses& poses, const SceneAnswers& answers,
                 std::optional<CallerStream>) override {
    const double limit = answers.clearance_limit, smoothing = answers.clearance_smoothing;
    const bool has_groups =
        answers.only_least_of_groups && !poses.group_of_pose.empty() && !(smoothing > 0);
    for_screens(poses, has_groups, [&](Worker& worker, std::size_t first, std::size_t end) {
      place(poses, first, end, limit, false, worker.screen);
      if (has_groups) return measure_groups(poses, first, worker, answers);
      for (std::size_t i = first; i < end; ++i) {
        if (!is_finite(poses.X_WT[i])) {
          put_clearance(i, {}, answers);
          continue;
        }
        const ClearanceQuery& query = queries_[tool_of(poses, i)];
        const auto number = static_cast<int>(i - first);
        put_clearance(i,
                      smoothing > 0 ? query.measure_softly(scene_, worker.screen, number, limit,
                                                           smoothing, worker.each)
                                    : query.measure(scene_, worker.screen, number, limit, limit),
                      answers);
      }
    });
    return Done{};
  }

  Status any(const ScenePoses& poses, double margin, std::uint8_t* hits,
             std::optional<CallerStream>) override {
    std::fill_n(hits, num_groups_of(poses), std::uint8_t{0});
    for_screens(poses, false, [&](Worker& worker, std::size_t first, std::size_t end) {
      place(poses, first, end, margin, true, worker.screen);
      const auto is_hit = [&](int number) {
        const std::size_t i = first + static_cast<std::size_t>(number);
        return !is_finite(poses.X_WT[i]) ||
               queries_[tool_of(poses, i)].is_within(scene_, worker.screen, number, margin);
      };
      for_groups(poses, first, worker, [&](std::size_t group, std::span<const int> numbers) {
        for (const int number : numbers) {
          if (__atomic_load_n(&hits[group], __ATOMIC_RELAXED) != 0) return;
          if (!is_hit(number)) continue;
          return __atomic_store_n(&hits[group], std::uint8_t{1}, __ATOMIC_RELAXED);
        }
      });
    });
    return Done{};
  }

 private:
  struct Worker {
    PoseScreen screen;
    int order[PoseScreen::kMaxPoses];
    std::vector<ClearanceHit> each;
  };

  /// Calls work(worker, first, end) for all poses, as many as a screen takes. If groups are kept,
  /// poses of one group that follow each other are begun with the first of them and stay together,
  /// so that what is told of them depends on them alone.
  template <class Work>
  void for_screens(const ScenePoses& poses, bool keeps_groups, const Work& work) {
    const std::size_t num = poses.X_WT.size();
    const auto is_start = [&](std::size_t i) {
      return !keeps_groups || i == 0 || i == num || group_of(poses, i) != group_of(poses, i - 1);
    };
    for_some_poses(pool_, num, [&](std::size_t thread, std::size_t first, std::size_t end) {
      while (first < end && !is_start(first)) ++first;  // those before are another's
      if (first == end) return;
      while (!is_start(end)) ++end;
      while (first < end) {
        const std::size_t most = std::min(first + PoseScreen::kMaxPoses, end);
        std::size_t next = most;
        while (next > first && !is_start(next)) --next;
        if (next == first) next = most;  // a group of more poses than a screen takes
        work(workers_[thread], first, next);
        first = next;
      }
    });
  }

  void place(const ScenePoses& poses, std::size_t first, std::size_t end, double limit,
             bool is_margin, PoseScreen& screen) const {
    screen.X_WT = poses.X_WT.data() + first;
    screen.num = static_cast<int>(end - first);
    screen.limit = static_cast<float>(limit);
    screen.is_margin = is_margin;
    for (std::size_t i = first; i < end; ++i) {
      screen.tools[i - first] = &queries_[tool_of(poses, i)].tool();
    }
    scene_.place(screen, kernels_);
  }

  /// Calls visit(group, numbers) for poses of a screen that follow each other in one group and may
  /// be near something, those that seem to be the nearest first.
  template <class Visit>
  void for_groups(const ScenePoses& poses, std::size_t first, Worker& worker,
                  const Visit& visit) const {
    const PoseScreen& screen = worker.screen;
    const bool has_bodies = !scene_.bodies().empty();
    for (int begin = 0, end = 0; begin < screen.num; begin = end) {
      const std::size_t group = group_of(poses, first + static_cast<std::size_t>(begin));
      int num = 0;
      for (; end < screen.num; ++end) {
        if (group_of(poses, first + static_cast<std::size_t>(end)) != group) break;
        if (!has_bodies && screen.is_far(end)) continue;
        int at = num++;
        for (; at > 0 && screen.least[worker.order[at - 1]] > screen.least[end]; --at) {
          worker.order[at] = worker.order[at - 1];
        }
        worker.order[at] = end;
      }
      if (num > 0) visit(group, std::span<const int>(worker.order, static_cast<std::size_t>(num)));
    }
  }

  /// Poses only have to beat those of their group that have been measured just before.
  void measure_groups(const ScenePoses& poses, std::size_t first, Worker& worker,
                      const SceneAnswers& answers) const {
    const PoseScreen& screen = worker.screen;
    const double limit = answers.clearance_limit;
    for (int number = 0; number < screen.num; ++number) {
      const std::size_t i = first + static_cast<std::size_t>(number);
      put_clearance(i, is_finite(poses.X_WT[i]) ? Clearance{limit} : Clearance{}, answers);
    }
    for_groups(poses, first, worker, [&](std::size_t, std::span<const int> numbers) {
      double least = limit;
      for (const int number : numbers) {
        const std::size_t i = first + static_cast<std::size_t>(number);
        if (!is_finite(poses.X_WT[i])) continue;
        const Clearance found =
            queries_[tool_of(poses, i)].measure(scene_, screen, number, limit, least);
        if (found.value < limit) put_clearance(i, found, answers);
        least = std::min(least, found.value);
        if (least <= -limit) return;
      }
    });
  }

  ThreadPool& pool_;
  ClearanceKernels kernels_;
  std::vector<ClearanceQuery> queries_;
  std::vector<SearchedBody> bodies_;
  ClearanceScene scene_;
  std::vector<Worker> workers_;
};

}  // namespace

Result<std::unique_ptr<ClearanceBatch>> make_clearance_batch(
    std::span<const std::shared_ptr<const ToolIndex>> tools, ThreadPool& pool) {
  return std::unique_ptr<ClearanceBatch>(
      std::make_unique<ClearanceBatchCpu>(tools, pool, best_isa()));
}

}}  // namespace palpate::v0
