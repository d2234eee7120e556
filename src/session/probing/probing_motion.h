// Pose of a tool while it probes: everything except its depth.
#pragma once

#include <vector>

#include "palpate/math/geometry.h"
#include "src/session/probing/coarse_depth.h"
#include "src/session/probing/lead_end.h"

namespace palpate { inline namespace v0 {

/// Touched place and end of the slide: cells of a CoarseDepth.
struct ProbeTarget {
  int column = 0, row = 0, end_column = 0, end_row = 0;
};

/// The tool as a plane across a direction meets it.
struct Imprint {
  double front = 0, back = 0;  ///< m along the direction
  double press = 0;  ///< m, how far the front must go beyond the plane for a tenth of the volume
  Vec3d center_T;    ///< point to keep on the viewing ray, moved along the direction to 0
  double reach = 0;  ///< m, from there to the farthest point of mesh, spheres and frame origin
};

/// Motion of a probing tool on the viewing ray of a target: comes in, slides to the next cell with
/// a slow turn, and leaves. It is held like a pen: its end leads, the rest leans to the upper
/// right.
class ProbingMotion {
 public:
  static constexpr double kFraction = 0.1;  ///< of the tool, behind the surface when pressed in

  /// `end`: s, of the path.
  ProbingMotion(const CoarseDepth& scene, const ProbeTarget& target, const Tool& tool,
                const LeadEnd& lead, bool tip_is_given, double end);

  double length() const { return tip_.front - tip_.back; }
  /// Largest depth of the tip beyond a plane, m.
  double press() const { return tip_.press; }
  /// Distance of the surface from the camera on the ray that the tool follows at this time.
  double surface(double time) const;
  /// Pose of the tool with its tip at `distance` from the camera.
  Pose pose(double time, double distance) const;
  Vec3d direction(double time) const { return normalized(ray(time)); }
  /// Degree of pressing: 0 in free space, 1 pressed in.
  double pressed(double time) const;
  /// Time at which the slide begins, s.
  double arrival() const;
  /// Returns the largest speed of any point of the tool between two times if the distance stays the
  /// same, which is at most `farthest`: m/s.
  double sideways_speed(double begin, double end, double farthest) const;

 private:
  double slid(double time) const;
  Vec3d ray(double time) const;

  double end_, slide_ = 0, turn_ = 0;
  Vec3d first_ray_, last_ray_;
  DepthProfile first_depth_, last_depth_;
  Vec3d into_W_;
  Quaternion held_;
  Imprint tip_;
};

/// Returns the largest distances that are nowhere above `desired` and change by at most `steps[i]`
/// from i - 1 to i: where `desired` jumps, they turn in time.
std::vector<double> within_speed(std::vector<double> desired, const std::vector<double>& steps);

}}  // namespace palpate::v0
