// Scenes and tools of the study of frames, and their true forces. The quick form has a coarser
// camera and fewer spheres.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "eval/studies/accuracy.h"
#include "eval/studies/between_frames.h"

namespace palpate::eval {

/// Makes thesis Fig. 3.15a: a wall and a box move towards each other and back; or both stand still.
Result<Touch> touch_wall(Context& context, DepthNoise noise, bool moves);
/// Makes the scene moving-box along its path, with an octahedron and Kinect noise.
Result<Touch> touch_moving_box(Context& context);
/// Makes a recording of a hand-held camera, touched with the box; nullopt if the data are absent,
/// and in the quick form.
Result<std::optional<Touch>> touch_recording(Context& context);

/// Description of the scenes in one sentence.
extern const char* const kFrameScenesNote;

/// Force of the moving wall, -z, in shares of the whole tool's force.
class WallForces {
 public:
  WallForces() = default;
  static Result<WallForces> create(Context& context, const std::vector<Method>& methods);

  /// Returns the exact force on the volume that this method counts: its spheres or the tool.
  double exact(std::size_t method, double time) const;
  /// Returns the force by this method on a noise-free wall as it was `lag` s ago.
  double measured(std::size_t method, double time, double lag) const;

 private:
  std::shared_ptr<const Tool> tool_;
  std::vector<Method> methods_;
  std::vector<std::vector<double>> measured_;  ///< [method][distance from tool to wall]
};

}  // namespace palpate::eval
