// Progress and a clean stop for programs that take long.
#pragma once

#include <signal.h>

#include <chrono>
#include <iosfwd>
#include <optional>
#include <string>

namespace palpate::apps {

/// Makes Ctrl-C (and Ctrl-\, SIGTERM, or a closed terminal) set a flag instead of ending the
/// program. A second Ctrl-C or kill ends it, two seconds after the first at the earliest: keys
/// repeat, and a force needs time to fade. A closed pipe does not end it.
void catch_interrupts();
bool interrupted();
/// Until then: makes Ctrl-C and SIGTERM end the program at once, with the words that nothing was
/// written.
void end_at_interrupts();

/// While it exists, Ctrl-Z sets a flag instead of stopping the program, which has to fade its force
/// first. One at a time.
class Suspension {
 public:
  Suspension();
  ~Suspension();
  Suspension(const Suspension&) = delete;
  Suspension& operator=(const Suspension&) = delete;

  bool is_requested() const;
  /// Stops the program; returns once it continues.
  void stop();

 private:
  struct sigaction before_;
};

/// Returns the text without control characters, for text from files, cameras and robots; invalid
/// UTF-8 becomes '?'.
std::string printable(const std::string& text);

/// Leaves out notes, progress and results in words (--quiet): errors, and results that were asked
/// for as numbers or JSON, are printed.
void set_quiet();
/// std::cout for results in words; with --quiet a stream that drops them.
std::ostream& results();

/// Returns `text` in red or yellow for stderr: plain if that is no terminal, or if the environment
/// has NO_COLOR or TERM=dumb.
std::string red(const std::string& text);
std::string yellow(const std::string& text);

/// Prints "palpate: note: ..." or "palpate: warning: ..." on stderr. Waits for its reader.
void print_note(const std::string& text);
void print_warning(const std::string& text);

/// Progress on stderr: on a terminal a bar with the remaining time, else a line every few seconds.
/// Omitted while stderr accepts nothing.
class Progress {
 public:
  explicit Progress(std::string title);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// Shows the `share` of the work done, 0 to 1 (none: without end), and a few words. Cheap to call
  /// often.
  void update(std::optional<double> share, const std::string& words);
  /// True if `update` would show something now; else the words need not be composed.
  bool due() const;

 private:
  using Clock = std::chrono::steady_clock;
  std::string title_;
  bool is_terminal_;
  Clock::time_point start_, next_;
  bool drawn_ = false;
};

/// Prints a line on stderr while a bar may be shown. Any thread. Never waits: while stderr accepts
/// nothing (Ctrl-S, a full pipe), lines are kept for later, up to 64 KiB of them.
void print_beside_progress(const std::string& text);
/// Prints the lines that were kept. Waits.
void print_kept();

}  // namespace palpate::apps
