#include "src/core/internal/guarded.h"

#if defined(__linux__)
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif

#include <algorithm>

namespace palpate { inline namespace v0 {

#if defined(__linux__)
/// Sets the priority of one thread: Linux allows that, POSIX sets it for whole processes only.
int take_rank(ThreadRank rank) noexcept {
  constexpr int kSteps[] = {-5, 2, 1, 6}, kHighestPriority = -20, kLowestPriority = 19;
  const auto thread = static_cast<id_t>(syscall(SYS_gettid));
  const int now = getpriority(PRIO_PROCESS, thread);
  const int desired =
      std::clamp(now + kSteps[static_cast<int>(rank)], kHighestPriority, kLowestPriority);
  return setpriority(PRIO_PROCESS, thread, desired) == 0 ? desired : now;
}
#else
int take_rank(ThreadRank) noexcept { return 0; }
#endif

}}  // namespace palpate::v0
