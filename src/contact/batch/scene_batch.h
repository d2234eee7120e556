// Contact of many poses of several tools with all cameras and bodies of a scene on a GPU, in one
// launch: a block measures a pose.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/contact/body_contact.h"
#include "palpate/contact/contact.h"

namespace palpate { inline namespace v0 {

/// Poses of a batch; indices are in host memory.
struct SceneBatchPoses {
  std::span<const Pose> X_WT = {};
  int gpu = kHostMemory;                            ///< memory of X_WT
  std::span<const std::int32_t> tool_of_pose = {};  ///< empty: the first one
  /// Each pose is measured against one body, as BodyBatchQuery says; else against all.
  bool has_one_body_each = false;
  std::span<const std::int32_t> body_of_pose = {};
};

/// One thread at a time.
class SceneBatch {
 public:
  virtual ~SceneBatch() = default;

  /// Takes the scene of the next measurements: cameras with their fields of the whole image, of
  /// which one shows something, or none; what is as in the last scene is kept. Waits if bodies are
  /// not, and for surfaces in host memory. Errors: a GPU without memory, or lost; what it waits for
  /// in a captured graph.
  virtual Status take(std::span<const SurfaceView> surfaces, std::span<const PlacedBody> bodies,
                      std::optional<CallerStream> stream) = 0;
  /// Measures the sum of the contact with the hull of all cameras and with the bodies, as
  /// ContactQuery and BodyPairQuery do it for one pose, to 1e-5 of their results. The result of a
  /// pose has the same bits whatever else is in the batch. `unseen`: P, share of the tool's volume,
  /// in the memory of the answers, or null. Deviations are those of MeasureNoise to 1e-4, but at
  /// the border of two grids. Waits, unless there is a stream and all arrays are on the GPU.
  /// Errors: as above.
  virtual Status measure(const SceneBatchPoses& poses, const BatchAnswers& answers, double* unseen,
                         std::optional<CallerStream> stream) = 0;
};

/// Checks the sizes of a batch against bodies. Error: they do not match.
Status check_body_batch(std::size_t num_poses, std::size_t num_numbers, std::size_t num_bodies);

/// True if a batch can take a scene's surfaces; others are measured pose by pose.
bool is_for_batch(std::span<const SurfaceView> surfaces);

/// Makes one, with `at_once` poses in a launch. Errors: no such GPU, or not enough memory on it.
Result<std::unique_ptr<SceneBatch>> make_scene_batch_cuda(
    std::span<const std::shared_ptr<const ToolIndex>> tools, SphereVolumes volumes, int gpu,
    std::size_t at_once = std::size_t{1} << 15);

/// See make_body_batch_query, on a GPU.
Result<std::unique_ptr<BodyBatchQuery>> make_body_batch_query_cuda(
    const std::shared_ptr<const ToolIndex>& tool, const std::vector<PlacedBody>& bodies, int gpu);

}}  // namespace palpate::v0
