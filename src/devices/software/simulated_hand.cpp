#include "src/devices/software/simulated_hand.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "src/devices/internal/twist_between.h"

namespace palpate { inline namespace v0 {
namespace {

using Matrix3 = std::array<std::array<double, 3>, 3>;

Matrix3 operator*(const Matrix3& a, const Matrix3& b) {
  Matrix3 product{};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k < 3; ++k) product[i][j] += a[i][k] * b[k][j];
  return product;
}

/// Matrix exponential by scaling and squaring: Taylor series of 2^-n times the matrix.
Matrix3 exponential(Matrix3 a) {
  double size = 0;
  for (const auto& row : a)
    for (const double value : row) size += std::abs(value);
  const int num_squarings = size > 0.25 ? std::ilogb(size) + 3 : 0;
  for (auto& row : a)
    for (double& value : row) value = std::ldexp(value, -num_squarings);
  Matrix3 sum{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}, term = sum;
  for (int n = 1; n <= 14; ++n) {
    term = term * a;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        term[i][j] /= n;
        sum[i][j] += term[i][j];
      }
    }
  }
  for (int i = 0; i < num_squarings; ++i) sum = sum * sum;
  return sum;
}

}  // namespace

ImpedanceStep::ImpedanceStep(double mass, double damping, double stiffness, double seconds) {
  // The acceleration is carried along as a third, constant state. Time in steps.
  const double h = seconds;
  const Matrix3 step =
      exponential({{{0, 1, 0}, {-h * h * stiffness / mass, -h * damping / mass, 1}, {0, 0, 0}}});
  // From rates per step to rates per second.
  for (int i = 0; i < 2; ++i) {
    const double unit = i == 0 ? 1 : 1 / h;
    m_[i][0] = step[i][0] * unit;
    m_[i][1] = step[i][1] * h * unit;
    m_[i][2] = step[i][2] * h * h * unit;
  }
}

void ImpedanceStep::operator()(Vec3d& stretch, Vec3d& rate, const Vec3d& acceleration) const {
  const Vec3d before = stretch;
  stretch = m_[0][0] * before + m_[0][1] * rate + m_[0][2] * acceleration;
  rate = m_[1][0] * before + m_[1][1] * rate + m_[1][2] * acceleration;
}

SimulatedHand::SimulatedHand(const DeviceModel& model, const HandModel& hand, HandTarget target,
                             double tick_seconds)
    : model_(model),
      hand_(hand),
      target_(std::move(target)),
      tick_seconds_(tick_seconds),
      linear_(model.moving_mass + hand.mass, model.limits.damping + hand.damping, hand.stiffness,
              tick_seconds / kSubSteps),
      angular_(hand.angular_inertia, model.limits.angular_damping + hand.angular_damping,
               hand.angular_stiffness, tick_seconds / kSubSteps) {
  reset();
}

Pose SimulatedHand::target_at(double tick) const {
  if (!target_) return {};
  const Pose X_BTarget = target_(tick * tick_seconds_);
  return is_finite(X_BTarget) ? X_BTarget : X_BTarget_;
}

void SimulatedHand::reset() {
  num_ticks_ = 0;
  X_BTarget_ = {};
  X_BTarget_ = X_BH_ = target_at(0);
  V_BH_ = {};
  energy_given_ = 0;
}

void SimulatedHand::advance(const Wrench& F_H_B) {
  const Pose X_BNext = target_at(++num_ticks_);
  const Twist V_BTarget = twist_between(X_BTarget_, X_BNext, tick_seconds_);
  for (int i = 0; i < kSubSteps; ++i)
    move(F_H_B, moved(X_BTarget_, V_BTarget, i * tick_seconds_ / kSubSteps), V_BTarget);
  X_BTarget_ = X_BNext;
}

void SimulatedHand::move(const Wrench& F_H_B, const Pose& X_BTarget, const Twist& V_BTarget) {
  const double seconds = tick_seconds_ / kSubSteps;
  const auto& limits = model_.limits;

  // As seen from the target, which moves steadily: the mechanism's damper drags by its own
  // velocity.
  Vec3d stretch = X_BH_.translation - X_BTarget.translation;
  Vec3d rate = V_BH_.linear - V_BTarget.linear;
  linear_(stretch, rate,
          (F_H_B.force - limits.damping * V_BTarget.linear) / (model_.moving_mass + hand_.mass));
  Vec3d p_B = X_BTarget.translation + V_BTarget.linear * seconds + stretch;
  V_BH_.linear = V_BTarget.linear + rate;
  if (const double distance = norm(p_B); distance > limits.workspace_radius) {
    const Vec3d out_B = p_B / distance;
    p_B = limits.workspace_radius * out_B;
    V_BH_.linear -= std::max(0.0, dot(V_BH_.linear, out_B)) * out_B;
  }
  energy_given_ += dot(F_H_B.force, p_B - X_BH_.translation);
  X_BH_.translation = p_B;

  const Vec3d twist_before = rotation_vector(X_BH_.rotation * conjugate(X_BTarget.rotation));
  Vec3d twist = twist_before;
  rate = V_BH_.angular - V_BTarget.angular;
  angular_(twist, rate,
           (F_H_B.torque - limits.angular_damping * V_BTarget.angular) / hand_.angular_inertia);
  const Vec3d turn = twist - twist_before + V_BTarget.angular * seconds;
  V_BH_.angular = V_BTarget.angular + rate;
  energy_given_ += dot(F_H_B.torque, turn);
  X_BH_.rotation = normalized(rotation_by(turn) * X_BH_.rotation);
}

HandTarget exploring_hand(double workspace_radius) {
  return [workspace_radius](double time) -> Pose {
    constexpr double kTurn = 2 * std::numbers::pi;
    const double depth = -0.6 * std::cos(kTurn * time / 8);
    const double circle = 0.3 * std::min(1.0, time / 2);  // widens, so that it begins at rest
    const double angle = kTurn * time / 3;
    const Vec3d p_B = Vec3d{circle * std::cos(angle), circle * std::sin(angle), depth};
    return {workspace_radius * p_B, rotation_by({0.15 * std::sin(kTurn * time / 5), 0, 0})};
  };
}

}}  // namespace palpate::v0
