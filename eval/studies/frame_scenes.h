// What the study of frames touches, with what, and how large the force is then. The quick form has
// a coarser camera and fewer spheres.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "eval/studies/accuracy.h"
#include "eval/studies/between_frames.h"

namespace palpate::eval {

/// Thesis Fig. 3.15a: a wall and a box move towards each other and back; or both stand still.
Result<Touch> touch_wall(Context& context, DepthNoise noise, bool moves);
/// The scene moving-box along its path, with an octahedron and Kinect noise.
Result<Touch> touch_moving_box(Context& context);
/// What a camera in the hand recorded, touched with the box; nullopt if the data are not there,
/// and in the quick form.
Result<std::optional<Touch>> touch_recording(Context& context);

/// How they are touched, one sentence for humans.
extern const char* const kFrameScenesNote;

/// The force of the moving wall, -z, in shares of the whole tool's.
class WallForces {
 public:
  WallForces() = default;
  static Result<WallForces> create(Context& context, const std::vector<Method>& methods);

  /// Of what this method counts: its spheres, or the tool itself.
  double exact(std::size_t method, double time) const;
  /// What this method measures on a noise-free wall that is seen as it was `lag` s ago.
  double measured(std::size_t method, double time, double lag) const;

 private:
  std::shared_ptr<const Tool> tool_;
  std::vector<Method> methods_;
  std::vector<std::vector<double>> measured_;  ///< [method][how far the tool is in]
};

}  // namespace palpate::eval
