// VRPN's messages, byte for byte.

#include "src/devices/vrpn/vrpn_wire.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "tests/devices/mutation.h"

namespace palpate {
namespace {

using Got = VrpnReader::Got;
using namespace std::string_literals;

void feed(VrpnReader& reader, std::string_view bytes) {
  const std::span<char> space = reader.space();
  ASSERT_GE(space.size(), bytes.size());
  std::copy(bytes.begin(), bytes.end(), space.begin());
  reader.added(bytes.size());
}

TEST(VrpnWire, Cookie) {
  EXPECT_EQ(vrpn_cookie(), "vrpn: ver. 07.38  0\0\0\0\0\0"s);
  EXPECT_TRUE(is_vrpn_cookie("vrpn: ver. 07.15  1\0\0\0\0\0"s));
  EXPECT_FALSE(is_vrpn_cookie("vrpn: ver. 06.04  0\0\0\0\0\0"s));
  EXPECT_FALSE(is_vrpn_cookie("HTTP/1.1 400 Bad Request"));
}

TEST(VrpnWire, AMessageByteForByte) {
  std::string bytes;
  append_vrpn_message({1, 2, 3, -2, vrpn_name("ab")}, 5, bytes);
  EXPECT_EQ(bytes,
            "\0\0\0\x1f\0\0\0\1\0\0\0\2\0\0\0\3\xff\xff\xff\xfe\0\0\0\5"
            "\0\0\0\3ab\0\0"s);
  VrpnReader reader;
  feed(reader, vrpn_cookie() + bytes);
  VrpnMessage message;
  ASSERT_EQ(reader.next(message), Got::cookie);
  ASSERT_EQ(reader.next(message), Got::message);
  EXPECT_EQ(message.seconds, 1);
  EXPECT_EQ(message.microseconds, 2);
  EXPECT_EQ(message.sender, 3);
  EXPECT_EQ(message.type, kVrpnTypeDescription);
  std::string_view name;
  ASSERT_TRUE(read_vrpn_name(message.payload, name));
  EXPECT_EQ(name, "ab");
  EXPECT_EQ(reader.next(message), Got::nothing);
}

TEST(VrpnWire, Payloads) {
  // 1.0 = 3ff0..., -2.0 = c000..., 0.5 = 3fe0...
  const std::string zero(8, '\0');
  const std::string one = "\x3f\xf0\0\0\0\0\0\0"s, minus_two = "\xc0\0\0\0\0\0\0\0"s,
                    half = "\x3f\xe0\0\0\0\0\0\0"s;
  const std::string head = "\0\0\0\4\0\0\0\0"s;
  VrpnPose pose;
  ASSERT_TRUE(read_vrpn_pose(head + one + minus_two + half + zero + zero + zero + one, pose));
  EXPECT_EQ(pose.sensor, 4);
  EXPECT_EQ(pose.X_BH.translation, (Vec3d{1, -2, 0.5}));
  EXPECT_EQ(pose.X_BH.rotation, (Quaternion{0, 0, 0, 1}));
  VrpnVelocity velocity;
  ASSERT_TRUE(
      read_vrpn_velocity(head + half + one + one + one + zero + zero + zero + half, velocity));
  EXPECT_EQ(velocity.linear, (Vec3d{0.5, 1, 1}));
  EXPECT_EQ(velocity.turn, (Quaternion{1, 0, 0, 0}));
  EXPECT_EQ(velocity.interval, 0.5);
  std::int32_t button = 0;
  bool is_down = false;
  EXPECT_TRUE(read_vrpn_button("\0\0\0\2\0\0\0\1"s, button, is_down));
  EXPECT_EQ(button, 2);
  EXPECT_TRUE(is_down);
  EXPECT_FALSE(read_vrpn_button("\0\0\0\x20\0\0\0\1"s, button, is_down)) << "no such bit";
  EXPECT_FALSE(read_vrpn_button("\xff\xff\xff\xff\0\0\0\1"s, button, is_down));
  std::uint32_t buttons = 0;
  EXPECT_TRUE(read_vrpn_buttons("\0\0\0\3\0\0\0\1\0\0\0\0\0\0\0\1"s, buttons));
  EXPECT_EQ(buttons, 0b101u);
  EXPECT_FALSE(read_vrpn_buttons("\0\0\0\4\0\0\0\1\0\0\0\0\0\0\0\1"s, buttons));
  std::string_view name;
  EXPECT_FALSE(
      read_vrpn_name("\x7f\xff\xff\xff"
                     "abc\0"s,
                     name));
  EXPECT_FALSE(
      read_vrpn_name("\xff\xff\xff\xff"
                     "abc\0"s,
                     name));

  VrpnForceField field;
  field.origin = {1, 0, 0};
  field.force = {0, -2, 0};
  field.jacobian.m[0][1] = 0.5;
  field.radius = 1;
  const auto bytes = vrpn_force_field(field);
  std::string expected(64, '\0');
  expected.replace(0, 2, "\x3f\x80");
  expected.replace(16, 1, "\xc0");
  expected.replace(28, 1, "\x3f");
  expected.replace(60, 2, "\x3f\x80");
  EXPECT_EQ(std::string(bytes.begin(), bytes.end()), expected);
}

TEST(VrpnWire, ImpossibleLengthsBreakTheStream) {
  for (const std::string& length :
       {"\x7f\xff\xff\xff"s, "\xff\xff\xff\xff"s, "\0\0\0\0"s, "\0\0\0\x17"s, "\0\1\0\0"s}) {
    VrpnReader reader;
    feed(reader, vrpn_cookie() + length + std::string(20, '\0'));
    VrpnMessage message;
    ASSERT_EQ(reader.next(message), Got::cookie);
    EXPECT_EQ(reader.next(message), Got::broken);
    EXPECT_EQ(reader.next(message), Got::broken);
  }
}

TEST(VrpnWire, TheLargestMessageFits) {
  VrpnReader reader;
  std::string bytes = vrpn_cookie();
  append_vrpn_message({0, 0, 0, 0, std::string(VrpnReader::kMaxPayload, 'x')}, 0, bytes);
  VrpnMessage message;
  Got got = Got::nothing;
  for (std::size_t at = 0; at < bytes.size(); at += 1000) {
    feed(reader, std::string_view(bytes).substr(at, 1000));
    while ((got = reader.next(message)) == Got::cookie) {
    }
  }
  EXPECT_EQ(got, Got::message);
  EXPECT_EQ(message.payload.size(), VrpnReader::kMaxPayload);
}

TEST(VrpnWire, MutatedStreamsHurtNobody) {
  std::string stream;
  append_vrpn_message({1, 2, 0, -1, vrpn_name("Falcon0")}, 0, stream);
  append_vrpn_message({1, 2, 1, -2, vrpn_name("vrpn_Tracker Pos_Quat")}, 1, stream);
  append_vrpn_message({1, 2, 0, 1, std::string(64, '\1')}, 2, stream);
  append_vrpn_message({1, 2, 0, 1, std::string(72, '\1')}, 3, stream);
  append_vrpn_message({1, 2, 0, 2, "\0\0\0\1\0\0\0\1"s}, 4, stream);
  test::Random random(3);
  VrpnReader reader;
  std::size_t num_messages = 0;
  for (int i = 0; i < 100000; ++i) {
    if (i % 20 == 0) {
      reader = VrpnReader();
      feed(reader, vrpn_cookie());
    }
    const std::string bytes = test::mutated(stream, random);
    if (reader.space().size() < bytes.size()) continue;
    feed(reader, bytes);
    VrpnMessage message;
    for (Got got; (got = reader.next(message)) != Got::nothing && got != Got::broken;) {
      num_messages += got == Got::message;
      if (got != Got::message) continue;
      // Exactly as long as the payload: a sanitizer sees every step beyond it.
      const std::vector<char> exact(message.payload.begin(), message.payload.end());
      const std::string_view payload(exact.data(), exact.size());
      std::string_view name;
      VrpnPose pose;
      VrpnVelocity velocity;
      std::int32_t number = 0;
      bool is_down = false;
      std::uint32_t buttons = 0;
      read_vrpn_name(payload, name);
      read_vrpn_pose(payload, pose);
      read_vrpn_velocity(payload, velocity);
      read_vrpn_button(payload, number, is_down);
      read_vrpn_buttons(payload, buttons);
      read_vrpn_force_error(payload, number);
    }
  }
  EXPECT_GT(num_messages, 10000u);
}

}  // namespace
}  // namespace palpate
