// What kind of depth camera frames come from, which decides how their noise and their edges look.
#pragma once

#include <array>

namespace palpate {

/// How a depth camera measures.
enum class SensorKind {
  none,              ///< nobody says, or without faults as a simulated one
  structured_light,  ///< one camera sees a known pattern: Kinect v1, Xtion, SR305
  active_stereo,     ///< two cameras see a random pattern: RealSense D400, Gemini
  tof,               ///< time of flight: Azure Kinect, Femto, L515
};
constexpr auto names_of(SensorKind) {
  return std::array{"none", "structured_light", "active_stereo", "tof"};
}

}  // namespace palpate
