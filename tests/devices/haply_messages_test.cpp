// Reading and writing the messages of Haply's service, with nlohmann::json as the judge.

#include "src/devices/haply/haply_messages.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "src/devices/haply/json_scanner.h"
#include "tests/devices/mutation.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

using nlohmann::json;

// As the service's documentation shows it, abridged; members in an order of its own.
constexpr std::string_view kInventory = R"( {"session_id":7,
 "inverse3":[{"config":{"type":"inverse3","port":"COM12","device_info":{"id":"049D","uuid":"\"\\u00e9"},
   "gravity_compensation":{"enabled":true,"scaling_factor":1.0},"basis":{"permutation":"XYZ"},
   "preset":"arm_front",
   "mount":{"position":{},"rotation":{},"scale":{}},"filters":[1,[2,{"a":[]}],null]},
   "state":{"cursor_position":{"x":0.25,"y":-0.12,"z":1.5e-1},"cursor_velocity":{"z":-1},
     "body_orientation":{"w":1,"x":0,"y":0,"z":0},"current_cursor_force":{"x":0,"y":0.5,"z":0},
     "control_mode":"idle"},
   "status":{"calibrated":false,"in_use":false},"device_id":"049D"},
  {"device_id":"0000","state":{}}],
 "verse_grip":[{"device_id":"61548","state":{"button":true,"hall":0,"orientation":{"x":0.5,"y":0.5,"z":0.5,"w":0.5}},"status":{}}],
 "wireless_verse_grip":[{"device_id":"w","state":{"orientation":{"x":1,"w":0},
   "buttons":{"home":true,"a":false,"b":true,"c":false},"battery_level":0.9},"status":{"connected":false}}]} )";

TEST(HaplyMessages, ReadsAnInventory) {
  HaplyMessage message;
  ASSERT_TRUE(read_haply_message(kInventory, message));
  ASSERT_EQ(message.num_entries, 4u);
  const HaplyEntry* arm = message.find(HaplyKind::inverse3);
  ASSERT_NE(arm, nullptr);
  EXPECT_EQ(arm->id, "049D");
  EXPECT_TRUE(arm->has_state && arm->has_position && arm->has_force);
  EXPECT_EQ(arm->position, (Vec3d{0.25, -0.12, 0.15}));
  EXPECT_EQ(arm->velocity, (Vec3d{0, 0, -1}));
  EXPECT_EQ(arm->force, (Vec3d{0, 0.5, 0}));
  EXPECT_EQ(arm->is_calibrated, false);
  EXPECT_EQ(arm->preset, "arm_front");
  const HaplyEntry* empty = message.find(HaplyKind::inverse3, "0000");
  ASSERT_NE(empty, nullptr);
  EXPECT_TRUE(empty->has_state);
  EXPECT_FALSE(empty->has_position || empty->has_force || empty->is_calibrated);
  EXPECT_EQ(empty->preset, "");
  const HaplyEntry* wired = message.find(HaplyKind::verse_grip);
  EXPECT_EQ(wired->orientation, (Quaternion{0.5, 0.5, 0.5, 0.5}));
  EXPECT_EQ(wired->buttons, 1u);
  const HaplyEntry* wireless = message.find(HaplyKind::wireless_verse_grip, "w");
  EXPECT_EQ(wireless->orientation, (Quaternion{1, 0, 0, 0}));
  EXPECT_EQ(wireless->buttons, 0b1010u);
  EXPECT_EQ(wireless->is_connected, false);
  EXPECT_EQ(message.find(HaplyKind::custom_verse_grip), nullptr);
}

TEST(HaplyMessages, ValuesOfAnotherKindCountAsAbsent) {
  HaplyMessage message;
  ASSERT_TRUE(read_haply_message(
      R"({"inverse3":[{"device_id":"a","state":{"cursor_position":{"x":"1","y":null,"z":[1]}},
          "status":{"calibrated":1}},3,{"device_id":4}],"verse_grip":{"61548":{}}})",
      message));
  ASSERT_EQ(message.num_entries, 1u);
  EXPECT_EQ(message.entries[0].position, Vec3d{});
  EXPECT_FALSE(message.entries[0].is_calibrated);
  for (const char* bad : {"", "[]", "{", "{\"a\":}", "{\"a\":1}x", "{\"a\":-inf}", "{\"a\":nan}",
                          "{\"a\" 1}", "{\"a\":1,}", "{\"inverse3\":[{]}"})
    EXPECT_FALSE(read_haply_message(bad, message)) << bad;
  EXPECT_FALSE(read_haply_message("{\"a\":" + std::string(100000, '['), message));
}

TEST(HaplyMessages, MoreDevicesThanThereIsRoomFor) {
  json many = {{"inverse3", json::array()}};
  for (int i = 0; i < 100; ++i) many["inverse3"].push_back({{"device_id", std::to_string(i)}});
  HaplyMessage message;
  EXPECT_TRUE(read_haply_message(many.dump(), message));
  EXPECT_EQ(message.num_entries, message.entries.size());
}

