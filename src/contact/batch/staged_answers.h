// Poses and answers of batches that lie in host memory, on a GPU meanwhile.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <utility>

#include "palpate/contact/contact.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {

/// Calls f(array of the caller, staged array, values a pose, array of the job) for all answers that
/// a GPU computes.
template <class F>
void for_answers(const BatchAnswers& answers, const BatchAnswers& staged, BatchAnswers& out,
                 const F& f) {
  f(answers.volume, staged.volume, std::size_t{1}, out.volume);
  f(answers.potential, staged.potential, std::size_t{1}, out.potential);
  f(answers.force, staged.force, std::size_t{3}, out.force);
  f(answers.torque, staged.torque, std::size_t{3}, out.torque);
  f(answers.stiffness, staged.stiffness, std::size_t{36}, out.stiffness);
  f(answers.status, staged.status, std::size_t{1}, out.status);
  f(answers.volume_std, staged.volume_std, std::size_t{1}, out.volume_std);
  f(answers.force_std, staged.force_std, std::size_t{3}, out.force_std);
  f(answers.torque_std, staged.torque_std, std::size_t{3}, out.torque_std);
}

/// Copies staged answers of poses to the arrays of the caller.
inline void copy_answers(const BatchAnswers& answers, const BatchAnswers& staged, std::size_t first,
                         std::size_t num, gpu::Stream& stream) {
  BatchAnswers none;
  for_answers(answers, staged, none, [&](auto* to, auto* from, std::size_t each, auto*&) {
    if (to != nullptr) stream.copy(to + each * first, from, each * num * sizeof *to);
  });
}

/// Takes arrays for the answers of so many poses.
inline BatchAnswers take_answers(gpu::Memory& memory, std::size_t num) {
  return {memory.take<double>(num),
          memory.take<double>(num),
          memory.take<double>(3 * num),
          memory.take<double>(3 * num),
          memory.take<double>(36 * num),
          memory.take<std::uint32_t>(num),
          memory.gpu(),
          memory.take<double>(num),
          memory.take<double>(3 * num),
          memory.take<double>(3 * num)};
}

/// Memory for the poses of a scene and their answers.
struct StagedPoses {
  explicit StagedPoses(int gpu) : memory(gpu) {}

  Status grow(std::size_t desired) {
    if (desired <= num) return Done{};
    num = 0;
    gpu::Memory made(memory.gpu());
    X_WT = made.take<Pose>(desired);
    tool = made.take<std::int32_t>(desired);
    body = made.take<std::int32_t>(desired);
    unseen = made.take<double>(desired);
    answers = take_answers(made, desired);
    memory = std::move(made);
    if (memory.status()) num = desired;
    return memory.status();
  }
  /// Copies `size` values from number `first` on, and returns where they are; null if there are
  /// none.
  template <class T>
  const T* given(gpu::Stream& stream, T* to, std::span<const T> from, std::size_t first,
                 std::size_t size) const {
    if (from.empty()) return nullptr;
    stream.copy(to, from.data() + first, size * sizeof(T));
    return to;
  }

  gpu::Memory memory;
  std::size_t num = 0;  ///< there is room for
  Pose* X_WT = nullptr;
  std::int32_t *tool = nullptr, *body = nullptr;
  double* unseen = nullptr;
  BatchAnswers answers;
};

}}  // namespace palpate::v0
