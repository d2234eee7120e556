// The distance of a tool that never touched: of its spheres from what the cameras measured.
//
//   distance = min over pixels p and spheres s of |p - c_s| - r_s
//
// It only tells the user how far to move the path: a look is over some thousand pixels, exact for
// them, and then over all pixels around the nearest one.
#pragma once

#include <optional>
#include <span>

#include "palpate/session/run.h"
#include "palpate/tool/tool.h"
#include "src/session/recording/newest_frames.h"

namespace palpate { inline namespace v0 {

/// Watches a run until its first contact. One thread.
class NearestWatch {
 public:
  /// `tool` must outlive it.
  explicit NearestWatch(const Tool& tool) : tool_(tool) {}

  /// Ends the watch with a contact.
  void take(const ContactRecord& contact) {
    has_touched_ = has_touched_ || contact.penetration.volume > 0;
  }
  void look(std::span<const NewestFrame> cameras, const ContactRecord& contact);
  /// Returns the nearest approach; none after a contact, or without measurements.
  std::optional<NearestApproach> nearest() const;

 private:
  struct Pixel {
    int u = 0, v = 0;
  };

  void look(const NewestFrame& camera, const ContactRecord& contact);
  void look_at(const NewestFrame& camera, const Pose& X_TC, Pixel low, Pixel high, int step,
               double& nearest, Pixel& at) const;

  const Tool& tool_;
  bool has_touched_ = false;
  std::optional<NearestApproach> nearest_;
};

}}  // namespace palpate::v0
