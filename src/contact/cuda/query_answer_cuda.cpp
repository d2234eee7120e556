#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <string>

#include "src/contact/cuda/query_answer.h"

namespace palpate { inline namespace v0 {
namespace {

// Limit of the wait; longer under a debugger or a checker, which make kernels slow.
std::chrono::milliseconds longest_wait() {
  const char* const factor = std::getenv("PALPATE_GPU_PATIENCE");
  const int times = factor != nullptr ? std::atoi(factor) : 1;
  return std::chrono::milliseconds(50) * std::clamp(times, 1, 1000);
}

// Yields to the other thread of this core, and spares the memory bus.
inline void relax() {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("yield");
#endif
}

}  // namespace

AnswerBox::AnswerBox(int gpu, int num_blocks, int num_numbers)
    : memory_(gpu), num_blocks_(num_blocks), num_numbers_(num_numbers), longest_(longest_wait()) {
  const auto size = static_cast<std::size_t>(num_numbers);
  output_.partials = memory_.take<double>(size * static_cast<std::size_t>(num_blocks));
  output_.count = memory_.take<unsigned long long>(1);
  output_.words = memory_.take_pinned<std::uint64_t>(2 * size);
}

MeasureOutput AnswerBox::next() noexcept {
  ++output_.query;
  if (output_.query == 0) ++output_.query;  // the number of memory that was never written
  return output_;
}

// True once all words have arrived.
bool AnswerBox::take() noexcept {
  for (int i = 0; i < num_numbers_; ++i) {
    std::uint64_t bits = 0;
    for (int half = 0; half < 2; ++half) {
      const std::uint64_t word =
          static_cast<const volatile std::uint64_t*>(output_.words)[2 * i + half];
      if (static_cast<std::uint32_t>(word >> 32) != output_.query) return false;
      bits |= (word & 0xffffffff) << 32 * half;
    }
    std::memcpy(&numbers_[i], &bits, sizeof bits);
  }
  return true;
}

QueryAnswer AnswerBox::answer() const {
  QueryAnswer answer;
  std::memcpy(static_cast<MeasureTerms*>(&answer), numbers_, sizeof(MeasureTerms));
  return answer;
}

StiffnessSums AnswerBox::stiffness() const {
  StiffnessSums sums;
  std::copy_n(numbers_ + MeasureTerms::kNum, StiffnessSums::kNum, sums.numbers);
  return sums;
}

bool AnswerBox::await(gpu::Stream& stream) noexcept {
  using Clock = std::chrono::steady_clock;
  constexpr auto kPollPeriod = std::chrono::milliseconds(1);
  constexpr int kLooksPerTime = 64;
  if (!status() || !stream.status()) return false;
  const Clock::time_point start = Clock::now();
  Clock::time_point next_poll = start + kPollPeriod;
  for (int look = 1; !take(); ++look) {
    relax();
    if (look % kLooksPerTime != 0) continue;
    const Clock::time_point now = Clock::now();
    if (now < next_poll) continue;
    // Polling costs the driver some time, so it is rare. A device that is done must have answered.
    next_poll = now + kPollPeriod;
    const bool is_done = stream.is_idle();
    if (!stream.status()) return false;
    if (is_done && take()) return true;
    if (is_done || now > start + longest_) {
      stream.fail(
          {Errc::unavailable, "GPU " + std::to_string(stream.gpu()) +
                                  (is_done ? " finished a query without an answer"
                                           : " has not answered a query in " +
                                                 std::to_string(longest_.count()) + " ms") +
                                  "; check it with nvidia-smi, or use the CPU (--backend cpu)"});
      return false;
    }
  }
  return true;
}

}}  // namespace palpate::v0
