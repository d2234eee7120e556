// Progress and a clean stop for programs that take long.
#pragma once

#include <signal.h>

#include <chrono>
#include <optional>
#include <string>

namespace palpate::apps {

/// From now on Ctrl-C (and Ctrl-\, a polite kill, or a closed terminal) sets a flag instead of
/// ending the program. A second Ctrl-C or kill ends it, two seconds after the first at the soonest:
/// keys repeat, and a force needs time to fade. Nobody who stops reading what is said ends it.
void catch_interrupts();
bool interrupted();

/// As long as it lives, Ctrl-Z asks instead of stopping the program, which has a force to take away
/// first. One at a time.
class Suspension {
 public:
  Suspension();
  ~Suspension();
  Suspension(const Suspension&) = delete;
  Suspension& operator=(const Suspension&) = delete;

  bool is_requested() const;
  /// Stops the program; returns once it goes on.
  void stop();

 private:
  struct sigaction before_;
};

/// The text without anything that a terminal would obey; what is not UTF-8 becomes '?'. Others say
/// what is in it: files, cameras, robots.
std::string printable(const std::string& text);

/// "palpate: note: ..." on stderr. Waits for whoever reads it.
void print_note(const std::string& text);

/// Progress on stderr: on a terminal a bar with the time left, else a line every few seconds. Left
/// out while nobody reads it.
class Progress {
 public:
  explicit Progress(std::string title);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// `share` of the work done, 0 ... 1, or none of what has no end, and a few words. Cheap to call
  /// often.
  void update(std::optional<double> share, const std::string& words);
  /// True if `update` would show something now; saves making the words.
  bool due() const;

 private:
  using Clock = std::chrono::steady_clock;
  std::string title_;
  bool is_terminal_;
  Clock::time_point start_, next_;
  bool drawn_ = false;
};

/// A line on stderr while a bar may be shown. Any thread. Never waits: while nobody reads (Ctrl-S,
/// a pipe that is full), lines are kept for later, up to 64 KiB of them.
void print_beside_progress(const std::string& text);
/// What was kept. Waits.
void print_kept();

}  // namespace palpate::apps
