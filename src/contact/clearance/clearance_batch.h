// Clearance of many poses of several tools in one scene, on a CPU or a GPU.
#pragma once

#include <algorithm>
#include <atomic>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/contact/scene.h"
#include "src/contact/clearance/clearance.h"
#include "src/contact/internal/joint_tree.h"

namespace palpate { inline namespace v0 {

/// A body with its field in host memory, which the body keeps.
SearchedBody searched_body(const Body& body);

/// Writes the clearance of a pose.
PALPATE_HOSTDEV inline void put_clearance(std::size_t pose, const Clearance& at,
                                          const SceneAnswers& answers) {
  if (answers.clearance != nullptr) answers.clearance[pose] = at.value;
  if (answers.nearest != nullptr) answers.nearest[pose] = at.sphere;
  if (answers.decided != nullptr) answers.decided[pose] = at.decider;
  if (answers.clearance_gradient == nullptr) return;
  for (std::size_t k = 0; k < 6; ++k) answers.clearance_gradient[6 * pose + k] = at.gradient[k];
}

/// One thread at a time.
class ClearanceBatch {
 public:
  virtual ~ClearanceBatch() = default;

  // Streams are those of SceneContact::measure, and no matter to a CPU.

  /// Takes the scene of the next questions; what is as in the last one is kept. Waits if anything
  /// is not. Errors: see check_searched; a new scene in a captured graph.
  virtual Status take(std::span<const SurfaceView> surfaces, std::span<const Body> bodies,
                      std::optional<CallerStream> stream) = 0;
  /// Answers as SceneContact::measure, the clearance alone. Errors: a GPU without memory, or lost;
  /// arrays in host memory in a captured graph.
  virtual Status measure(const ScenePoses& poses, const SceneAnswers& answers,
                         std::optional<CallerStream> stream) = 0;
  /// See SceneContact::any.
  virtual Status any(const ScenePoses& poses, double margin, std::uint8_t* hits,
                     std::optional<CallerStream> stream) = 0;
  /// See measure_tree.
  virtual Result<std::optional<RefusedPosition>> measure_tree(const JointPoses&,
                                                              const TreeAnswers&) {
    return Error{Errc::unavailable,
                 "joints are turned into poses of links where these are measured on a GPU alone; "
                 "create the contact with Place::cuda(), or give it poses"};
  }
};

/// Makes one over the threads of a pool.
Result<std::unique_ptr<ClearanceBatch>> make_clearance_batch(
    std::span<const std::shared_ptr<const ToolIndex>> tools, ThreadPool& pool);
/// The same on a GPU, `at_once` poses in a launch. Errors: no such GPU; too little memory there.
Result<std::unique_ptr<ClearanceBatch>> make_clearance_batch_cuda(
    std::span<const std::shared_ptr<const ToolIndex>> tools, int gpu, std::size_t at_once);

/// Number of the tool of a pose.
inline std::size_t tool_of(const ScenePoses& poses, std::size_t pose) {
  return poses.tool_of_pose.empty() ? 0 : static_cast<std::size_t>(poses.tool_of_pose[pose]);
}
/// Number of the answer of a pose: of its group, if there are groups.
inline std::size_t group_of(const ScenePoses& poses, std::size_t pose) {
  return poses.group_of_pose.empty() ? pose : static_cast<std::size_t>(poses.group_of_pose[pose]);
}
/// Answers of `any`: groups, or poses.
inline std::size_t num_groups_of(const ScenePoses& poses) {
  return poses.group_of_pose.empty() ? poses.X_WT.size()
                                     : static_cast<std::size_t>(poses.num_groups);
}

/// Calls work(thread, first, end) for all poses, some at a time on each thread of a pool.
template <class Work>
void for_some_poses(ThreadPool& pool, std::size_t num, const Work& work) {
  constexpr std::size_t kPosesAtATime = PoseScreen::kMaxPoses;
  std::atomic<std::size_t> next = 0;
  pool.parallel_for(pool.num_threads(), [&](int thread) {
    for (std::size_t first = next.fetch_add(kPosesAtATime); first < num;
         first = next.fetch_add(kPosesAtATime)) {
      work(static_cast<std::size_t>(thread), first, std::min(first + kPosesAtATime, num));
    }
  });
}

/// Calls work(thread, pose) for all poses.
template <class Work>
void for_poses(ThreadPool& pool, std::size_t num, const Work& work) {
  for_some_poses(pool, num, [&](std::size_t thread, std::size_t first, std::size_t end) {
    for (std::size_t i = first; i < end; ++i) work(thread, i);
  });
}

}}  // namespace palpate::v0
