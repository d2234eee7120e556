#include "src/run/internal/real_time.h"

#include <pthread.h>
#include <sched.h>
#if defined(__linux__)
#include <sys/mman.h>
#endif

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

namespace palpate { inline namespace v0 {
namespace {

std::mutex g_memory_mutex;
int g_num_memory_locks = 0;

#if defined(__linux__)
int lock_memory() {
  // Not what is mapped later: beyond the limit of locked memory it could not be mapped at all.
  return mlockall(MCL_CURRENT) == 0 ? 0 : errno;
}
void unlock_memory() { munlockall(); }
#else
int lock_memory() { return ENOTSUP; }
void unlock_memory() {}
#endif

std::string text_of(int error_number) {
  return std::error_code(error_number, std::generic_category()).message();
}

}  // namespace

int request_real_time(int priority) noexcept {
  int policy = SCHED_OTHER;
  sched_param parameters{};
  if (const int error = pthread_getschedparam(pthread_self(), &policy, &parameters)) return error;
  if (policy == SCHED_FIFO || policy == SCHED_RR) return 0;
  parameters.sched_priority = priority;
  return pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters);
}

int num_threads_for(int allowed) noexcept {
  const int num_cores = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  return allowed > 0 ? std::min(allowed, num_cores) : num_cores;
}

int MemoryLock::hold() noexcept {
  const std::lock_guard lock(g_memory_mutex);
  const int refused = lock_memory();
  if (refused == 0 && !std::exchange(is_held_, true)) ++g_num_memory_locks;
  return refused;
}

void MemoryLock::release() noexcept {
  const std::lock_guard lock(g_memory_mutex);
  if (std::exchange(is_held_, false) && --g_num_memory_locks == 0) unlock_memory();
}

std::string scheduler_refused(const char* which_thread, int error_number) {
  return std::string("the scheduler refused real time (SCHED_FIFO) to the ") + which_thread +
         " thread: " + text_of(error_number) +
         "; forces may come late on a busy machine; allow it with a line '@users - rtprio 90' in "
         "/etc/security/limits.conf";
}

std::string memory_lock_refused(int error_number) {
  return "memory could not be locked: " + text_of(error_number) +
         "; forces may come late when memory is short; allow it with a line '@users - memlock "
         "unlimited' in /etc/security/limits.conf";
}

std::string frames_left_out(std::uint64_t num, std::uint64_t num_late,
                            const LatencyHistogram& surface_compute, double period) {
  const auto num_slow = surface_compute.num_above(static_cast<std::int64_t>(0.9e9 * period));
  const auto milliseconds = [](double seconds) {
    return std::to_string(std::lround(1e3 * seconds)) + " ms";
  };
  std::string text = std::to_string(num) + " depth frames were dropped, because ";
  if (num_slow > 0 && num_slow >= num_late) {
    text += "surfaces take " + milliseconds(1e-6 * surface_compute.summary().p50) + ", and " +
            std::to_string(num_slow) + " of them took longer than the " + milliseconds(period) +
            " between two frames; a smaller image, a GPU or fewer other programs help";
  } else if (num_late > 0) {
    text += "frames came late " + std::to_string(num_late) +
            " times and the next ones right after them; a camera or disk that keeps up, or fewer "
            "other programs, help";
  } else {
    text += "the processor was busy when they came; more cores or fewer other programs help";
  }
  return text;
}

}}  // namespace palpate::v0
