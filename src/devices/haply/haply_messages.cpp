#include "src/devices/haply/haply_messages.h"

#include <algorithm>
#include <charconv>
#include <system_error>

#include "src/devices/haply/json_scanner.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::array kKinds = {HaplyKind::inverse3, HaplyKind::verse_grip,
                               HaplyKind::wireless_verse_grip, HaplyKind::custom_verse_grip};

Vec3d read_vector(JsonScanner& json) noexcept {
  Vec3d v;
  if (!json.enter_object()) return v;
  for (std::string_view key; json.next_member(key);) {
    if (key == "x") {
      json.read(v.x);
    } else if (key == "y") {
      json.read(v.y);
    } else if (key == "z") {
      json.read(v.z);
    } else {
      json.skip();
    }
  }
  return v;
}

Quaternion read_quaternion(JsonScanner& json) noexcept {
  Quaternion q;
  if (!json.enter_object()) return q;
  for (std::string_view key; json.next_member(key);) {
    if (key == "x") {
      json.read(q.x);
    } else if (key == "y") {
      json.read(q.y);
    } else if (key == "z") {
      json.read(q.z);
    } else if (key == "w") {
      json.read(q.w);
    } else {
      json.skip();
    }
  }
  return q;
}

void read_button(JsonScanner& json, int bit, std::uint32_t& buttons) noexcept {
  bool is_down = false;
  if (json.read(is_down) && is_down) buttons |= 1u << bit;
}

void read_buttons(JsonScanner& json, std::uint32_t& buttons) noexcept {
  if (!json.enter_object()) return;
  constexpr std::array<std::string_view, 4> kNames = {"a", "b", "c", "home"};
  for (std::string_view key; json.next_member(key);) {
    const auto name = std::find(kNames.begin(), kNames.end(), key);
    if (name != kNames.end()) {
      read_button(json, static_cast<int>(name - kNames.begin()), buttons);
    } else {
      json.skip();
    }
  }
}

void read_state(JsonScanner& json, HaplyEntry& entry) noexcept {
  if (!json.enter_object()) return;
  entry.has_state = true;
  for (std::string_view key; json.next_member(key);) {
    if (key == "cursor_position") {
      entry.position = read_vector(json);
      entry.has_position = true;
    } else if (key == "cursor_velocity") {
      entry.velocity = read_vector(json);
    } else if (key == "current_cursor_force") {
      entry.force = read_vector(json);
      entry.has_force = true;
    } else if (key == "orientation") {
      entry.orientation = read_quaternion(json);
    } else if (key == "button") {
      read_button(json, 0, entry.buttons);
    } else if (key == "buttons") {
      read_buttons(json, entry.buttons);
    } else {
      json.skip();
    }
  }
}

void read_config(JsonScanner& json, HaplyEntry& entry) noexcept {
  if (!json.enter_object()) return;
  for (std::string_view key; json.next_member(key);) {
    if (key == "preset") {
      json.read(entry.preset);
    } else {
      json.skip();
    }
  }
}

void read_status(JsonScanner& json, HaplyEntry& entry) noexcept {
  if (!json.enter_object()) return;
  for (std::string_view key; json.next_member(key);) {
    bool value = false;
    if (key == "calibrated") {
      if (json.read(value)) entry.is_calibrated = value;
    } else if (key == "connected") {
      if (json.read(value)) entry.is_connected = value;
    } else {
      json.skip();
    }
  }
}

void read_devices(JsonScanner& json, HaplyKind kind, HaplyMessage& message) noexcept {
  if (!json.enter_array()) return;
  while (json.next_element()) {
    HaplyEntry entry;
    entry.kind = kind;
    if (!json.enter_object()) continue;
    for (std::string_view key; json.next_member(key);) {
      if (key == "device_id") {
        json.read(entry.id);
      } else if (key == "state") {
        read_state(json, entry);
      } else if (key == "config") {
        read_config(json, entry);
      } else if (key == "status") {
        read_status(json, entry);
      } else {
        json.skip();
      }
    }
    if (!entry.id.empty() && message.num_entries < message.entries.size())
      message.entries[message.num_entries++] = entry;
  }
}

