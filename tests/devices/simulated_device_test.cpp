#include "palpate/devices/devices.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "src/devices/device_kinds.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

/// A handle of 50 g with strong motors in a wide workspace, nothing else.
SimulatedDeviceOptions bare_handle() {
  SimulatedDeviceOptions options;
  options.model = {"bare", "bare handle", {}, 0.05};
  options.model.limits.max_force = 1e4;
  options.model.limits.max_torque = 1e3;
  options.model.limits.workspace_radius = 10;
  options.hand = {.mass = 0,
                  .damping = 0,
                  .stiffness = 0,
                  .angular_inertia = 2e-4,
                  .angular_damping = 0,
                  .angular_stiffness = 0};
  options.velocity_filter = 0;
  options.in_real_time = false;
  return options;
}

std::unique_ptr<SimulatedDevice> make(const SimulatedDeviceOptions& options) {
  auto device = SimulatedDevice::create(options);
  EXPECT_TRUE(device.has_value()) << device.error().message;
  return std::move(*device);
}

void start(SimulatedDevice& device, DeviceTick tick) {
  ASSERT_TRUE(device.start(std::move(tick)).has_value());
}

/// Angle of a rotation about x.
double angle_x(const Quaternion& q) { return 2 * std::atan2(q.x, q.w); }

/// Response of m x'' + b x' + k x = f from rest, k > 0.
double step_response(double m, double b, double k, double f, double t) {
  const double decay = b / (2 * m), square = k / m - decay * decay;
  if (square > 0) {
    const double w = std::sqrt(square);
    return f / k * (1 - std::exp(-decay * t) * (std::cos(w * t) + decay / w * std::sin(w * t)));
  }
  const double s = std::sqrt(-square), fast = -decay - s, slow = -decay + s;
  return f / k * (1 + (slow * std::exp(fast * t) - fast * std::exp(slow * t)) / (fast - slow));
}

TEST(SimulatedDevice, AnswersAConstantWrenchAsTheClosedFormSays) {
  for (const double damping : {0.0, 0.4, 3.0, 40.0}) {  // none, under-damped, about critical, over
    SCOPED_TRACE(damping);
    SimulatedDeviceOptions options = bare_handle();
    options.model.limits.damping = 0.3 * damping;
    options.model.limits.angular_damping = 0.3e-3 * damping;
    options.hand.mass = 0.1;
    options.hand.damping = 0.7 * damping;
    options.hand.stiffness = 20;
    options.hand.angular_damping = 0.7e-3 * damping;
    options.hand.angular_stiffness = 0.5;
    const auto device = make(options);
    start(*device, [](const DeviceState&) { return Wrench{{0, 0.8, 0}, {0.05, 0, 0}}; });
    for (int i = 0; i < 40; ++i) {
      device->run(25);
      const DeviceState state = device->true_state();
      const double y = step_response(0.15, damping, 20, 0.8, state.time);
      const double turn = step_response(2e-4, 1e-3 * damping, 0.5, 0.05, state.time);
      EXPECT_NEAR(state.X_BH.translation.y, y, 1e-12);
      EXPECT_NEAR(angle_x(state.X_BH.rotation), turn, 1e-10);
      EXPECT_NEAR(device->energy_given(), 0.8 * y + 0.05 * turn, 1e-11);
    }
  }
}

TEST(SimulatedDevice, FollowsASteadyTargetWithTheLagOfItsMechanism) {
  SimulatedDeviceOptions options = bare_handle();
  options.model.limits.damping = 0.5;
  options.model.limits.angular_damping = 1e-3;
  options.hand = {};
  options.target = [](double t) { return Pose{{0.1 * t, 0, 0}, axis_angle({1, 0, 0}, 0.3 * t)}; };
  const auto device = make(options);
  start(*device, [](const DeviceState&) { return Wrench{}; });
  device->run(3000);
  const DeviceState state = device->true_state();
  EXPECT_NEAR(state.X_BH.translation.x, 0.1 * state.time - 0.5 * 0.1 / options.hand.stiffness,
              1e-9);
  EXPECT_NEAR(angle_x(state.X_BH.rotation),
              0.3 * state.time - 1e-3 * 0.3 / options.hand.angular_stiffness, 1e-9);
  EXPECT_NEAR(state.V_BH.linear.x, 0.1, 1e-9);
  EXPECT_NEAR(state.V_BH.angular.x, 0.3, 1e-9);
}

