#include "apps/terminal/terminal.h"

#include <poll.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <iostream>
#include <mutex>
#include <string_view>
#include <utility>

namespace palpate::apps {
namespace {

constexpr std::int64_t kPatience = 2'000'000'000;  // ns
constexpr std::size_t kMaxKept = 64 << 10;         // bytes
constexpr std::size_t kPiece = 512;                // bytes that fit if stderr accepts any

std::atomic<std::int64_t> g_interrupted_at = 0;  // ns, monotonic; 0: never
static_assert(std::atomic<std::int64_t>::is_always_lock_free);
bool g_is_quiet = false;                 // set while options are parsed
std::atomic<bool> g_is_to_stop = false;  // by Ctrl-Z
static_assert(std::atomic<bool>::is_always_lock_free);

/// True for the first one.
bool take_interrupt(std::int64_t now) {
  std::int64_t never = 0;
  return g_interrupted_at.compare_exchange_strong(never, now);
}

std::int64_t nanoseconds() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return std::int64_t{1'000'000'000} * now.tv_sec + now.tv_nsec;
}

void on_hang_up(int) { (void)take_interrupt(nanoseconds()); }

void on_signal(int number) {
  const std::int64_t now = nanoseconds();
  if (take_interrupt(now) || now - g_interrupted_at < kPatience) return;
  signal(number, SIG_DFL);
  raise(number);
}

void on_early_signal(int number) {
  constexpr std::string_view kWords = "palpate: interrupted; nothing was written\n";
  const auto written = write(STDERR_FILENO, kWords.data(), kWords.size());
  (void)written;  // nobody is there to read it
  signal(number, SIG_DFL);
  raise(number);
}

void on_suspension(int) { g_is_to_stop = true; }

/// Lines that stderr has not accepted yet.
class KeptLines {
 public:
  void add(const std::string& line) {
    const std::lock_guard lock(mutex_);
    if (text_.size() + line.size() > kMaxKept) {
      ++num_left_out_;
    } else {
      text_ += line;
    }
    write_some();
  }
  /// Writes text that is soon out of date: completely or not at all.
  void say_now(const std::string& text) {
    const std::lock_guard lock(mutex_);
    write_some();
    if (!text_.empty() || text.size() > kPiece || !has_room()) return;
    text_ = text;
    write_some();
  }
  /// Writes all remaining text; waits for a reader.
  void finish() {
    const std::lock_guard lock(mutex_);
    std::fputs(std::exchange(text_, {}).c_str(), stderr);
    if (num_left_out_ > 0) {
      std::fprintf(stderr, "palpate: %zu more lines were left out, because nobody read them\n",
                   std::exchange(num_left_out_, 0));
    }
  }

 private:
  static bool has_room() {
    pollfd file{STDERR_FILENO, POLLOUT, 0};
    return poll(&file, 1, 0) > 0;  // also for an error, which writing then reports
  }
  void write_some() {
    while (!text_.empty() && has_room()) {
      const ssize_t num = write(STDERR_FILENO, text_.data(), std::min(text_.size(), kPiece));
      if (num > 0) {
        text_.erase(0, static_cast<std::size_t>(num));
      } else if (errno == EAGAIN) {
        return;
      } else if (errno != EINTR) {
        text_.clear();  // nobody will ever read it
      }
    }
  }

  std::mutex mutex_;
  std::string text_;
  std::size_t num_left_out_ = 0;
};

KeptLines& kept_lines() {
  static KeptLines lines;
  return lines;
}

/// Returns the length of the UTF-8 character at `at`; 0 if invalid.
std::size_t utf8_length(const std::string& text, std::size_t at) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const std::size_t length = byte(at) < 0x80       ? 1
                             : byte(at) >> 5 == 6  ? 2
                             : byte(at) >> 4 == 14 ? 3
                             : byte(at) >> 3 == 30 ? 4
                                                   : 0;
  if (at + length > text.size()) return 0;
  for (std::size_t i = 1; i < length; ++i) {
    if (byte(at + i) >> 6 != 2) return 0;
  }
  return length;
}

/// True for a control character of one byte, or U+0080 to U+009F, which some terminals obey too.
bool is_control(const std::string& text, std::size_t at, std::size_t length) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  return length == 1 ? byte(at) < 0x20 || byte(at) == 0x7f
                     : length == 2 && byte(at) == 0xc2 && byte(at + 1) < 0xa0;
}

/// Returns the text in a color of the terminal that stderr is; else as it is.
std::string colored(const std::string& text, const char* color) {
  const char* const terminal = std::getenv("TERM");
  const char* const refused = std::getenv("NO_COLOR");
  const bool is_colored = isatty(STDERR_FILENO) != 0 && (refused == nullptr || *refused == '\0') &&
                          terminal != nullptr && std::string_view(terminal) != "dumb";
  return is_colored ? "\033[" + (color + ("m" + text)) + "\033[0m" : text;
}

