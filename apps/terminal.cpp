#include "apps/terminal.h"

#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

namespace palpate::apps {
namespace {

volatile sig_atomic_t g_interrupted = 0;

void on_signal(int) { g_interrupted = 1; }

std::string clock_text(double seconds) {
  char text[32];
  const int whole = static_cast<int>(std::clamp(std::ceil(seconds), 0.0, 1e6));
  std::snprintf(text, sizeof text, "%d:%02d", whole / 60, whole % 60);
  return text;
}

}  // namespace

void catch_interrupts() {
  struct sigaction action {};
  action.sa_handler = on_signal;
  action.sa_flags = SA_RESETHAND | SA_RESTART;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  // A closing terminal may hang up several times; under nohup it must not count.
  struct sigaction hang_up {};
  sigaction(SIGHUP, nullptr, &hang_up);
  if (hang_up.sa_handler == SIG_IGN) return;
  action.sa_flags = SA_RESTART;
  sigaction(SIGHUP, &action, nullptr);
}

bool interrupted() { return g_interrupted != 0; }

void print_beside_progress(const std::string& text) {
  std::fprintf(stderr, "%spalpate: %s\n", isatty(STDERR_FILENO) != 0 ? "\r\033[K" : "",
               text.c_str());
}

Progress::Progress(std::string title)
    : title_(std::move(title)),
      is_terminal_(isatty(STDERR_FILENO) != 0),
      start_(Clock::now()),
      next_(start_ + std::chrono::milliseconds(is_terminal_ ? 200 : 5000)) {}

Progress::~Progress() {
  if (drawn_ && is_terminal_) std::fputs("\r\033[K", stderr);
}

bool Progress::due() const { return Clock::now() >= next_; }

void Progress::update(double share, const std::string& words) {
  if (!due()) return;
  const auto now = Clock::now();
  next_ = now + std::chrono::milliseconds(is_terminal_ ? 100 : 5000);
  drawn_ = true;
  share = std::clamp(share, 0.0, 1.0);
  const double elapsed = std::chrono::duration<double>(now - start_).count();
  const std::string left = share > 0.01 ? clock_text(elapsed * (1 - share) / share) : "-:--";
  if (is_terminal_) {
    constexpr int kBar = 28;
    const int full = static_cast<int>(share * kBar);
    std::fprintf(stderr, "\r\033[K%s [%s%s] %3.0f %%  %s left  %s", title_.c_str(),
                 std::string(static_cast<std::size_t>(full), '=').c_str(),
                 std::string(static_cast<std::size_t>(kBar - full), ' ').c_str(), 100 * share,
                 left.c_str(), words.c_str());
  } else {
    std::fprintf(stderr, "%s: %.0f %%, %s left, %s\n", title_.c_str(), 100 * share, left.c_str(),
                 words.c_str());
  }
  std::fflush(stderr);
}

}  // namespace palpate::apps
