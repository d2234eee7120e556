// What a part of the hand's side remembers between two ticks, as numbers: written down, a recording
// can begin anywhere, and a repetition with it.
#pragma once

#include <array>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <span>
#include <type_traits>

#include "palpate/haptics/local_contact.h"

namespace palpate {

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
    constexpr double kWhole = 9007199254740992;  // 2^53
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
  void one(LocalContact& c) {
    (*this)(c.time, c.X_WT, c.p_WC, c.F_C_W, c.stiffness.m, c.patch.lever_W, c.patch.torsion_radius,
            c.patch.share, c.patch.own_friction, c.volume, c.max_stiffness, c.surface_age,
            c.status.bits, c.is_valid);
  }

  std::array<double, kMost> numbers_{};
  std::size_t end_ = 0, at_ = 0;
  bool is_saving_ = true, is_good_ = true;
};

}  // namespace palpate
