// Detects a wrong depth unit, from the distance of the tool to what a camera sees.
#pragma once

#include <string>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/run/records.h"
#include "palpate/tool/tool.h"

namespace palpate { inline namespace v0 {

/// Finds runs in which the tool never meets what is seen, though both lie in the same directions,
/// by a usual factor of wrong units (counts of 1/5000 m read as millimeters: everything is five
/// times as far as the tool). A doubt: nothing is changed.
class UnitWatch {
 public:
  UnitWatch(const Tool& tool, std::vector<DepthStreamInfo> streams);

  /// Keeps the newest frame of each camera. O(pixels).
  void take(const FrameRecord& record, const DepthFrame& frame);
  /// Looks at some hundred pixels around the tool, ten times a second of the run.
  void take(const ContactRecord& contact);
  /// Returns one sentence for each camera in doubt, with the likely right unit, once.
  std::vector<std::string> doubts();
  /// True if the tool had time to find something.
  bool has_waited(double time) const { return time > kPatience; }

 private:
  static constexpr double kPatience = 10, kPeriod = 0.1;  // s
  struct Camera {
    DepthStreamInfo stream;
    DepthFrame frame;
    Pose X_WC;
    double unit = 0.001;
    int num_looks = 0;
    double least = 0, most = 0;  ///< distance of the rest over that of the tool
    bool has_reported = false;
  };

  Vec3d center_T_;
  double radius_ = 0;  ///< m, of the tool around its middle
  std::vector<Camera> cameras_;
  double next_look_ = 0;  ///< s
  std::vector<std::uint16_t> counts_;
};

}}  // namespace palpate::v0