/// Computes the growth of an oscillation against a sampled spring after some seconds.
double growth(double mass, double damping, double rate, double stiffness) {
  SimulatedDeviceOptions options = bare_handle();
  options.model.moving_mass = mass;
  options.model.limits.damping = damping;
  options.rate = rate;
  const auto device = make(options);
  double early = 0, late = 0;
  int num_ticks = 0;
  start(*device, [&](const DeviceState& state) {
    if (num_ticks++ == 0) return Wrench{{0.01, 0, 0}, {}};
    const double x = state.X_BH.translation.x;
    if (num_ticks < 200) early = std::max(early, std::abs(x));
    if (num_ticks > 29800) late = std::max(late, std::abs(x));
    return Wrench{{-stiffness * x, 0, 0}, {}};
  });
  device->run(30000);
  return late / early;
}

TEST(SimulatedDevice, SampledSpringIsStableBelowTwiceTheDampingPerTick) {
  // Largest stable stiffness of a mass with a damper and a spring that is held for each tick: the
  // eigenvalues of the discrete system. Colgate and Schenkel's bound 2 b / T is just below.
  struct Case {
    double mass, damping, rate, limit;
  };
  for (const auto& [mass, damping, rate, limit] :
       {Case{0.045, 0.2, 1000, 400.3}, Case{0.045, 1, 1000, 2007}, Case{0.2, 5, 1000, 10042},
        Case{0.2, 5, 4000, 40042}}) {
    SCOPED_TRACE(limit);
    EXPECT_LT(growth(mass, damping, rate, 0.95 * limit), 0.5);
    EXPECT_GT(growth(mass, damping, rate, 1.05 * limit), 2);
  }
}

/// Kinetic energy and energy of the hand's springs about a resting origin.
double stored_energy(const SimulatedDeviceOptions& options, const DeviceState& state) {
  const double mass = options.model.moving_mass + options.hand.mass;
  const Vec3d& p = state.X_BH.translation;
  const Quaternion& q = state.X_BH.rotation;
  const double turn = 2 * std::atan2(norm(Vec3d{q.x, q.y, q.z}), std::abs(q.w));
  return 0.5 *
         (mass * dot(state.V_BH.linear, state.V_BH.linear) + options.hand.stiffness * dot(p, p) +
          options.hand.angular_inertia * dot(state.V_BH.angular, state.V_BH.angular) +
          options.hand.angular_stiffness * turn * turn);
}

Wrench changing_wrench(const DeviceState& state) {
  const double t = state.time;
  return {{2 * std::sin(31 * t), std::cos(17 * t), std::sin(5 * t)}, {}};
}

TEST(SimulatedDevice, KeepsEveryJouleThatItIsGiven) {
  SimulatedDeviceOptions options = bare_handle();
  options.hand.stiffness = 150;
  options.hand.angular_stiffness = 0.5;
  const auto device = make(options);
  start(*device, [](const DeviceState& state) {
    Wrench F = changing_wrench(state);
    F.torque = {0, 0.02 * std::sin(41 * state.time), 0};  // one axis: exact
    return F;
  });
  for (int i = 0; i < 200; ++i) {
    device->run(10);
    EXPECT_NEAR(stored_energy(options, device->true_state()), device->energy_given(), 1e-10);
  }
}

