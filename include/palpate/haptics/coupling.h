// Couplings between the device and the simulated tool: motion of the tool, force on the hand.
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

namespace palpate { inline namespace v0 {

// Surface properties in addition to shape: friction, texture, damping.

/// Coulomb friction of the whole contact patch, with true sticking (docs/guide/materials.md).
struct FrictionOptions {
  /// Tangential force over normal force while sliding. 0: no friction.
  double coefficient = 0;
  double static_ratio = 1;     ///< static over kinetic friction
  double viscous = 0;          ///< s/m: adds a tangential force of this times N v
  double stiffness = 0;        ///< N/m, of the sticking contact; 0: fits the coupling
  double contact_damping = 0;  ///< s/m: approaching at v it pushes 1 + this times v as much
};
inline void add_settings(SettingTable& t, FrictionOptions& o) {
  t.section("friction");
  t.add("coefficient", o.coefficient, {0, 10},
        "kinetic friction: tangential over normal force; 0: no friction");
  t.add("static_ratio", o.static_ratio, {1, 10}, "static over kinetic friction");
  t.add("viscous", o.viscous, {0, 100, "s/m"},
        "viscous friction: this times normal force times sliding speed");
  t.add("stiffness", o.stiffness, {0, 1e6, "N/m"},
        "of the sticking contact; 0: 10 times the coupling's stiffness, with direct: "
        "the same");
  t.add("contact_damping", o.contact_damping, {0, 100, "s/m"},
        "the contact force grows by 1 + this times the approach speed, and shrinks "
        "when leaving");
}

/// Pattern of the texture.
enum class TextureKind {
  none,
  ridges,  ///< regular waves
  grain,   ///< irregular waves of several sizes
};
constexpr auto names_of(TextureKind) { return std::array{"none", "ridges", "grain"}; }

/// Friction that varies with the distance slid. It always dissipates energy.
struct TextureOptions {
  TextureKind kind = TextureKind::none;
  double depth = 0.3;      ///< amplitude, as a share of the friction
  double length = 2e-3;    ///< m, wavelength; for grain the longest
  double bandwidth = 200;  ///< Hz: faster texture is suppressed; at most a fifth of the tick rate
};
inline void add_settings(SettingTable& t, TextureOptions& o) {
  t.section("texture");
  t.add("kind", o.kind, "pattern of the texture; needs friction");
  t.add("depth", o.depth, {0, 1}, "amplitude, as a share of the friction");
  t.add("length", o.length, {1e-5, 1, "m"}, "wavelength; for grain the longest");
  t.add("bandwidth", o.bandwidth, {1, 10000, "Hz"},
        "faster texture is suppressed; at most a fifth of the tick rate");
}

/// State of friction between ticks.
struct FrictionState {
  /// Deflection of the sticking contact: along the surface in W, and about its normal times the
  /// torsion radius. m
  Vec3d bristle_W;
  double bristle_rotation = 0;
  Vec3d normal_W;       ///< of the surface; zero: no contact
  double distance = 0;  ///< m slid, for texture
  double speed = 0;     ///< m/s, of sliding
  bool is_sliding = false;
};

enum class CouplingKind {
  virtual_coupling,  ///< a spring-damper between the hand and a tool with mass: stable, the default
  direct,            ///< the tool is at the hand, which feels the contact force itself (penalty)
  proxy,             ///< a massless tool where contact and spring are in balance
  none,              ///< the tool follows the device, without force output
};
constexpr auto names_of(CouplingKind) { return std::array{"virtual", "direct", "proxy", "none"}; }

/// Model of the contact between two queries.
enum class ContactHold {
  local_model,    ///< wrench and stiffness of the last query
  interpolation,  ///< blend from the last wrench to the newest one, as in the thesis
};
constexpr auto names_of(ContactHold) { return std::array{"local_model", "interpolation"}; }

/// Options of the coupling between device and tool, its friction and its workspace.
struct CouplingOptions {
  CouplingKind kind = CouplingKind::virtual_coupling;
  ContactHold hold = ContactHold::local_model;
  /// 0: the largest value that the device and the passivity bound K < 2 b / T allow, with the
  /// damping b of the device and of the coupling together.
  double stiffness = 0;          ///< N/m
  double angular_stiffness = 0;  ///< N m/rad
  double damping_ratio = 1;      ///< of the coupling, 1: critical
  double tool_mass = 0.1;        ///< kg; the inertia scales with it
  double force_at_eighth = 0;    ///< N at an eighth of the tool's volume; 0: the device's maximum
  double motion_scale = 1;       ///< meters of tool per meter of hand
  bool clutch = false;           ///< released: the hand moves without the tool and without force
  int clutch_button = 0;         ///< releases the tool while held, counted from 1; 0: none
  /// m: range of the origin of the held tool to either side of the origin of X_WB, along its axes.
  /// 0: unlimited.
  double workspace_x = 0, workspace_y = 0, workspace_z = 0;
  /// N/m, of the walls of that range. No setting: check_coupling fills it in.
  double wall_stiffness = 0;
  Pose X_WB;  ///< pose of the device's base in the scene
  Pose X_HT;  ///< pose of the tool in the hand
  FrictionOptions friction;
  TextureOptions texture;
};
inline void add_settings(SettingTable& t, CouplingOptions& o) {
  t.section("coupling");
  t.add("kind", o.kind, "coupling between hand and tool");
  t.add("hold", o.hold, "contact model between two queries");
  t.add("stiffness", o.stiffness, {0, 1e6, "N/m"}, "0: as large as device and passivity allow");
  t.add("angular_stiffness", o.angular_stiffness, {0, 1e4, "N m/rad"},
        "0: as large as device and passivity allow");
  t.add("damping_ratio", o.damping_ratio, {0, 100}, "of the spring; 1: critical");
  t.add("tool_mass", o.tool_mass, {1e-4, 1e3, "kg"}, "of the simulated tool");
  t.add("force_at_eighth", o.force_at_eighth, {0, 1e4, "N"},
        "force at an eighth of the tool's volume; 0: the device's maximum");
  t.add("motion_scale", o.motion_scale, {1e-4, 1e4}, "meters of tool per meter of hand");
  t.add("clutch", o.clutch, "released: the hand moves without the tool and without force");
  t.add("clutch_button", o.clutch_button, {0, 32},
        "device button that releases the tool while held, counted from 1; 0: none");
  for (const auto& [name, half] : {std::pair{"workspace_x", &o.workspace_x},
                                   {"workspace_y", &o.workspace_y},
                                   {"workspace_z", &o.workspace_z}}) {
    t.add(name, *half, {0, 100, "m"},
          "range of the tool to either side of base_in_scene, along this axis; 0: "
          "unlimited");
  }
  t.add("base_in_scene", o.X_WB,
        "X_WB: x y z in m, quaternion x y z w; if left out, the run chooses; identity: "
        "device poses");
  t.add("tool_in_hand", o.X_HT, "X_HT: x y z in m, quaternion x y z w");
  add_settings(t, o.friction);
  add_settings(t, o.texture);
}

/// Options for a device, its tick time and a tool, with defaults instead of zeros, and one warning
/// for each value that was lowered or is not passive (K >= 2 b / T), which says by how much and
/// what to do. Errors: numbers out of range or not finite.
struct CheckedCoupling {
  CouplingOptions options;
  std::vector<std::string> warnings;
};
Result<CheckedCoupling> check_coupling(const CouplingOptions& options, const DeviceLimits& limits,
                                       double tick_seconds, const MassProperties& tool);

/// Result of one tick.
struct CouplingStep {
  Wrench F_H_B;              ///< on the hand, before the safety filter: at the handle, in B
  Pose X_WT;                 ///< pose of the simulated tool
  Pose X_WT_hand;            ///< the hand's pose of the tool: differs from X_WT in contact
  Wrench contact_W;          ///< contact and friction on the tool, about its center of mass
  double stretch = 0;        ///< m, between the two poses
  double energy = 0;         ///< J, stored in the spring
  double stored = 0;         ///< J, that the hand may get back: `energy`, and the energy of the
                             ///< tool's motion, contact, sticking friction, and workspace walls
  bool is_clutched = false;  ///< the clutch: the hand moves without the tool
};

/// State of a coupling after a tick.
struct CouplingState {
  Pose X_BH;       ///< of the handle; extrapolated in a tick without a usable state
  Pose X_WT_hand;  ///< the hand's pose of the tool
  Pose X_WT;       ///< pose of the simulated tool
  Twist V_WT;      ///< of its center of mass, in W
  FrictionState friction;
};

/// Base class of couplings. One state per loop. No allocation, no throw.
class Coupling {
 public:
  virtual ~Coupling() = default;
  /// Places the tool at the hand, at rest.
  virtual void reset(const DeviceState& state) noexcept = 0;
  /// Alternative to reset: continues from the state of another coupling of any kind. The hand keeps
  /// its pose of the tool, even if the motion scale differs.
  virtual void take_over(const CouplingState& state) noexcept = 0;
  /// The state that another coupling can take over.
  virtual CouplingState state() const noexcept = 0;
  virtual CouplingStep step(const DeviceState& state, const LocalContact& contact,
                            double dt) noexcept = 0;
  /// Returns the pose at which a hand in this state would hold the tool, without a step.
  virtual Pose held_pose(const DeviceState& state) const noexcept = 0;
  /// True if the device gets a wrench at all.
  virtual bool drives_device() const noexcept { return true; }
};

/// The handle pose X_BH that holds the tool at X_WT, if the motion scale never changed. Exact if
/// both frames are identical.
Pose handle_at(const CouplingOptions& options, const Pose& X_WT) noexcept;

/// `options` must come from check_coupling.
std::unique_ptr<Coupling> make_coupling(const CouplingOptions& options, const DeviceLimits& limits,
                                        const MassProperties& tool);

}}  // namespace palpate::v0
