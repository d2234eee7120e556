// A contact as the hand's side of a run sees it, and what that side remembers between two ticks.
#pragma once

#include <array>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <type_traits>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/mesh/mesh.h"

namespace palpate::inline v0 {

// Where and how wide a contact is, and what is there: what friction acts on.

/// What a surface is made of, where it has a material of its own.
struct Material {
  double friction = 0;      ///< force along the surface over the force into it, while it slides
  double static_ratio = 1;  ///< what sticks holds so many times as much
  double viscous = 0;       ///< s/m: force along the surface grows by this times N v
  /// Texture: shares of the friction by which it goes up and down with even waves, and with
  /// irregular ones.
  double ridges = 0, grain = 0;

  friend bool operator==(const Material&, const Material&) = default;
};

/// Materials by region of a camera's image: a label for each pixel, and what some labels are made
/// of. What has no material is as the settings say.
struct MaterialRegions {
  int width = 0, height = 0;
  std::vector<std::uint8_t> labels;                ///< row-major, width * height; empty: none
  std::vector<std::optional<Material>> materials;  ///< by label
};

/// What a contact touches that friction should know of, in shares of the normal force.
struct Ground {
  double share = 0;  ///< on regions with a material of their own; of the rest, see ContactPatch
  /// Of these, times their shares: coefficients while they slide and while they stick, ...
  double friction = 0, static_friction = 0;
  double viscous = 0;            ///< s/m
  double ridges = 0, grain = 0;  ///< coefficients by which texture goes up and down
  /// How the surface moves by itself: under the middle of the contact, m/s, and rad/s.
  Vec3d velocity_W, turning_W;

  friend bool operator==(const Ground&, const Ground&) = default;
};

struct ContactPatch {
  Vec3d lever_W;  ///< from the tool's centre of mass to the middle of the contact, m
  /// How far from there the normal force is on average, m: what slides by turning about the normal
  /// resists with mu N times this.
  double torsion_radius = 0;
  /// Of the normal force: what is felt with the friction of the settings ...
  double share = 1;
  /// ... and mean coefficient of the rest, which is on objects with one of their own, times its
  /// share.
  double own_friction = 0;
  Ground ground;
};

/// Of a contact with a surface, from the moments of its volume. Exact for parallel normals and, in
/// its torsion radius, for a patch that is an ellipse of even pressure; a rectangle is off by 2 %.
ContactPatch contact_patch(const VolumeWrench& measure_W, double volume, const Stiffness& stiffness,
                           const VolumeMoments& moments);

/// Where no moments are known: the middle from the wrench, as far out as a tool of this inertia
/// reaches, and a round cap of that volume. `tool` is in T.
ContactPatch guessed_patch(const VolumeWrench& measure_W, double volume, const MassProperties& tool,
                           const Quaternion& q_WT);

/// Two contacts of the same tool as one, in shares of their forces `force_a` and `force_b`, N.
ContactPatch joined(const ContactPatch& a, double force_a, const ContactPatch& b, double force_b);

// What the last contact query said, as far as it holds around its pose: lets the hand be served at
// several kilohertz, however long a query takes.

/// Contact wrench on the tool at one pose, in newtons, and how it changes around it.
struct LocalContact {
  double time = 0;  ///< s, monotonic clock: of the device state that was measured
  Pose X_WT;
  Vec3d p_WC;                ///< the tool's centre of mass: the wrench is about it
  Wrench F_C_W;              ///< N, N m
  Stiffness stiffness;       ///< N/m, N, N m: see Stiffness, times the gain
  ContactPatch patch;        ///< of the query that the stiffness is of
  double volume = 0;         ///< m3
  double max_stiffness = 0;  ///< N/m: largest eigenvalue of the force-translation block, 0 or more
  double surface_age = 0;    ///< s, of the depth frame that was measured, at `time`
  ContactStatus status;
  bool is_valid = false;  ///< false: nothing has been measured yet

