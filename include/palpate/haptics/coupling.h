// Between the hand's device and the simulated tool: what the tool does, and what the hand feels.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "palpate/haptics/device.h"
#include "palpate/haptics/local_contact.h"
#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"
#include "palpate/settings/setting_table.h"

namespace palpate::inline v0 {

// What a surface feels like beside its shape: friction, texture, damping.

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

enum class CouplingKind {
  virtual_coupling,  ///< a spring-damper between hand and a tool with mass: stable, the default
  direct,            ///< the tool is at the hand, which feels the contact itself (penalty)
  proxy,             ///< the tool has no mass and stays where contact and spring balance
  none,              ///< the tool is where the device has it, whatever it meets; nothing is felt
};
constexpr auto names_of(CouplingKind) { return std::array{"virtual", "direct", "proxy", "none"}; }

/// How contact between queries is known.
enum class ContactHold {
  local_model,    ///< wrench and stiffness of the last query
  interpolation,  ///< from the last wrench to the newest one, as the thesis does
};
constexpr auto names_of(ContactHold) { return std::array{"local_model", "interpolation"}; }

struct CouplingOptions {
  CouplingKind kind = CouplingKind::virtual_coupling;
  ContactHold hold = ContactHold::local_model;
  /// 0: as much as the device allows and the passivity bound K < 2 b / T leaves.
  double stiffness = 0;          ///< N/m
  double angular_stiffness = 0;  ///< N m/rad
  double damping_ratio = 1;      ///< of the coupling, 1: critical
  double tool_mass = 0.1;        ///< kg; the inertia goes with it
  double force_at_eighth = 0;    ///< N at an eighth of the tool's volume; 0: the device's largest
  double motion_scale = 1;       ///< metres of tool per metre of hand
  bool clutch = false;           ///< the hand has let go: it moves, the tool stays, nothing is felt
  int clutch_button = 0;         ///< that lets go while it is held, counted from 1; 0: none
  /// m to either side of the middle of X_WB, along its axes: how far the origin of the held tool
  /// goes. 0: as far as it likes.
  double workspace_x = 0, workspace_y = 0, workspace_z = 0;
  Pose X_WB;  ///< where the device's base is in the scene
  Pose X_HT;  ///< where the tool is in the hand
  FrictionOptions friction;
  TextureOptions texture;
};
inline void add_settings(SettingTable& t, CouplingOptions& o) {
  t.section("coupling");
  t.add("kind", o.kind, "what joins hand and tool");
  t.add("hold", o.hold, "how contact between queries is known");
  t.add("stiffness", o.stiffness, {0, 1e6, "N/m"}, "0: as much as device and passivity allow");
  t.add("angular_stiffness", o.angular_stiffness, {0, 1e4, "N m/rad"},
        "0: as much as device and passivity allow");
  t.add("damping_ratio", o.damping_ratio, {0, 100}, "of the spring; 1: critical");
  t.add("tool_mass", o.tool_mass, {1e-4, 1e3, "kg"}, "of the simulated tool");
  t.add("force_at_eighth", o.force_at_eighth, {0, 1e4, "N"},
        "at an eighth of the tool's volume; 0: the device's largest");
  t.add("motion_scale", o.motion_scale, {1e-4, 1e4}, "metres of tool per metre of hand");
  t.add("clutch", o.clutch, "the hand has let go: it moves, the tool stays, and nothing is felt");
  t.add("clutch_button", o.clutch_button, {0, 32},
        "of the device, that lets go while it is held, counted from 1; 0: none");
  for (const auto& [name, half] : {std::pair{"workspace_x", &o.workspace_x},
                                   {"workspace_y", &o.workspace_y},
                                   {"workspace_z", &o.workspace_z}}) {
    t.add(name, *half, {0, 100, "m"},
          "how far the tool goes to either side of base_in_scene, along its axis; 0: as far as it "
          "likes");
  }
  t.add("base_in_scene", o.X_WB,
        "X_WB: x y z in m, quaternion x y z w; identity: left out, poses are those of the device");
  t.add("tool_in_hand", o.X_HT, "X_HT: x y z in m, quaternion x y z w");
  add_settings(t, o.friction);
  add_settings(t, o.texture);
}

/// The options that result for a device, its tick and a tool of this shape, with the zeros filled
/// in, and one sentence for each that was lowered or is not passive (K >= 2 b / T), saying by how
/// much and what to do. Errors: numbers out of range or not finite.
struct CheckedCoupling {
  CouplingOptions options;
  std::vector<std::string> warnings;
};
Result<CheckedCoupling> check_coupling(const CouplingOptions& options, const DeviceLimits& limits,
                                       double tick_seconds, const MassProperties& tool);

/// After one tick.
struct CouplingStep {
  Wrench F_H_B;        ///< what the hand feels, before the safety filter: at the handle, in B
  Pose X_WT;           ///< of the simulated tool
  Pose X_WT_hand;      ///< where the hand holds it: apart from X_WT in contact
  Wrench contact_W;    ///< contact and friction on the tool, about its centre of mass
  double stretch = 0;  ///< m, between the two
  double energy = 0;   ///< J, in the spring
};

/// How a coupling stands after a tick.
struct CouplingState {
  Pose X_BH;       ///< the last usable one of the handle
  Pose X_WT_hand;  ///< where the hand holds the tool
  Pose X_WT;       ///< where the simulated tool is
  Twist V_WT;      ///< of its centre of mass, in W
  FrictionState friction;
};

/// One state per loop. No allocation, no throw.
class Coupling {
 public:
  virtual ~Coupling() = default;
  /// The tool goes to the hand, at rest.
  virtual void reset(const DeviceState& state) noexcept = 0;
  /// Instead: the tool goes on from where another coupling had it, of whatever kind, and the hand
  /// holds it where it did, also if motions are scaled differently.
  virtual void take_over(const CouplingState& state) noexcept = 0;
  virtual CouplingState state() const noexcept = 0;
  virtual CouplingStep step(const DeviceState& state, const LocalContact& contact,
                            double dt) noexcept = 0;
  /// All that it knows of the ticks before, for another one with the same options.
  virtual void remember(StateNumbers& numbers) noexcept = 0;
  /// Whether the device is given a wrench at all.
  virtual bool is_felt() const noexcept { return true; }
};

/// Where a tool without coupling is; a state that is not usable leaves it at the base.
Pose prescribed_pose(const CouplingOptions& options, const DeviceState& state) noexcept;

/// The other way: the handle X_BH that holds the tool at X_WT, of a hand whose motion scale was
/// never changed. Identical where nothing is between the two.
Pose handle_at(const CouplingOptions& options, const Pose& X_WT) noexcept;

/// `options` are checked ones.
std::unique_ptr<Coupling> make_coupling(const CouplingOptions& options, const DeviceLimits& limits,
                                        const MassProperties& tool);

}  // namespace palpate::inline v0
