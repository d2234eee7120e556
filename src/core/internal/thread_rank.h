// The order in which threads of the program get processors.
#pragma once

namespace palpate { inline namespace v0 {

/// Priority of a thread when processors are short; the haptic and the contact thread come first.
enum class ThreadRank {
  surface,   ///< makes surfaces; before other programs where that is allowed
  frames,    ///< reads or renders frames ahead of time
  recorder,  ///< compresses and writes
  viewer,    ///< serves pages
};
/// Sets the rank of the calling thread, once. Returns its nice value then. No allocation.
int take_rank(ThreadRank rank) noexcept;

}}  // namespace palpate::v0