  /// The wrench with the tool at another pose near by, about its own centre of mass there:
  /// F - K (shift, turn). It never pulls the tool in: where the line crosses zero along the
  /// measured direction, it stays zero.
  Wrench at(const Pose& X_WT_now) const;
};

VolumeStiffness thesis_volume_stiffness(double max_force, double tool_volume);

/// `measure_W` and `stiffness` in m3 ... as a contact of that scale.
LocalContact local_contact(const Penetration& penetration, const Stiffness& stiffness,
                           const Pose& X_WT, const Vec3d& centre_of_mass_T,
                           const VolumeStiffness& scale, double time, double surface_age,
                           const ContactPatch& patch = {});

// What a part of the hand's side remembers between two ticks, as numbers: written down, a recording
// can begin anywhere, and a repetition with it.

/// Each class has one function `remember(StateNumbers&)` that names its members, which saves them
/// or takes them back, in the same order. No allocation. What is taken back may come from a file:
/// numbers that a member cannot have make it bad.
class StateNumbers {
 public:
  static constexpr std::size_t kMost = 320;

  /// Saves.
  StateNumbers() = default;
  /// Takes back what another one saved.
  explicit StateNumbers(std::span<const double> saved) : is_saving_(false) {
    is_good_ = saved.size() <= kMost;
    for (const double number : saved.first(is_good_ ? saved.size() : 0)) {
      numbers_[end_++] = number;
    }
  }

  bool is_saving() const { return is_saving_; }
  std::span<const double> numbers() const { return {numbers_.data(), end_}; }
  /// Saved: all had room. Taken back: all numbers were there, and none is left.
  bool is_good() const { return is_good_ && (is_saving_ || at_ == end_); }

  template <class... Members>
  void operator()(Members&... members) {
    (one(members), ...);
  }

 private:
  void fail() { is_good_ = false; }

  void one(double& value) {
    if (is_saving_) {
      if (end_ == kMost) return fail();
      numbers_[end_++] = value;
    } else {
      if (at_ == end_) return fail();
      value = numbers_[at_++];
    }
  }
  template <class T>
  requires std::integral<T> || std::is_enum_v<T>
  void one(T& value) {
    static constexpr double kWhole = 9007199254740992;  // 2^53
    const auto limit = [] {
      if constexpr (std::same_as<T, bool>) return 1.0;
      if constexpr (std::is_enum_v<T>) return static_cast<double>(names_of(T{}).size() - 1);
      return kWhole;
    }();
    double number = is_saving_ ? static_cast<double>(value) : 0;
    one(number);
    if (is_saving_) return;
    const bool is_there = number >= 0 && number <= limit && number == std::floor(number);
    if (!is_there) return fail();
    value = static_cast<T>(static_cast<std::uint64_t>(number));
  }
  void one(Vec3d& v) { (*this)(v.x, v.y, v.z); }
  void one(Quaternion& q) { (*this)(q.x, q.y, q.z, q.w); }
  void one(Pose& X) { (*this)(X.translation, X.rotation); }
  void one(Wrench& F) { (*this)(F.force, F.torque); }
  void one(Twist& V) { (*this)(V.linear, V.angular); }
  template <class T>
  requires requires(T& t, StateNumbers& numbers) { t.remember(numbers); }
  void one(T& part) { part.remember(*this); }
  void one(double (&matrix)[6][6]) {
    for (auto& row : matrix) {
      for (double& number : row) one(number);
    }
  }
  /// But for the ground, of which nobody asks again: each tick brings its own contact.
  void one(LocalContact& c) {
    (*this)(c.time, c.X_WT, c.p_WC, c.F_C_W, c.stiffness.m, c.patch.lever_W, c.patch.torsion_radius,
            c.patch.share, c.patch.own_friction, c.volume, c.max_stiffness, c.surface_age,
            c.status.bits, c.is_valid);
  }

  std::array<double, kMost> numbers_{};
  std::size_t end_ = 0, at_ = 0;
  bool is_saving_ = true, is_good_ = true;
};

}  // namespace palpate::inline v0