TEST(HaplyMessages, WritesRequests) {
  std::string text;
  HaplyRequest request;
  request.device_id = "049D";
  request.introduces_us = true;
  write_haply_request(request, text);
  json parsed = json::parse(text);
  EXPECT_EQ(parsed["inverse3"][0]["commands"], json::parse(R"({"probe_position":{}})"));
  EXPECT_TRUE(parsed["session"]["configure"]["profile"].contains("name"));

  request.introduces_us = false;
  request.force = Vec3d{0.1, -1e-30, 3};
  request.grip_kind = HaplyKind::wireless_verse_grip;
  request.grip_id = "w";
  for (const auto& [key, word] :
       {std::pair{HaplyForceKey::vector, "vector"}, std::pair{HaplyForceKey::values, "values"}}) {
    request.force_key = key;
    write_haply_request(request, text);
    parsed = json::parse(text);
    EXPECT_FALSE(parsed.contains("session"));
    EXPECT_EQ(parsed["inverse3"][0]["device_id"], "049D");
    EXPECT_EQ(parsed["inverse3"][0]["commands"]["set_cursor_force"][word],
              json({{"x", 0.1}, {"y", -1e-30}, {"z", 3.0}}));
    EXPECT_EQ(parsed["wireless_verse_grip"][0],
              json::parse(R"({"device_id":"w","commands":{"probe_orientation":{}}})"));
  }
}

TEST(HaplyMessages, ATickAllocatesNothing) {
  std::string text;
  text.reserve(1024);
  HaplyMessage message;
  HaplyRequest request;
  request.device_id = "049D";
  request.force = Vec3d{-0.12345678901234567, 1e-300, 1.7976931348623157e308};
  const test::AllocationCounter counter;
  for (int i = 0; i < 100; ++i) {
    EXPECT_TRUE(read_haply_message(kInventory, message));
    write_haply_request(request, text);
  }
  EXPECT_EQ(counter.count(), 0u);
}

TEST(HaplyMessages, Versions) {
  EXPECT_EQ(read_haply_version(R"({"version":"3.5.2"})"), (HaplyVersion{3, 5}));
  EXPECT_EQ(read_haply_version("v10.12-beta"), (HaplyVersion{10, 12}));
  EXPECT_EQ(read_haply_version(R"({"api":3,"service":"3.4"})"), (HaplyVersion{3, 4}));
  EXPECT_FALSE(read_haply_version(""));
  EXPECT_FALSE(read_haply_version("none 3 99999999999999.1"));
  EXPECT_LT((HaplyVersion{3, 4}), (HaplyVersion{3, 5}));
  EXPECT_LT((HaplyVersion{3, 9}), (HaplyVersion{3, 10}));
}

TEST(HaplyMessages, Events) {
  HaplyEvent event;
  ASSERT_TRUE(read_haply_event(
      R"({"name":"device-safety-triggered","category":"device","level":"warning",
          "data":{"device_family":"inverse","device_id":"049D","safety_type":"ebrake_triggered"},
          "message":"stop"})",
      event));
  EXPECT_EQ(event.name, "device-safety-triggered");
  EXPECT_EQ(event.level, "warning");
  EXPECT_EQ(event.device_id, "049D");
  EXPECT_EQ(event.safety_type, "ebrake_triggered");
  EXPECT_TRUE(read_haply_event(R"({"data":3,"name":null})", event));
  EXPECT_TRUE(event.name.empty());
}

double number_at(const json& object, const char* key) {
  return object.is_object() && object.contains(key) && object[key].is_number()
             ? object[key].get<double>()
             : 0.0;
}

TEST(HaplyMessages, MutatedMessagesAreReadAsJsonSaysOrRefused) {
  test::Random random(1);
  int num_json = 0;
  for (int i = 0; i < 100000; ++i) {
    // Exactly as long as the text: a sanitizer sees every step beyond it.
    const std::string text = test::mutated(std::string(kInventory), random);
    const std::vector<char> exact(text.begin(), text.end());
    const std::string_view view(exact.data(), exact.size());
    HaplyMessage message;
    HaplyEvent event;
    const bool is_read = read_haply_message(view, message);
    read_haply_event(view, event);
    read_haply_version(view);
    for (std::size_t j = 0; j < message.num_entries; ++j)
      EXPECT_TRUE(std::isfinite(norm(message.entries[j].position)));
    // Whatever JSON's own reader takes must be taken, with the same first device.
    // (To which a zero byte is the end of the text.)
    if (text.find('\0') != std::string::npos) continue;
    const json parsed = json::parse(text, nullptr, false);
    if (parsed.is_discarded() || !parsed.is_object()) continue;
    ++num_json;
    EXPECT_TRUE(is_read) << text;
    const json devices = parsed.value("inverse3", json());
    if (!devices.is_array() || devices.empty() || !devices[0].is_object()) continue;
    if (devices[0].value("device_id", json()) != "049D") continue;
    const HaplyEntry* arm = message.find(HaplyKind::inverse3, "049D");
    const json state = devices[0].value("state", json());
    if (arm == nullptr || !state.is_object() || devices.size() != 2) continue;
    // Members that come twice are read otherwise by the two.
    const auto count = [&text](const char* key) {
      std::size_t n = 0;
      for (std::size_t at = text.find(key); at != std::string::npos; at = text.find(key, at + 1))
        ++n;
      return n;
    };
    if (count("\"state\"") > 4 || count("\"cursor_position\"") > 1 || count("\"x\"") > 6 ||
        count("\"inverse3\"") > 2 || count("049D") > 2)
      continue;
    EXPECT_EQ(arm->position.x, number_at(state.value("cursor_position", json()), "x")) << text;
  }
  EXPECT_GT(num_json, 1000);
}

}  // namespace
}  // namespace palpate
