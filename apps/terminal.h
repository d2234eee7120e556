// Progress and a clean stop for programs that take long.
#pragma once

#include <chrono>
#include <string>

namespace palpate::apps {

/// From now on Ctrl-C (and a polite kill, or a closed terminal) sets a flag instead of ending the
/// program; a second one ends it.
void catch_interrupts();
bool interrupted();

/// Progress on stderr: a bar with the time left on a terminal, else a line every few seconds.
class Progress {
 public:
  explicit Progress(std::string title);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// `share` of the work done, 0 ... 1, and a few words. Cheap to call often.
  void update(double share, const std::string& words);
  /// True if `update` would show something now; saves making the words.
  bool due() const;

 private:
  using Clock = std::chrono::steady_clock;
  std::string title_;
  bool is_terminal_;
  Clock::time_point start_, next_;
  bool drawn_ = false;
};

/// A line on stderr while a bar may be shown. Any thread.
void print_beside_progress(const std::string& text);

}  // namespace palpate::apps