void print_line(const char* kind, const std::string& text) {
  if (!g_is_quiet) std::cerr << "palpate: " << yellow(kind) << ' ' << printable(text) << '\n';
}

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
  action.sa_flags = SA_RESTART;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  sigaction(SIGQUIT, &action, nullptr);
  struct sigaction ignore {};
  ignore.sa_handler = SIG_IGN;
  sigaction(SIGPIPE, &ignore, nullptr);
  // A closing terminal may hang up several times; under nohup it must not count.
  struct sigaction hang_up {};
  sigaction(SIGHUP, nullptr, &hang_up);
  if (hang_up.sa_handler == SIG_IGN) return;
  action.sa_handler = on_hang_up;
  sigaction(SIGHUP, &action, nullptr);
}

void end_at_interrupts() {
  struct sigaction action {};
  action.sa_handler = on_early_signal;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

bool interrupted() { return g_interrupted_at != 0; }

Suspension::Suspension() {
  sigaction(SIGTSTP, nullptr, &before_);
  if (before_.sa_handler == SIG_IGN) return;  // no shell would continue the program
  g_is_to_stop = false;
  struct sigaction action {};
  action.sa_handler = on_suspension;
  action.sa_flags = SA_RESTART;
  sigaction(SIGTSTP, &action, nullptr);
  // In the background (bg) it may print, whatever the terminal wants: that would stop it, too.
  action.sa_handler = SIG_IGN;
  sigaction(SIGTTOU, &action, nullptr);
}

Suspension::~Suspension() { sigaction(SIGTSTP, &before_, nullptr); }

bool Suspension::is_requested() const { return g_is_to_stop; }

void Suspension::stop() {
  g_is_to_stop = false;
  raise(SIGSTOP);
}

std::string printable(const std::string& text) {
  std::string line;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t length = utf8_length(text, at);
    if (length == 0 || is_control(text, at, length)) {
      line += text[at] == '\n' ? ' ' : '?';
    } else {
      line.append(text, at, length);
    }
    at += std::max<std::size_t>(length, 1);
  }
  return line;
}

void set_quiet() { g_is_quiet = true; }

std::ostream& results() {
  static std::ostream nowhere(nullptr);
  return g_is_quiet ? nowhere : std::cout;
}

std::string red(const std::string& text) { return colored(text, "31"); }

std::string yellow(const std::string& text) { return colored(text, "33"); }

void print_note(const std::string& text) { print_line("note:", text); }

void print_warning(const std::string& text) { print_line("warning:", text); }

void print_beside_progress(const std::string& text) {
  if (g_is_quiet) return;
  kept_lines().add((isatty(STDERR_FILENO) != 0 ? "\r\033[K" : "") +
                   ("palpate: " + printable(text)) + "\n");
}

void print_kept() { kept_lines().finish(); }

Progress::Progress(std::string title)
    : title_(std::move(title)),
      is_terminal_(isatty(STDERR_FILENO) != 0),
      start_(Clock::now()),
      next_(start_ + std::chrono::milliseconds(is_terminal_ ? 200 : 5000)) {}

Progress::~Progress() {
  if (drawn_ && is_terminal_) kept_lines().say_now("\r\033[K");
}

bool Progress::due() const { return !g_is_quiet && Clock::now() >= next_; }

void Progress::update(std::optional<double> done, const std::string& words) {
  if (!due()) return;
  const auto now = Clock::now();
  next_ = now + std::chrono::milliseconds(is_terminal_ ? 100 : 5000);
  drawn_ = true;
  const double share = std::clamp(done.value_or(0), 0.0, 1.0);
  const double elapsed = std::chrono::duration<double>(now - start_).count();
  const std::string left = share > 0.01 ? clock_text(elapsed * (1 - share) / share) : "-:--";
  char line[240];
  if (!done) {
    std::snprintf(line, sizeof line, is_terminal_ ? "\r\033[K%s  %s" : "%s: %s\n", title_.c_str(),
                  words.c_str());
  } else if (is_terminal_) {
    constexpr int kBar = 28;
    const int full = static_cast<int>(share * kBar);
    std::snprintf(line, sizeof line, "\r\033[K%s [%s%s] %3.0f %%  %s left  %s", title_.c_str(),
                  std::string(static_cast<std::size_t>(full), '=').c_str(),
                  std::string(static_cast<std::size_t>(kBar - full), ' ').c_str(), 100 * share,
                  left.c_str(), words.c_str());
  } else {
    std::snprintf(line, sizeof line, "%s: %.0f %%, %s left, %s\n", title_.c_str(), 100 * share,
                  left.c_str(), words.c_str());
  }
  kept_lines().say_now(line);
}

}  // namespace palpate::apps
