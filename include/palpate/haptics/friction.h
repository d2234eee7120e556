// What a surface feels like beside its shape: friction, texture, damping.
#pragma once

#include <array>

#include "palpate/math/vec3.h"
#include "palpate/settings/setting_table.h"

namespace palpate {

/// Coulomb friction of the whole contact patch, which really sticks (docs/guide/materials.md).
struct FrictionOptions {
  /// Force along the surface over the force into it, while it slides. 0: none.
  double coefficient = 0;
  double static_ratio = 1;     ///< what sticks holds so many times as much
  double viscous = 0;          ///< s/m: force along the surface grows by this times N v
  double stiffness = 0;        ///< N/m, of what sticks; 0: as fits the coupling
  double contact_damping = 0;  ///< s/m: approaching at v it pushes 1 + this times v as much
};
inline void add_settings(SettingTable& t, FrictionOptions& o) {
  t.section("friction");
  t.add("coefficient", o.coefficient, {0, 10},
        "force along the surface over the force into it, while it slides; 0: no friction");
  t.add("static_ratio", o.static_ratio, {1, 10}, "what sticks holds so many times as much");
  t.add("viscous", o.viscous, {0, 100, "s/m"},
        "force along the surface that grows with speed: times the force into it and the speed");
  t.add("stiffness", o.stiffness, {0, 1e6, "N/m"},
        "how little gives way what sticks; 0: 10 times the coupling's stiffness, direct: as much");
  t.add("contact_damping", o.contact_damping, {0, 100, "s/m"},
        "approaching at a speed, the contact pushes 1 + this times the speed as much, and leaving "
        "the less");
}

/// What sliding meets on its way.
enum class TextureKind {
  none,
  ridges,  ///< even waves
  grain,   ///< irregular, of several sizes
};
constexpr auto names_of(TextureKind) { return std::array{"none", "ridges", "grain"}; }

/// Friction that goes up and down with the way slid: it takes energy whatever it does.
struct TextureOptions {
  TextureKind kind = TextureKind::none;
  double depth = 0.3;      ///< share of the friction by which it goes up and down
  double length = 2e-3;    ///< m, from ridge to ridge; of grain the longest
  double bandwidth = 200;  ///< Hz: what comes faster is left out; at most a fifth of the ticks
};
inline void add_settings(SettingTable& t, TextureOptions& o) {
  t.section("texture");
  t.add("kind", o.kind, "what sliding meets on its way; needs friction");
  t.add("depth", o.depth, {0, 1}, "share of the friction by which it goes up and down");
  t.add("length", o.length, {1e-5, 1, "m"}, "from ridge to ridge; of grain the longest");
  t.add("bandwidth", o.bandwidth, {1, 10000, "Hz"},
        "ridges that come faster are left out; at most a fifth of the ticks");
}

/// What friction knows of the ticks before.
struct FrictionState {
  /// How far what sticks has given way: along the surface in W, and about its normal times the
  /// torsion radius. m
  Vec3d bristle_W;
  double bristle_turn = 0;
  Vec3d normal_W;       ///< of the surface; zero: nothing was touched
  double distance = 0;  ///< m slid, for texture
  double speed = 0;     ///< m/s, of sliding
  bool is_sliding = false;
};

}  // namespace palpate
