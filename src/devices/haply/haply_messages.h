// The JSON messages of Haply's Inverse Service (3.1 and later): one state for every message sent.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

enum class HaplyKind { inverse3, verse_grip, wireless_verse_grip, custom_verse_grip };
std::string_view name_of(HaplyKind kind);  ///< as in the messages

/// State of one device in a message. Fields that a message leaves out have the identity's
/// value.
struct HaplyEntry {
  HaplyKind kind = HaplyKind::inverse3;
  std::string_view id;  ///< points into the message
  bool has_state = false;

  // inverse3
  Vec3d position, velocity;  ///< of the cursor, m and m/s
  bool has_position = false;
  Vec3d force;  ///< current_cursor_force: the last one received, N
  bool has_force = false;
  std::optional<bool> is_calibrated;
  std::string_view preset;  ///< of its mount, e.g. "defaults"; the first message alone has it

  // grips
  Quaternion orientation;
  std::uint32_t buttons = 0;  ///< wired: bit 0; wireless and custom: a, b, c, home
  std::optional<bool> is_connected;
};

struct HaplyMessage {
  std::array<HaplyEntry, 16> entries;  ///< further ones are left out
  std::size_t num_entries = 0;

  /// Returns the first of a kind that has this id (any, if empty); null: none.
  const HaplyEntry* find(HaplyKind kind, std::string_view id = {}) const;
};

/// Does not allocate. False: no JSON object; what was read until then is not to be used.
bool read_haply_message(std::string_view text, HaplyMessage& message) noexcept;

/// From the event socket; all members point into the message.
struct HaplyEvent {
  std::string_view name, level, device_id, safety_type, message;
};
bool read_haply_event(std::string_view text, HaplyEvent& event) noexcept;

/// The key of a force's components: services from 3.5 on say "vector", older ones "values".
enum class HaplyForceKey { vector, values };

/// Request to the service; both ids are its own text.
struct HaplyRequest {
  std::string_view device_id;
  std::optional<Vec3d> force;  ///< N; none: only requests the state
  HaplyForceKey force_key = HaplyForceKey::vector;
  HaplyKind grip_kind = HaplyKind::verse_grip;
  std::string_view grip_id;    ///< empty: no grip
  bool introduces_us = false;  ///< the first message of a connection introduces the client
};
/// Replaces `text`; does not allocate if it has room.
void write_haply_request(const HaplyRequest& request, std::string& text);

/// {3, 5} from whatever GET /version answers; empty if no such numbers are in it.
struct HaplyVersion {
  int major = 0, minor = 0;
  friend auto operator<=>(const HaplyVersion&, const HaplyVersion&) = default;
};
std::optional<HaplyVersion> read_haply_version(std::string_view body);

}}  // namespace palpate::v0
