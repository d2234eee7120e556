// Makers of the queries of a scene in one place. GPU makers are in a build with CUDA, and in tests
// by the emulator.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <utility>

#include "palpate/contact/scene.h"
#include "src/contact/backends.h"
#include "src/contact/batch/field_batch_cuda.h"
#include "src/contact/batch/scene_batch.h"
#include "src/contact/clearance/clearance_batch.h"

namespace palpate { inline namespace v0 {

struct SceneMakers {
  using Index = std::shared_ptr<const ToolIndex>;

  Result<std::unique_ptr<ContactQuery>> (*contact)(Index, const ContactMethod&, int gpu);
  /// The pool is that of a CPU.
  Result<std::unique_ptr<BatchQuery>> (*batch)(Index, const FieldMethod&, ThreadPool&, int gpu);
  Result<std::unique_ptr<BodyPairQuery>> (*pair)(Index, Index, int gpu);
  Result<std::unique_ptr<ClearanceBatch>> (*clearance)(std::span<const Index>, ThreadPool&,
                                                       int gpu);
  /// Null: poses are measured one by one.
  Result<std::unique_ptr<SceneBatch>> (*scenes)(std::span<const Index>, SphereVolumes, int gpu);
};

/// Returns the makers of a GPU. `kAtOnce`: poses in a launch.
template <std::size_t kAtOnce = std::size_t{1} << 15>
SceneMakers cuda_makers() {
  return {[](SceneMakers::Index index, const ContactMethod& method, int gpu) {
            return make_contact_query_cuda(std::move(index), method, gpu);
          },
          [](SceneMakers::Index index, const FieldMethod& method, ThreadPool&, int gpu) {
            return make_batch_query_cuda(std::move(index), method, gpu);
          },
          make_solid_contact_cuda,
          [](std::span<const SceneMakers::Index> tools, ThreadPool&, int gpu) {
            return make_clearance_batch_cuda(tools, gpu, kAtOnce);
          },
          [](std::span<const SceneMakers::Index> tools, SphereVolumes volumes, int gpu) {
            return make_scene_batch_cuda(tools, volumes, gpu, kAtOnce);
          }};
}

struct SceneContactMaker {
  static Result<SceneContact> make(std::span<const Tool* const> tools, const ContactMethod& method,
                                   const Place& place, int num_threads, const SceneMakers& makers);
  /// See palpate::measure_tree.
  static Result<std::optional<RefusedPosition>> measure_tree(const SceneContact& contact,
                                                             const Scene& scene,
                                                             const JointPoses& poses,
                                                             const TreeAnswers& answers);
};

}}  // namespace palpate::v0
