// Load relief of a live loop: computes less, step by step, before too little computing time costs
// the force, and more again by itself.
//
//   a page is open           -> it is drawn less often
//   depth frames get old     -> images are made smaller, by 2, then by 4
//   contacts get old         -> half of the spheres are evaluated, then a quarter, then an eighth
//
// A step is taken back when all has been well for some time. If that was too early, the time
// doubles.
#pragma once

#include <algorithm>

namespace palpate { inline namespace v0 {

/// Numbers of steps taken; each from 0.
struct ReliefSteps {
  int page = 0, image = 0, spheres = 0;

  bool any() const { return page > 0 || image > 0 || spheres > 0; }
  friend bool operator==(const ReliefSteps&, const ReliefSteps&) = default;
};

/// Ticks in a window of time. An age is "old" beyond half of the limit of the safety filter,
/// "getting old" beyond a quarter of it, and never while it is usual at the measured rates.
struct LoadWindow {
  double seconds = 1;
  /// Share of the ticks that used old frames, old contacts, and any that are getting old.
  double old_frames = 0, old_contacts = 0, ageing = 0;
  bool has_frames = true;  ///< the source sent frames: else no step helps
  bool has_page = false;   ///< a page is open
};

/// Judges window after window. No clock, no thread: the same windows give the same steps.
class LoadRelief {
 public:
  static constexpr double kFew = 0.02;     ///< share of ticks that may be late
  static constexpr double kCalm = 5;       ///< s without overload before a step is taken back
  static constexpr double kMaxCalm = 160;  ///< s, its upper limit
  static constexpr double kRelapse = 30;   ///< s; an overload so soon after: it was too early

  /// Takes the largest numbers of steps of image and spheres.
  LoadRelief(int max_image, int max_spheres) : max_steps_{1, max_image, max_spheres} {}

  const ReliefSteps& steps() const { return steps_; }
  double patience() const { return patience_; }

  /// True if the steps have changed: then the next window is to begin once that is done.
  bool look(const LoadWindow& window) {
    since_back_ += window.seconds;
    const ReliefSteps before = steps_;
    if (is_late(window)) {
      calm_ = 0;
      go_on(window);
    } else if (calm_ += window.seconds; calm_ >= patience_) {
      if (steps_.any()) {
        take_back();
      } else {
        // The last step back was not too early.
        patience_ = std::max(patience_ / 2, kCalm);
        calm_ = 0;
      }
    }
    return steps_ != before;
  }

 private:
  bool is_late(const LoadWindow& w) const {
    return w.old_frames > kFew || w.old_contacts > kFew || (w.has_page && w.ageing > kFew);
  }

  /// Takes the next step: the page first, as it does not affect the force.
  void go_on(const LoadWindow& w) {
    ReliefSteps next = steps_;
    if (w.has_page && steps_.page < max_steps_.page) {
      ++next.page;
    } else {
      if (w.old_frames > kFew && w.has_frames)
        next.image = std::min(next.image + 1, max_steps_.image);
      if (w.old_contacts > kFew) next.spheres = std::min(next.spheres + 1, max_steps_.spheres);
    }
    if (next == steps_) return;
    steps_ = next;
    if (since_back_ < kRelapse) patience_ = std::min(2 * patience_, kMaxCalm);
    since_back_ = kRelapse;
  }

  /// Takes one step back in the other order: those that affect the force first.
  void take_back() {
    int& step = steps_.spheres > 0 ? steps_.spheres : steps_.image > 0 ? steps_.image : steps_.page;
    --step;
    calm_ = since_back_ = 0;
  }

  ReliefSteps max_steps_;
  ReliefSteps steps_;
  double calm_ = 0, patience_ = kCalm, since_back_ = kRelapse;
};

}}  // namespace palpate::v0
