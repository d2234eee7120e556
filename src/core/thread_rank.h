// The order in which threads of the program get processors.
#pragma once

namespace palpate::inline v0 {

/// Who waits when processors are short, beside the haptic and the contact thread, which come first.
enum class ThreadRank {
  surface,   ///< makes surfaces; before other programs where that is allowed
  frames,    ///< reads or renders frames ahead of time
  recorder,  ///< compresses and writes
  viewer,    ///< serves pages
};
/// The calling thread's, once: a nice value. Returns the one that it has then. No allocation.
int take_rank(ThreadRank rank) noexcept;

}  // namespace palpate::inline v0
