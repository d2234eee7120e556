// Detects a wrong depth unit, from the distance of the tool to what a camera sees.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "palpate/tool/tool.h"
#include "src/session/recording/newest_frames.h"

namespace palpate { inline namespace v0 {

/// Finds runs in which the tool never meets what is seen, though both lie in the same directions,
/// by a usual factor of wrong units (counts of 1/5000 m read as millimeters: everything is five
/// times as far as the tool). A doubt: nothing is changed.
class UnitWatch {
 public:
  UnitWatch(const Tool& tool, std::size_t num_cameras);

  /// Looks at some hundred pixels around the tool in each of the cameras.
  void look(std::span<const NewestFrame> cameras, const Pose& X_WT);
  /// Returns one sentence for each camera in doubt, with the likely right unit, once.
  std::vector<std::string> doubts();
  /// True if the tool had time to find something.
  bool has_waited(double time) const { return time > kPatience; }

 private:
  static constexpr double kPatience = 10;  // s
  struct Camera {
    std::string name;
    double unit = 0.001;
    int num_looks = 0;
    double least = 0, most = 0;  ///< distance of the rest over that of the tool
    bool has_reported = false;
  };

  Vec3d center_T_;
  double radius_ = 0;  ///< m, of the tool around its middle
  std::vector<Camera> cameras_;
  std::vector<std::uint16_t> counts_;
};

}}  // namespace palpate::v0
