// Interruptible long work outside of Python, such as opening cameras and devices.
#pragma once

#include <functional>
#include <memory>
#include <type_traits>
#include <utility>

#include "palpate/core/core.h"
#include "src/core/internal/guarded.h"

namespace palpate::python {

/// Runs `work` in a thread of its own and waits for it without the GIL. Ctrl-C is raised at once as
/// KeyboardInterrupt; the work then continues in its thread.
void do_interruptibly(std::function<void()> work);

/// The same for work with a Result. It must own all that it needs. After Ctrl-C its result is
/// destroyed in its thread.
template <class Work>
auto interruptible(Work work) {
  const auto result = std::make_shared<std::invoke_result_t<Work>>(Error{});
  do_interruptibly([result, work = std::move(work)] {
    guarded([&] { *result = work(); }, [&](const Error& error) { *result = error; });
  });
  return std::move(*result);
}

/// Waits for work that continues after Ctrl-C, before the program ends; another Ctrl-C ends the
/// wait.
void wait_for_interrupted_work();

}  // namespace palpate::python
