// Rigid objects beside what the camera sees: some stay where they are, some move.
#pragma once

#include <memory>
#include <optional>

#include "palpate/settings/setting_table.h"
#include "palpate/tool/tool.h"

namespace palpate {

/// A rigid object that the tool feels beside the cloud; the depth frames need not show it.
struct SceneObject {
  std::shared_ptr<const Tool> shape;
  Pose X_WB;                                      ///< where it stays, or begins
  std::optional<double> friction = std::nullopt;  ///< its own coefficient; none: as everything
  bool moves = false;
  double mass = 0;  ///< kg, of one that moves; 0: as wood has, 500 kg/m3
};

/// kg, of one that moves.
inline double mass_of(const SceneObject& object) {
  return object.mass > 0 ? object.mass : 500 * object.shape->mesh_mass().volume;
}

/// That move, in one run.
inline constexpr int kMostMovingBodies = 32;

/// Objects that move (docs/guide/moving-bodies.md).
struct BodyOptions {
  double gravity_x = 0, gravity_y = 9.81, gravity_z = 0;  ///< m/s2, in W
  double friction = 0.5;  ///< of bodies that have no coefficient of their own
  double damping = 0.2;   ///< 1/s, of all their motion
  double sink = 1e-4;     ///< m: how deep a cube lies in what carries it
  int num_spheres = 1000;
  bool may_sleep = true;
};
inline void add_settings(SettingTable& t, BodyOptions& o) {
  t.section("bodies");
  t.add("gravity_x", o.gravity_x, {-100, 100, "m/s2"},
        "of objects that move: which way and how strongly they fall, in the world");
  t.add("gravity_y", o.gravity_y, {-100, 100, "m/s2"},
        "the same; down in the image, as of a camera that is held level");
  t.add("gravity_z", o.gravity_z, {-100, 100, "m/s2"}, "the same; away from the camera");
  t.add("friction", o.friction, {0, 10},
        "of objects that move, with all but the tool; those with a coefficient of their own have "
        "that");
  t.add("damping", o.damping, {0, 100, "1/s"}, "share of its speed that an object loses by itself");
  t.add("sink", o.sink, {1e-6, 0.01, "m"},
        "how deep a cube at rest lies in what carries it: less is stiffer");
  t.add("spheres", o.num_spheres, {0, 1 << 30, "spheres"},
        "of an object that moves, the first ones, are asked by queries; 0: all");
  t.add("sleep", o.may_sleep, "objects at rest stand still until something changes");
}

}  // namespace palpate
