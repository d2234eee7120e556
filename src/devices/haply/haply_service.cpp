#include "src/devices/haply/haply_service.h"

#include <string_view>
#include <utility>

namespace palpate { inline namespace v0 {
namespace {

constexpr HaplyVersion kOldest{3, 1};  // speaks the format of haply_messages.h

}  // namespace

std::string haply_url(const NetAddress& address) { return "ws://" + describe(address); }

Result<HaplyConnection> connect_to_haply(const NetAddress& address, double timeout) {
  Result<WebSocket> socket = WebSocket::connect(address, timeout);
  if (!socket) return socket.error();
  HaplyConnection connected{std::move(*socket), {}};
  std::string_view text;
  if (connected.socket.receive(text, timeout) != WebSocket::Got::message ||
      !read_haply_message(text, connected.inventory)) {
    return Error{
        Errc::bad_input,
        haply_url(address) + " does not say which devices it has, as an Inverse Service would"};
  }
  return connected;
}

Result<HaplyInventory> inspect_haply(const NetAddress& address, double timeout) {
  HaplyInventory found;
  if (const Result<std::string> body = http_get(address, "/version", timeout)) {
    found.version = read_haply_version(*body);
    if (found.version && *found.version < kOldest) {
      return Error{Errc::unavailable, "the Inverse Service at " + haply_url(address) +
                                          " is version " + std::to_string(found.version->major) +
                                          '.' + std::to_string(found.version->minor) +
                                          "; update it to 3.1 or newer"};
    }
  }
  const Result<HaplyConnection> connected = connect_to_haply(address, timeout);
  if (!connected) return connected.error();
  const HaplyMessage& inventory = connected->inventory;
  const HaplyEntry* arm = inventory.find(HaplyKind::inverse3);
  if (arm == nullptr) {
    return Error{Errc::not_found, "the Inverse Service at " + haply_url(address) +
                                      " has no Inverse3; connect one and switch it on"};
  }
  found.device_id = arm->id;
  for (HaplyKind kind :
       {HaplyKind::verse_grip, HaplyKind::wireless_verse_grip, HaplyKind::custom_verse_grip}) {
    const HaplyEntry* grip = inventory.find(kind);
    if (grip == nullptr || !grip->is_connected.value_or(true)) continue;
    found.grip_kind = kind;
    found.grip_id = grip->id;
    break;
  }
  return found;
}

std::string describe(const HaplyInventory& found, const NetAddress& address) {
  std::string text = "Inverse3 " + found.device_id;
  if (!found.grip_id.empty())
    text += " with " + std::string(name_of(found.grip_kind)) + ' ' + found.grip_id;
  text += " at " + haply_url(address);
  if (found.version) {
    text += " (service " + std::to_string(found.version->major) + '.' +
            std::to_string(found.version->minor) + ')';
  }
  return text;
}

}}  // namespace palpate::v0
