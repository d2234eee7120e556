// Wire format of VRPN connections (TCP): a cookie each way, then messages with a header of six
// big-endian integers and a payload, both padded to eight bytes. VRPN 7, vrpn_Connection.C.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// 24 bytes: the version and that nothing is to be logged. Only the minor version may differ.
std::string vrpn_cookie();
bool is_vrpn_cookie(std::string_view cookie);

/// Types below zero are the connection's own.
inline constexpr std::int32_t kVrpnSenderDescription = -1, kVrpnTypeDescription = -2,
                              kVrpnDisconnect = -5;

struct VrpnMessage {
  std::int32_t seconds = 0, microseconds = 0;  ///< when it was true, by the sender's clock
  std::int32_t sender = 0, type = 0;
  std::string_view payload;
};

/// Appends a message with its sequence number; does not allocate if there is room.
void append_vrpn_message(const VrpnMessage& message, std::int32_t sequence_number,
                         std::string& bytes);

/// Cuts a stream of bytes into messages. Allocates at construction only.
class VrpnReader {
 public:
  /// More payload than this is taken for an error: VRPN's own buffers end at 64000 bytes.
  static constexpr std::size_t kMaxPayload = 64000;

  VrpnReader() : bytes_(2 * kMaxPayload) {}

  /// Free space for received bytes, and how many were written there. Never empty after `nothing`.
  std::span<char> space() noexcept;
  void added(std::size_t count) noexcept { end_ += count; }

  enum class Got { nothing, cookie, message, broken };
  /// First the cookie, then messages; `message.payload` is valid until the next call of anything
  /// here. Once broken (another version, an impossible length), it stays broken.
  Got next(VrpnMessage& message) noexcept;

 private:
  std::vector<char> bytes_;
  std::size_t begin_ = 0, end_ = 0;
  bool has_cookie_ = false, is_broken_ = false;
};

// Payloads. Readers return false for a wrong size.

/// Payload of sender and type descriptions.
bool read_vrpn_name(std::string_view payload, std::string_view& name) noexcept;
std::string vrpn_name(std::string_view name);

struct VrpnPose {
  std::int32_t sensor = 0;
  Pose X_BH;
};
bool read_vrpn_pose(std::string_view payload, VrpnPose& pose) noexcept;

struct VrpnVelocity {
  std::int32_t sensor = 0;
  Vec3d linear;
  Quaternion turn;  ///< within `interval`
  double interval = 0;
};
bool read_vrpn_velocity(std::string_view payload, VrpnVelocity& velocity) noexcept;

/// A button and whether it is down.
bool read_vrpn_button(std::string_view payload, std::int32_t& button, bool& is_down) noexcept;
/// All of them, a bit each.
bool read_vrpn_buttons(std::string_view payload, std::uint32_t& buttons) noexcept;
bool read_vrpn_force_error(std::string_view payload, std::int32_t& code) noexcept;

/// F(x) = force + jacobian (x - origin) where |x - origin| <= radius, else zero.
struct VrpnForceField {
  Vec3d origin, force;
  Mat3d jacobian;
  double radius = 0;
};
std::array<char, 64> vrpn_force_field(const VrpnForceField& field) noexcept;

}}  // namespace palpate::v0
