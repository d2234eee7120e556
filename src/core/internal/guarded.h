// The work of a thread: its rank among others, and no exception of it ends the program.
#pragma once

#include <exception>
#include <new>
#include <string>
#include <system_error>
#include <thread>
#include <utility>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// Returns an error that is made before it is needed: then there may be no memory for it.
inline const Error& out_of_memory() {
  static const Error error{
      Errc::unavailable,
      "out of memory: use fewer spheres, a smaller image or a shorter run, or end other programs"};
  return error;
}

/// Runs `work`. An exception goes to `fail` as an Error after the work has been left: locks are
/// open again and its memory is free. `fail` sets its flags before it does what needs memory.
template <class Work, class Fail>
void guarded(const Work& work, const Fail& fail) noexcept {
  try {
    const Error& no_memory = out_of_memory();
    try {
      work();
    } catch (const std::bad_alloc&) {
      fail(no_memory);
    } catch (const std::exception& error) {
      fail(Error{Errc::unavailable, std::string("something unexpected has failed: ") +
                                        error.what() + "; please report it"});
    } catch (...) {
      fail(Error{Errc::unavailable, "something unexpected has failed; please report it"});
    }
  } catch (...) {  // no memory for the error either
  }
}

/// Starts the thread "that reads frames" or whatever it is. Error: the system starts no thread.
template <class Work>
Status start_thread(std::thread& thread, const std::string& purpose, Work&& work) {
  try {
    thread = std::thread(std::forward<Work>(work));
  } catch (const std::system_error& error) {
    return Error{Errc::unavailable, "cannot start the thread " + purpose + ": " + error.what() +
                                        "; end other programs and try again"};
  }
  return Done{};
}

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
