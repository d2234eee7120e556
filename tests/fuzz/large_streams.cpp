// Large streams: what devices, their services, robots and pages send.
#include <algorithm>
#include <span>

#include "src/devices/haply/haply_messages.h"
#include "src/devices/transport/web_socket_frames.h"
#include "src/devices/vrpn/vrpn_wire.h"
#include "src/io/internal/ros_messages.h"
#include "src/ros/native_layout.h"
#include "tests/fuzz/large_inputs.h"

namespace palpate::fuzz {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kPiece = 4096;  // as a socket gives them

/// Feeds a reader of a stream; take() is false once it is broken.
template <class Reader, class Take>
Status feed(Reader& reader, std::string_view bytes, const Take& take) {
  while (!bytes.empty()) {
    const std::span<char> space = reader.space();
    const std::size_t count = std::min({kPiece, bytes.size(), space.size()});
    std::copy_n(bytes.begin(), count, space.begin());
    reader.added(count);
    bytes.remove_prefix(count);
    if (!take()) return Error{Errc::bad_input, "the stream is broken"};
  }
  return Done{};
}

Status read_web_socket(const fs::path& path) {
  const std::string bytes = file_bytes(path);
  WebSocketReader reader;
  return feed(reader, bytes, [&] {
    for (;;) {
      std::string_view payload;
      const auto got = reader.next(payload);
      if (got == WebSocketReader::Got::broken) return false;
      if (got == WebSocketReader::Got::nothing) return true;
      HaplyMessage message;
      if (got == WebSocketReader::Got::message) (void)read_haply_message(payload, message);
    }
  });
}

Status read_vrpn(const fs::path& path) {
  const std::string bytes = file_bytes(path);
  VrpnReader reader;
  return feed(reader, bytes, [&] {
    for (;;) {
      VrpnMessage message;
      const auto got = reader.next(message);
      if (got == VrpnReader::Got::broken) return false;
      if (got == VrpnReader::Got::nothing) return true;
      VrpnPose pose;
      (void)read_vrpn_pose(message.payload, pose);
    }
  });
}

Status read_json(const fs::path& path) {
  HaplyMessage message;
  const std::string text = file_bytes(path);
  if (read_haply_message(text, message)) return Done{};
  return Error{Errc::bad_input, "no JSON object"};
}

Status read_tf(const fs::path& path) { return status_of(read_transforms(file_bytes(path))); }
Status read_markers(const fs::path& path) {
  static const NativeLayout& layout = *new NativeLayout("visualization_msgs/MarkerArray");
  return status_of(layout.to_native(file_bytes(path)));
}

void pings(const fs::path& path, std::size_t num_bytes) {
  write_pieces(path, num_bytes, "", [](std::size_t) { return std::string("\x8a\0", 2); });
}
void small_messages(const fs::path& path, std::size_t num_bytes) {
  write_pieces(path, num_bytes, "", [](std::size_t) { return std::string("\x81\x02{}", 4); });
}
/// A message as long as is taken, in parts of a byte.
void parts(const fs::path& path, std::size_t num_bytes) {
  write_pieces(path, num_bytes, "", [](std::size_t i) {
    const bool is_last = i % 200'000 == 199'999;
    const char first = i % 200'000 == 0 ? '\1' : is_last ? '\x80' : '\0';
    return std::string{first, '\1', ' '};
  });
}
void poses_vrpn(const fs::path& path, std::size_t num_bytes) {
  std::string message;
  append_vrpn_message({1, 3, 0, 4, std::string(64, '\0')}, 1, message);
  write_pieces(path, num_bytes, vrpn_cookie(), [&](std::size_t) { return message; });
}
void empty_vrpn(const fs::path& path, std::size_t num_bytes) {
  std::string message;
  append_vrpn_message({1, 3, 0, 4, ""}, 1, message);
  write_pieces(path, num_bytes, vrpn_cookie(), [&](std::size_t) { return message; });
}
void devices_json(const fs::path& path, std::size_t num_bytes) {
  write_pieces(
      path, num_bytes, R"({"inverse3":[{})",
      [](std::size_t) { return R"(,{"device_id":"A","state":{"x":[1,2e3,{}]}})"; }, "]}");
}
void lists_json(const fs::path& path, std::size_t num_bytes) {
  write_pieces(
      path, num_bytes, R"({"a":[0)", [](std::size_t) { return ",[]"; }, "]}");
}
void transforms(const fs::path& path, std::size_t num_bytes) {
  std::vector<RosTransform> all(num_bytes / 100, {"map", "cam", {}});
  write_pieces(path, 0, transform_message(5, all), nullptr);
}
void markers(const fs::path& path, std::size_t num_bytes) {
  std::vector<Sphere> spheres(num_bytes / 24, {{0, 0, 1}, 0.01f});
  const std::vector<RosSphere> states(spheres.size());
  write_pieces(path, 0, sphere_markers_message({1, "a"}, spheres, states), nullptr);
}

}  // namespace

std::vector<LargeInput> large_streams() {
  return {{"WebSocket", "pongs", true, pings, read_web_socket},
          {"WebSocket", "messages of Haply's service", true, small_messages, read_web_socket},
          {"WebSocket", "messages in parts of a byte", true, parts, read_web_socket},
          {"VRPN", "poses", true, poses_vrpn, read_vrpn},
          {"VRPN", "empty messages", true, empty_vrpn, read_vrpn},
          {"JSON", "devices of Haply's service", true, devices_json, read_json},
          {"JSON", "lists", true, lists_json, read_json},
          {"ROS 2", "transforms", true, transforms, read_tf},
          {"ROS 2", "markers", true, markers, read_markers}};
}

}  // namespace palpate::fuzz
