// The distance of a tool that never touched: of its spheres from what the cameras measured.
//
//   distance = min over pixels p and spheres s of |p - c_s| - r_s
//
// It only tells the user how far to move the path: a look is over some thousand pixels, exact for
// them, and then over all pixels around the nearest one.
#pragma once

#include <optional>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/run/records.h"
#include "palpate/session/run.h"
#include "palpate/tool/tool.h"

namespace palpate { inline namespace v0 {

/// Watches a run until its first contact. One thread.
class NearestWatch {
 public:
  /// `tool` must outlive it.
  NearestWatch(const Tool& tool, std::vector<DepthStreamInfo> streams);

  /// Keeps the newest frame of each camera. O(pixels).
  void take(const FrameRecord& record, const DepthFrame& frame);
  /// Looks ten times a second of the run, until something is touched.
  void take(const ContactRecord& contact);
  /// Returns the nearest approach; none after a contact, or without measurements.
  std::optional<NearestApproach> nearest() const;

 private:
  struct Camera {
    DepthStreamInfo stream;
    DepthFrame frame;
    Pose X_WC;
  };
  struct Pixel {
    int u = 0, v = 0;
  };

  void look(const Camera& camera, const ContactRecord& contact);
  void look_at(const Camera& camera, const Pose& X_TC, Pixel low, Pixel high, int step,
               double& nearest, Pixel& at) const;
  double distance_below(const Vec3d& p_T, double limit) const;

  static constexpr double kPeriod = 0.1;  // s

  const Tool& tool_;
  std::vector<Camera> cameras_;
  double next_look_ = 0;  // s
  bool has_touched_ = false;
  std::optional<NearestApproach> nearest_;
};

}}  // namespace palpate::v0
