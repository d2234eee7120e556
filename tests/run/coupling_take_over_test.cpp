// Couplings that take the place of others.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "palpate/haptics/coupling.h"
#include "tests/run/live_loop_fixtures.h"

namespace palpate {
namespace {

using test::box_tool;
using test::ScriptedDevice;

/// A wall that pushes back with 2000 N/m, known at the tool's pose.
LocalContact wall_contact(const Pose& X_WT, double time) {
  LocalContact contact;
  contact.time = time;
  contact.X_WT = X_WT;
  contact.p_WC = X_WT * box_tool().sphere_mass().center_of_mass;
  const double depth = std::max(0.0, X_WT.translation.z);
  contact.F_C_W.force = {0, 0, -2000 * depth};
  if (depth > 0) contact.stiffness.m[2][2] = contact.max_stiffness = 2000;
  contact.volume = 0.0025 * depth;
  contact.is_valid = true;
  return contact;
}

TEST(CouplingTakeOver, FromEachKindToEachTheToolMovesOn) {
  const ScriptedDevice device({});
  const DeviceLimits& limits = device.info().limits;
  const auto coupling_of = [&](CouplingKind kind, double scale) {
    CouplingOptions options;
    options.kind = kind;
    options.motion_scale = scale;
    const auto checked = check_coupling(options, limits, 1e-3, box_tool().sphere_mass()).value();
    return make_coupling(checked.options, limits, box_tool().sphere_mass());
  };
  constexpr CouplingKind kKinds[] = {CouplingKind::virtual_coupling, CouplingKind::direct,
                                     CouplingKind::proxy};
  for (const double height : {-0.02, 0.003}) {  // before the wall, and in it
    for (const CouplingKind from : kKinds) {
      for (const CouplingKind to : kKinds) {
        auto coupling = coupling_of(from, 1);
        DeviceState state;
        state.is_valid = true;
        CouplingStep last;
        Vec3d velocity;
        for (int k = 0; k < 1400; ++k) {
          const double time = 1e-3 * k;
          state.time = time;
          state.X_BH = {{0.02 * std::sin(3 * time), 0, height}, axis_angle({1, 2, 3}, 0.3 * time)};
          state.V_BH.linear = {0.06 * std::cos(3 * time), 0, 0};
          state.V_BH.angular = 0.3 / norm(Vec3d{1, 2, 3}) * Vec3d{1, 2, 3};
          if (k == 0) coupling->reset(state);
          if (k == 700) {
            auto next = coupling_of(to, 2);
            next->take_over(coupling->state());
            coupling = std::move(next);
          }
          const CouplingStep now =
              coupling->step(state, wall_contact(k == 0 ? Pose{} : last.X_WT, time), 1e-3);
          if (k >= 700) {
            // At most twice the hand's pace, and the way of the tool back to the hand.
            EXPECT_LT(norm(now.X_WT.translation - last.X_WT.translation), 3e-4)
                << static_cast<int>(from) << static_cast<int>(to) << " " << k;
          }
          if (k == 700) {
            EXPECT_LT(norm(now.X_WT_hand.translation - last.X_WT_hand.translation), 1.3e-4);
            EXPECT_LT(norm(now.X_WT.translation - last.X_WT.translation - 1e-3 * velocity), 1e-4);
          }
          velocity = 1e3 * (now.X_WT.translation - last.X_WT.translation);
          last = now;
        }
        if (height < 0 || to == CouplingKind::direct) {
          EXPECT_LT(norm(last.X_WT.translation - last.X_WT_hand.translation), 2e-3);
        }
      }
    }
  }
}

}  // namespace
}  // namespace palpate
