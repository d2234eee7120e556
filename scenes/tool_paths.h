// How the default tools move.
#pragma once

#include "scenes/scene.h"
#include "scenes/truth.h"

namespace palpate { inline namespace v0 { namespace scenes {

/// A touch in words: approach, press, slide with a slow turn, withdraw.
struct Touch {
  /// X_WS at time t: origin on the touched surface, which may move; +z into the solid.
  Pose (*surface)(double t) = nullptr;
  Quaternion R_ST;          ///< how the tool is held
  Vec3d pivot;              ///< p_T, where the tool is held; what follows moves this point
  double reach = 0;         ///< m, from the pivot to the surface at first contact
  double depth = 0;         ///< m, pressed in from there
  double clearance = 0.06;  ///< m, before and after
  Vec3d slide;              ///< m in S, while pressed
  Vec3d eight;              ///< m in S, half width and half height of a figure of eight on top
  double turn = 0;          ///< rad about the slide's normal +z of S, while pressed
  double tilt = 0;          ///< rad about x of S, while pressed
};

/// Fills the default path over the duration of the scene.
void set_path(Scene& scene, const Touch& touch);
/// The straight way of the thesis, after a short approach.
void set_path(Scene& scene, const ThesisExperiment& experiment);

}}}  // namespace palpate::v0::scenes