TEST(SimulatedDevice, AddsNoEnergyWithDampersAndAtTheEdgeOfItsWorkspace) {
  SimulatedDeviceOptions options = bare_handle();
  options.model.limits.damping = 0.2;
  options.model.limits.workspace_radius = 0.03;
  options.hand = {};
  options.hand.stiffness = 10;
  const auto device = make(options);
  start(*device, [](const DeviceState& state) {
    Wrench F = changing_wrench(state);
    F.torque = 0.02 * Vec3d{F.force.y, F.force.z, F.force.x};
    return F;
  });
  double last_loss = 0, farthest = 0;
  for (int i = 0; i < 5000; ++i) {
    device->run(1);
    const DeviceState state = device->true_state();
    farthest = std::max(farthest, norm(state.X_BH.translation));
    if (norm(state.X_BH.translation) > 0.03 - 1e-12) {  // at the stop, nothing goes on outward
      EXPECT_LE(dot(state.V_BH.linear, state.X_BH.translation), 1e-12);
    }
    const double loss = device->energy_given() - stored_energy(options, state);
    EXPECT_GE(loss, last_loss - 1e-9) << "tick " << i;
    last_loss = loss;
  }
  EXPECT_NEAR(farthest, 0.03, 1e-12);
  EXPECT_GT(last_loss, 0.1);
}

TEST(SimulatedDevice, SensesInStepsOfItsEncodersAndFiltersVelocity) {
  SimulatedDeviceOptions options = bare_handle();
  options.quantum = 1e-4;
  options.velocity_filter = 0.005;
  options.hand.stiffness = 150;
  options.hand.damping = 3;
  options.target = [](double t) { return Pose{{0.0123 * t, -0.05 * t, 0}, {}}; };
  const auto device = make(options);
  Vec3d last, filtered;
  int num_ticks = 0;
  start(*device, [&](const DeviceState& state) {
    const Vec3d p = state.X_BH.translation;
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(std::remainder(p[i], 1e-4), 0, 1e-15);
    EXPECT_LE(norm(p - device->true_state().X_BH.translation), 0.5e-4 * std::sqrt(3) + 1e-12);
    if (num_ticks++ > 0) filtered += (1 - std::exp(-0.2)) * ((p - last) * 1000 - filtered);
    last = p;
    EXPECT_NEAR(norm(state.V_BH.linear - filtered), 0, 1e-12);
    EXPECT_NEAR(state.time, (num_ticks - 1) * 1e-3, 1e-12);
    EXPECT_TRUE(state.is_valid);
    return Wrench{};
  });
  device->run(1000);
  EXPECT_EQ(num_ticks, 1000);
  EXPECT_NEAR(filtered.y, -0.05, 0.1);  // one step per tick is 0.1 m/s
}

TEST(SimulatedDevice, GivesNoMoreThanItsMotorsCan) {
  SimulatedDeviceOptions options = bare_handle();
  options.model.limits.max_force = 2;
  options.model.limits.max_torque = 0;
  options.hand.stiffness = 100;
  options.hand.damping = 5;
  const auto device = make(options);
  start(*device, [](const DeviceState&) { return Wrench{{30, 40, 0}, {1, 0, 0}}; });
  device->run(2000);
  const Pose X_BH = device->true_state().X_BH;
  EXPECT_NEAR(X_BH.translation.x, 2 * 0.6 / 100, 1e-9);
  EXPECT_NEAR(X_BH.translation.y, 2 * 0.8 / 100, 1e-9);
  EXPECT_EQ(X_BH.rotation, Quaternion{});
}

TEST(SimulatedDevice, ShutsDownOnAWrenchThatIsNoNumber) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const Wrench& bad : {Wrench{{0, nan, 0}, {}}, Wrench{{}, {0, 0, nan}}}) {
    const auto device = make(bare_handle());
    int num_ticks = 0;
    start(*device, [&](const DeviceState&) { return ++num_ticks == 5 ? bad : Wrench{}; });
    device->run(4);
    EXPECT_TRUE(device->status().has_value());
    device->run(10);
    EXPECT_EQ(num_ticks, 5);
    ASSERT_FALSE(device->status().has_value());
    EXPECT_TRUE(is_finite(device->true_state().X_BH));
    start(*device, [](const DeviceState&) { return Wrench{}; });  // again
    EXPECT_TRUE(device->status().has_value());
  }
}

TEST(SimulatedDevice, RunsOnlyBetweenStartAndStop) {
  const auto device = make(bare_handle());
  int num_ticks = 0;
  const auto count = [&](const DeviceState&) {
    if (++num_ticks == 7) device->stop();
    return Wrench{{1, 0, 0}, {}};
  };
  device->run(3);
  EXPECT_EQ(num_ticks, 0);
  start(*device, count);
  device->run(100);
  EXPECT_EQ(num_ticks, 7);
  start(*device, count);  // from the beginning
  device->run(1);
  EXPECT_EQ(num_ticks, 8);
  EXPECT_EQ(device->true_state().time, 0);
  EXPECT_EQ(device->energy_given(), 0);
}