/// Numbers with a point in every locale.
void append(std::string& text, double number) {
  std::array<char, 32> digits;
  const auto [end, error] = std::to_chars(digits.data(), digits.data() + digits.size(), number);
  text.append(digits.data(), end);
}

}  // namespace

std::string_view name_of(HaplyKind kind) {
  switch (kind) {
    case HaplyKind::inverse3: return "inverse3";
    case HaplyKind::verse_grip: return "verse_grip";
    case HaplyKind::wireless_verse_grip: return "wireless_verse_grip";
    case HaplyKind::custom_verse_grip: return "custom_verse_grip";
  }
  return "";
}

const HaplyEntry* HaplyMessage::find(HaplyKind kind, std::string_view id) const {
  for (std::size_t i = 0; i < num_entries; ++i) {
    if (entries[i].kind == kind && (id.empty() || entries[i].id == id)) return &entries[i];
  }
  return nullptr;
}

bool read_haply_message(std::string_view text, HaplyMessage& message) noexcept {
  message.num_entries = 0;
  JsonScanner json(text);
  if (!json.enter_object()) return false;
  for (std::string_view key; json.next_member(key);) {
    const auto kind = std::find_if(kKinds.begin(), kKinds.end(),
                                   [key](HaplyKind each) { return name_of(each) == key; });
    if (kind != kKinds.end()) {
      read_devices(json, *kind, message);
    } else {
      json.skip();
    }
  }
  return json.is_complete();
}

bool read_haply_event(std::string_view text, HaplyEvent& event) noexcept {
  event = {};
  JsonScanner json(text);
  if (!json.enter_object()) return false;
  for (std::string_view key; json.next_member(key);) {
    if (key == "name") {
      json.read(event.name);
    } else if (key == "level") {
      json.read(event.level);
    } else if (key == "message") {
      json.read(event.message);
    } else if (key == "data" && json.enter_object()) {
      for (std::string_view inner; json.next_member(inner);) {
        if (inner == "device_id") {
          json.read(event.device_id);
        } else if (inner == "safety_type") {
          json.read(event.safety_type);
        } else {
          json.skip();
        }
      }
    } else if (key != "data") {
      json.skip();
    }
  }
  return json.is_complete();
}

void write_haply_request(const HaplyRequest& request, std::string& text) {
  text = "{";
  if (request.introduces_us)
    text += R"("session":{"configure":{"profile":{"name":"palpate:touch"}}},)";
  text += R"("inverse3":[{"device_id":")";
  text += request.device_id;
  if (request.force) {
    text += R"(","commands":{"set_cursor_force":{")";
    text += request.force_key == HaplyForceKey::vector ? "vector" : "values";
    text += R"(":{"x":)";
    append(text, request.force->x);
    text += R"(,"y":)";
    append(text, request.force->y);
    text += R"(,"z":)";
    append(text, request.force->z);
    text += "}}}}]";
  } else {
    text += R"(","commands":{"probe_position":{}}}])";
  }
  if (!request.grip_id.empty()) {
    text += ",\"";
    text += name_of(request.grip_kind);
    text += R"(":[{"device_id":")";
    text += request.grip_id;
    text += R"(","commands":{"probe_orientation":{}}}])";
  }
  text += '}';
}

std::optional<HaplyVersion> read_haply_version(std::string_view body) {
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  const char* const end = body.data() + body.size();
  for (const char* begin = body.data(); begin != end;) {
    begin = std::find_if(begin, end, is_digit);
    HaplyVersion version;
    const auto [point, error] = std::from_chars(begin, end, version.major);
    if (error == std::errc() && end - point > 1 && *point == '.' && is_digit(point[1]) &&
        std::from_chars(point + 1, end, version.minor).ec == std::errc())
      return version;
    begin = std::find_if_not(begin, end, is_digit);
  }
  return std::nullopt;
}

}}  // namespace palpate::v0
