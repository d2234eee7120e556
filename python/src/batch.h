// palpate.Batch, for its files of bindings.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "palpate/contact/contact.h"
#include "python/src/arrays.h"
#ifdef PALPATE_CUDA
#include "src/gpu/internal/runtime.h"
#endif

namespace palpate::python {

/// Class palpate.Batch: results of a batch, in host memory or on a GPU, in W.
struct PyBatch {
  std::size_t num = 0;
  std::vector<double> numbers;        // host: volume, potential, force, torque, stiffness
  std::vector<std::uint32_t> status;  // host
#ifdef PALPATE_CUDA
  std::unique_ptr<gpu::Memory> memory;
#endif
  std::vector<WritableArray> given;  // by the caller
  BatchAnswers answers;
  nb::dict more;  ///< results by name, of scenes

  static constexpr std::size_t kPerPose = 1 + 1 + 3 + 3, kStiffness = 36;

  bool has_stiffness() const { return answers.stiffness != nullptr; }
  void lay_out(double* at, std::uint32_t* bits, bool with_stiffness, int where) {
    answers = {at, at + num, at + 2 * num, at + 5 * num, nullptr, bits, where};
    if (with_stiffness) answers.stiffness = at + kPerPose * num;
  }
};

/// Adds properties for the results of scenes, which are there only if they were requested; in
/// bind_scene_batch.cpp.
void add_scene_results(nb::class_<PyBatch>& batch);

}  // namespace palpate::python