TEST(SimulatedDevice, RepeatsItselfBitForBit) {
  const auto run = [] {
    SimulatedDeviceOptions options = bare_handle();
    options.model = device_models().front();
    options.hand = {};
    options.target = [](double t) {
      return Pose{{0.03 * std::sin(3 * t), 0, 0.02 * t}, axis_angle({1, 2, 3}, std::sin(t))};
    };
    const auto device = make(options);
    start(*device, [](const DeviceState& state) {
      return Wrench{-300 * state.X_BH.translation - 2 * state.V_BH.linear, {}};
    });
    device->run(2000);
    return std::pair{device->true_state().X_BH, device->energy_given()};
  };
  EXPECT_EQ(run(), run());
}

TEST(SimulatedDevice, RefusesOptionsOutOfRange) {
  const auto refuses = [](auto change) {
    SimulatedDeviceOptions options = bare_handle();
    change(options);
    const auto device = SimulatedDevice::create(options);
    ASSERT_FALSE(device.has_value());
    EXPECT_EQ(device.error().code, Errc::invalid_argument);
  };
  refuses([](auto& o) { o.rate = 99; });
  refuses([](auto& o) { o.rate = 9000; });
  refuses([](auto& o) { o.rate = std::numeric_limits<double>::quiet_NaN(); });
  refuses([](auto& o) { o.quantum = -1; });
  refuses([](auto& o) { o.velocity_filter = 2; });
  refuses([](auto& o) { o.model.moving_mass = 0; });
  refuses([](auto& o) { o.model.limits.workspace_radius = 0; });
  refuses([](auto& o) { o.hand.angular_inertia = 0; });
  refuses([](auto& o) { o.hand.stiffness = -1; });
  refuses([](auto& o) { o.hand.damping = std::numeric_limits<double>::infinity(); });
}

TEST(SimulatedDevice, TicksByTheClockWithoutAllocating) {
  SimulatedDeviceOptions options = bare_handle();
  options.in_real_time = true;
  options.hand = {};
  options.target = [](double t) { return Pose{{0.01 * std::sin(t), 0, 0}, {}}; };
  std::atomic<int> num_ticks = 0;
  double last = 0;
  bool goes_forward = true;
  std::size_t first_allocations = 0, allocations = 0;
  const auto tick = [&](const DeviceState& state) {
    if (num_ticks == 0) first_allocations = test::num_allocations();
    allocations = test::num_allocations();
    goes_forward = goes_forward && state.time > last;
    last = state.time;
    ++num_ticks;
    return Wrench{{0.1, 0, 0}, {}};
  };
  const auto device = make(options);
  const double before =
      std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  start(*device, tick);
  for (int i = 0; i < 500 && num_ticks < 50; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  const DeviceState seen = device->true_state();
  device->stop();
  const int num_at_stop = num_ticks;
  EXPECT_GE(num_at_stop, 50);
  EXPECT_TRUE(goes_forward);
  EXPECT_GE(last, before);
  EXPECT_GE(seen.time, before);
  EXPECT_EQ(allocations, first_allocations);
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  EXPECT_EQ(num_ticks, num_at_stop);
  EXPECT_TRUE(device->status().has_value());
  start(*device, tick);  // goes out of scope while it runs
}

TEST(SimulatedDevice, OpensByModelAndExploresForward) {
  const auto wrong = open_simulated_device("hammer");
  ASSERT_FALSE(wrong.has_value());
  EXPECT_NE(wrong.error().message.find("omega.6"), std::string::npos);

  const auto device = open_simulated_device("omega.3");
  ASSERT_TRUE(device.has_value());
  EXPECT_EQ((*device)->info().kind, "sim");
  EXPECT_EQ((*device)->info().limits.max_force, 12);
  EXPECT_TRUE(open_simulated_device("").has_value());
}

}  // namespace
}  // namespace palpate
