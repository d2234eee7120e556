// palpate.Batch, for its files of bindings.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/contact/scene.h"
#include "python/src/arrays.h"
#ifdef PALPATE_CUDA
#include "src/gpu/internal/runtime.h"
#endif

namespace palpate::python {

/// Class palpate.Batch: results of a batch, in host memory or on a GPU, in W.
struct PyBatch {
  std::size_t num = 0;
  std::vector<double> numbers;        // host: volume, potential, force, torque, stiffness, std
  std::vector<std::uint32_t> status;  // host
#ifdef PALPATE_CUDA
  std::unique_ptr<gpu::Memory> memory;
#endif
  std::vector<WritableArray> given;  // by the caller
  BatchAnswers answers;
  nb::dict more;       ///< results by name, of scenes
  SceneAnswers scene;  ///< arrays given by the caller for these

  static constexpr std::size_t kPerPose = 1 + 1 + 3 + 3, kStiffness = 36, kStd = 1 + 3 + 3;

  bool has_stiffness() const { return answers.stiffness != nullptr; }
  bool has_std() const { return answers.want_noise(); }
  void lay_out(double* at, std::uint32_t* bits, bool with_stiffness, bool with_std, int where) {
    answers = {.volume = at,
               .potential = at + num,
               .force = at + 2 * num,
               .torque = at + 5 * num,
               .status = bits,
               .gpu = where};
    at += kPerPose * num;
    if (with_stiffness) answers.stiffness = std::exchange(at, at + kStiffness * num);
    if (!with_std) return;
    answers.volume_std = at;
    answers.force_std = at + num;
    answers.torque_std = at + 4 * num;
  }
};

/// Makes one for `num` poses, of zeros. palpate.Error: no memory left.
std::unique_ptr<PyBatch> make_batch(std::size_t num, bool with_stiffness, bool with_std, int gpu);

/// Adds properties for the results of scenes, which are there only if they were requested; in
/// bind_scene_batch.cpp.
void add_scene_results(nb::class_<PyBatch>& batch);

}  // namespace palpate::python
