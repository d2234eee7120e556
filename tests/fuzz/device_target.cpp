// Messages of devices and services: Haply's JSON, WebSocket frames, VRPN, spacenavd. The first
// byte says which; streams come in pieces of a size that the second byte gives.
#include <sys/socket.h>
#include <sys/un.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "src/devices/haply/haply_messages.h"
#include "src/devices/haply/json_scanner.h"
#include "src/devices/spacenav/spacenav_connection.h"
#include "src/devices/transport/web_socket_frames.h"
#include "src/devices/vrpn/vrpn_wire.h"
#include "tests/fuzz/target.h"

namespace palpate::fuzz {
namespace {

constexpr char kJson = 'j', kWebSocket = 'w', kVrpn = 'v', kSpacenav = 's';

void read_json(std::string_view text) {
  HaplyMessage message;
  if (read_haply_message(text, message)) {
    require(message.num_entries <= message.entries.size(), "entries are those there is room for");
    (void)message.find(HaplyKind::inverse3);
  }
  HaplyEvent event;
  (void)read_haply_event(text, event);
  (void)read_haply_version(text);
  // Whatever is JSON, the scanner passes over; it may be more generous. The other parser takes a
  // mark of UTF-8 and ends at a zero, which is neither here nor there.
  JsonScanner scanner(text);
  scanner.skip();
  const auto num = [text](char c) { return std::count(text.begin(), text.end(), c); };
  const bool is_deep = num('{') + num('[') > 20;
  const bool is_odd = num('\0') > 0 || text.starts_with('\xef');
  if (!is_deep && !is_odd && nlohmann::json::accept(text.begin(), text.end())) {
    require(scanner.is_complete(), "the scanner takes all JSON");
  }
}

/// Feeds a reader of a stream piece by piece; take() is false once it is broken.
template <class Reader, class Take>
void feed(Reader& reader, std::string_view bytes, std::size_t piece, const Take& take) {
  while (!bytes.empty()) {
    const std::span<char> space = reader.space();
    require(!space.empty(), "a reader that wants more has space");
    const std::size_t count = std::min({piece, bytes.size(), space.size()});
    std::copy_n(bytes.begin(), count, space.begin());
    reader.added(count);
    bytes.remove_prefix(count);
    if (!take()) return;
  }
}

void read_web_socket(std::string_view bytes, std::size_t piece) {
  WebSocketReader reader;
  feed(reader, bytes, piece, [&] {
    for (;;) {
      std::string_view payload;
      const auto got = reader.next(payload);
      if (got == WebSocketReader::Got::nothing) return true;
      if (got == WebSocketReader::Got::broken) {
        require(reader.next(payload) == WebSocketReader::Got::broken, "broken stays broken");
        return false;
      }
      require(payload.size() <= WebSocketReader::kMaxMessage, "messages keep to the limit");
      if (got == WebSocketReader::Got::message) read_json(payload);
    }
  });
}

void read_vrpn(std::string_view bytes, std::size_t piece) {
  VrpnReader reader;
  feed(reader, bytes, piece, [&] {
    for (;;) {
      VrpnMessage message;
      const auto got = reader.next(message);
      if (got == VrpnReader::Got::nothing) return true;
      if (got == VrpnReader::Got::broken) return false;
      if (got == VrpnReader::Got::cookie) continue;
      require(message.payload.size() <= VrpnReader::kMaxPayload, "payloads keep to the limit");
      std::string_view name;
      (void)read_vrpn_name(message.payload, name);
      VrpnPose pose;
      if (read_vrpn_pose(message.payload, pose)) (void)norm(pose.X_BH.translation);
      VrpnVelocity velocity;
      (void)read_vrpn_velocity(message.payload, velocity);
      std::int32_t number = 0;
      bool is_down = false;
      (void)read_vrpn_button(message.payload, number, is_down);
      std::uint32_t buttons = 0;
      (void)read_vrpn_buttons(message.payload, buttons);
      (void)read_vrpn_force_error(message.payload, number);
    }
  });
}

/// A daemon that sends what it is given.
class Daemon {
 public:
  Daemon() {
    socket_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    file_.path().string().copy(address.sun_path, sizeof address.sun_path - 1);
    const bool listens =
        ::bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 &&
        ::listen(socket_, 8) == 0;
    require(listens, "the daemon listens");
  }
  ~Daemon() { ::close(socket_); }

  void send(std::string_view bytes) {
    auto connection = SpacenavConnection::open(file_.path().string());
    require(connection.has_value(), "the daemon is met");
    const int peer = ::accept(socket_, nullptr, nullptr);
    const std::string_view sent = bytes.substr(0, 4096);
    require(
        ::send(peer, sent.data(), sent.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(sent.size()),
        "a little is sent at once");
    ::close(peer);
    SpacenavConnection::Event event{};
    std::size_t num_events = 0;
    while (connection->next(event) == SpacenavConnection::Answer::event) ++num_events;
    require(num_events <= sent.size() / sizeof event,
            "there are no more events than bytes for them");
  }

 private:
  ScratchFile file_{".spacenav"};
  int socket_ = -1;
};

std::string vrpn_seed() {
  std::string bytes = vrpn_cookie();
  const std::string name = vrpn_name("Phantom0");
  append_vrpn_message({1, 2, 0, kVrpnSenderDescription, name}, 0, bytes);
  append_vrpn_message({1, 3, 0, 4, std::string(64, '\0')}, 1, bytes);
  append_vrpn_message({1, 4, 0, 5, std::string(8, '\1')}, 2, bytes);
  return bytes;
}

std::string frame_seed(std::string_view payload) {
  std::string frame;
  write_web_socket_frame(WebSocketOpcode::text, payload, 0, frame);
  frame[1] = static_cast<char>(frame[1] & 0x7f);  // a server does not mask
  frame.erase(payload.size() < 126 ? 2 : 4, 4);
  return frame;
}

}  // namespace

std::vector<std::string> seeds() {
  const std::string state =
      R"({"inverse3":[{"device_id":"A14","state":{"cursor_position":{"x":0.1,"y":-2e-3,"z":0},)"
      R"("cursor_velocity":{"x":0,"y":0,"z":1},"current_cursor_force":{"x":0,"y":0,"z":0}}}],)"
      R"("wireless_verse_grip":[{"device_id":"6","state":{"orientation":{"w":1,"x":0,"y":0,"z":0},)"
      R"("buttons":{"a":true,"b":false}}}]})";
  return {kJson + (" " + state),
          std::string(1, kJson) +
              R"( {"event":"x","level":"warning","message":"\u00e9\n","n":[1,null]})",
          kWebSocket + ("\x07" + frame_seed(state) + "\x89\x01z" + frame_seed("{}")),
          kVrpn + ("\x10" + vrpn_seed()),
          std::string(1, kSpacenav) + " " + std::string(32, '\0') + std::string("\1\0\0\0", 4) +
              std::string(28, '\3')};
}

}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate::fuzz;
  if (size < 2) return 0;
  const std::string_view bytes = text_of(data + 2, size - 2);
  const std::size_t piece = data[1] + std::size_t(1);
  static Daemon daemon;
  switch (data[0]) {
    case kJson: read_json(bytes); break;
    case kWebSocket: read_web_socket(bytes, piece); break;
    case kVrpn: read_vrpn(bytes, piece); break;
    case kSpacenav: daemon.send(bytes); break;
    default: break;
  }
  return 0;
}
