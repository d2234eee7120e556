#include "palpate/devices/devices.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

namespace palpate {
namespace {

TEST(DeviceModels, EveryoneIsPlausibleAndHasItsOwnKey) {
  std::set<std::string_view> keys;
  for (const DeviceModel& model : device_models()) {
    SCOPED_TRACE(model.key);
    EXPECT_TRUE(keys.insert(model.key).second);
    EXPECT_FALSE(model.name.empty());
    const DeviceLimits& limits = model.limits;
    EXPECT_TRUE(limits.max_force >= 1 && limits.max_force <= 40);
    EXPECT_TRUE(limits.max_torque >= 0 && limits.max_torque <= 1);
    EXPECT_TRUE(limits.max_stiffness >= 100 && limits.max_stiffness <= 20000);
    EXPECT_TRUE(limits.max_damping > 0 && limits.max_damping <= 100);
    EXPECT_TRUE(limits.workspace_radius >= 0.02 && limits.workspace_radius <= 1);
    EXPECT_TRUE(model.moving_mass > 0 && model.moving_mass < 1);
    // Models with torques, and only those, have an angular stiffness.
    EXPECT_EQ(limits.max_torque > 0, limits.max_angular_stiffness > 0);
    // Its largest stiffness is at the passivity bound K = 2 b / T of a 1 kHz loop.
    EXPECT_NEAR(2 * limits.damping / 1e-3, limits.max_stiffness, 1e-9);
    EXPECT_NEAR(2 * limits.angular_damping / 1e-3, limits.max_angular_stiffness, 1e-12);
  }
}

TEST(DeviceModels, AreFoundByKeyInAnyCase) {
  ASSERT_TRUE(find_device_model("omega.6"));
  EXPECT_EQ(find_device_model("omega.6")->limits.max_force, 12);
  EXPECT_EQ(find_device_model("Inverse3")->name, "Haply Inverse3");
  EXPECT_EQ(find_device_model("SIGMA.7")->limits.max_torque, 0.2);
  for (const char* unknown : {"", "omega", "omega.66", "touch "})
    EXPECT_FALSE(find_device_model(unknown)) << unknown;
}

}  // namespace
}  // namespace palpate
