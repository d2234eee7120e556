#include "palpate/devices/devices.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <string>

#include "tests/devices/fake_spacenavd.h"

namespace palpate {
namespace {

TEST(OpenDevice, OpensByKindAndAddress) {
  const auto device = open_device("sim:falcon");
  ASSERT_TRUE(device.has_value()) << device.error().message;
  EXPECT_EQ((*device)->info().kind, "sim");
  EXPECT_EQ((*device)->info().limits.max_force, 8);
  EXPECT_TRUE(open_device("sim").has_value());
  EXPECT_TRUE(open_device("sim:").has_value());

  const test::FakeSpacenavd daemon;
  const auto mouse = open_device("spacenav:" + daemon.path());
  ASSERT_TRUE(mouse.has_value()) << mouse.error().message;
  EXPECT_EQ((*mouse)->info().kind, "spacenav");
}

TEST(OpenDevice, KnowsNothingElse) {
  for (const char* uri : {"", ":", "hammer", "SIM", "sims:touch", "replay2:x", "\n"}) {
    const auto device = open_device(uri);
    ASSERT_FALSE(device.has_value()) << uri;
    EXPECT_EQ(device.error().code, Errc::invalid_argument);
    for (const char* kind :
         {"sim[", "replay:", "spacenav", "haply", "forcedimension", "openhaptics", "vrpn:", "page"})
      EXPECT_NE(device.error().message.find(kind), std::string::npos) << kind;
  }
  EXPECT_LT(open_device(std::string(100000, 'x')).error().message.size(), 400u);
  EXPECT_FALSE(open_device("sim:nothing").has_value());
  EXPECT_FALSE(open_device("replay:").has_value());
}

TEST(FindDevices, AsksEveryKind) {
  const test::FakeSpacenavd daemon;
  ::setenv("SPNAV_SOCKET", daemon.path().c_str(), 1);
  const auto found = find_devices();
  ::unsetenv("SPNAV_SOCKET");
  ASSERT_EQ(found.size(), 9u);
  for (const char* kind : {"sim", "replay", "spacenav", "haply", "forcedimension", "openhaptics",
                           "vrpn", "ros2", "page"}) {
    const auto device = std::ranges::find(found, kind, &FoundDevice::kind);
    ASSERT_NE(device, found.end()) << kind;
    EXPECT_FALSE(device->what.empty()) << kind;
    EXPECT_EQ(device->uri.rfind(kind, 0), 0u) << kind;
    EXPECT_TRUE(device->is_usable || !device->hint.empty()) << kind;
  }
  EXPECT_TRUE(found[0].is_usable);
  EXPECT_TRUE(found[2].is_usable);
  EXPECT_EQ(found[2].uri, "spacenav:" + daemon.path());
}

TEST(FindDevices, SaysWhatToDoAboutAMissingDaemon) {
  ::setenv("SPNAV_SOCKET", (::testing::TempDir() + "/nobody").c_str(), 1);
  const auto found = find_devices();
  ::unsetenv("SPNAV_SOCKET");
  EXPECT_FALSE(found[2].is_usable);
  EXPECT_NE(found[2].what.find("/nobody"), std::string::npos);
  EXPECT_NE(found[2].hint.find("spacenavd"), std::string::npos);
}

}  // namespace
}  // namespace palpate
