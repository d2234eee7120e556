#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <string>

#include "src/contact/cuda/query_answer.h"

namespace palpate {
namespace {

// Longer under a debugger or a checker, which make kernels slow.
std::chrono::milliseconds longest_wait() {
  const char* const factor = std::getenv("PALPATE_GPU_PATIENCE");
  const int times = factor != nullptr ? std::atoi(factor) : 1;
  return std::chrono::milliseconds(50) * std::clamp(times, 1, 1000);
}

// Lets the other thread of this core go on, and the memory bus rest.
inline void relax() {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("yield");
#endif
}

}  // namespace

AnswerBox::AnswerBox(int gpu, int num_blocks)
    : memory_(gpu), num_blocks_(num_blocks), longest_(longest_wait()) {
  output_.partials = memory_.take<double>(static_cast<std::size_t>(MeasureTerms::kNum) *
                                          static_cast<std::size_t>(num_blocks));
  output_.count = memory_.take<unsigned long long>(1);
  output_.words = memory_.take_pinned<std::uint64_t>(kNumWords);
}

MeasureOutput AnswerBox::next() noexcept {
  ++output_.query;
  if (output_.query == 0) ++output_.query;  // the number of memory that was never written
  return output_;
}

// Have all words come?
bool AnswerBox::take() noexcept {
  std::uint32_t halves[kNumWords];
  for (int i = 0; i < kNumWords; ++i) {
    const std::uint64_t word = static_cast<const volatile std::uint64_t*>(output_.words)[i];
    if (static_cast<std::uint32_t>(word >> 32) != output_.query) return false;
    halves[i] = static_cast<std::uint32_t>(word);
  }
  double terms[MeasureTerms::kNum];
  for (int i = 0; i < MeasureTerms::kNum; ++i) {
    const std::uint64_t bits = halves[2 * i] | std::uint64_t{halves[2 * i + 1]} << 32;
    std::memcpy(&terms[i], &bits, sizeof bits);
  }
  std::memcpy(static_cast<MeasureTerms*>(&answer_), terms, sizeof terms);
  return true;
}

bool AnswerBox::await(gpu::Stream& stream) noexcept {
  using Clock = std::chrono::steady_clock;
  constexpr auto kAskEvery = std::chrono::milliseconds(1);
  constexpr int kLooksPerTime = 64;
  if (!status() || !stream.status()) return false;
  const Clock::time_point start = Clock::now();
  Clock::time_point ask = start + kAskEvery;
  for (int look = 1; !take(); ++look) {
    relax();
    if (look % kLooksPerTime != 0) continue;
    const Clock::time_point now = Clock::now();
    if (now < ask) continue;
    // Asking costs the driver some time, so seldom. A device that is done must have answered.
    ask = now + kAskEvery;
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

}  // namespace palpate
