#include "tests/devices/vrpn_server.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>

namespace palpate::test {
namespace {

constexpr double kMass = 0.2, kDamping = 3, kStiffness = 200;  // of the hand
constexpr std::int32_t kSender = 3, kPose = 5, kVelocity = 6, kButton = 9, kError = 11;

// Written once more, by the book: the code under test has its own.
template <class T>
void put(std::string& bytes, T value) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), &value, sizeof value);
  std::reverse(raw.begin(), raw.end());  // little-endian host
  bytes.append(raw.data(), raw.size());
}

template <class T>
T get(const std::string& bytes, std::size_t offset) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), bytes.data() + offset, sizeof(T));
  std::reverse(raw.begin(), raw.end());
  T value;
  std::memcpy(&value, raw.data(), sizeof value);
  return value;
}

std::string named(const std::string& name) {
  std::string payload;
  put(payload, static_cast<std::int32_t>(name.size() + 1));
  return payload + name + '\0';
}

std::string cookie_of(const std::string& text) {
  std::string cookie = text;
  cookie.resize(24, '\0');
  return cookie;
}

bool send_all(int socket, const std::string& bytes) {
  return ::send(socket, bytes.data(), bytes.size(), MSG_NOSIGNAL) ==
         static_cast<ssize_t>(bytes.size());
}

/// Appends the bytes that have come to `received`; false if the other side has closed.
bool receive(int socket, std::string& received) {
  std::array<char, 4096> buffer;
  ssize_t count = 0;
  while ((count = ::recv(socket, buffer.data(), buffer.size(), MSG_DONTWAIT)) > 0)
    received.append(buffer.data(), static_cast<std::size_t>(count));
  return count < 0 && (errno == EAGAIN || errno == EINTR);
}

}  // namespace

Vec3d FalconField::force_at(const Vec3d& position) {
  if (!is_active_) return {};
  for (std::size_t i = 0; i < current_.size(); ++i)
    current_[i] = smoothing_ * current_[i] + (1 - smoothing_) * desired_[i];
  const Vec3d offset = position - Vec3d{current_[0], current_[1], current_[2]};
  if (norm(offset) > current_[15]) return {};
  Vec3d force{current_[3], current_[4], current_[5]};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      force[i] += offset[j] * current_[static_cast<std::size_t>(6 + 3 * i + j)];
  return force;
}

VrpnServer::VrpnServer(const VrpnServerOptions& options)
    : options_(options), field_(options.smoothing) {
  listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ::bind(listener_, reinterpret_cast<sockaddr*>(&address), sizeof address);
  ::listen(listener_, 8);
  socklen_t size = sizeof address;
  ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
  port_ = ntohs(address.sin_port);
  thread_ = std::thread([this] { accept(); });
}

VrpnServer::~VrpnServer() {
  is_stopping_ = true;
  thread_.join();
  ::close(listener_);
}

void VrpnServer::accept() {
  while (!is_stopping_) {
    pollfd requested{listener_, POLLIN, 0};
    if (::poll(&requested, 1, 5) <= 0) continue;
    const int socket = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
    if (socket < 0) continue;
    const int on = 1;
    ::setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    serve(socket);
    ::close(socket);
  }
}

void VrpnServer::serve(int socket) {
  {
    const std::lock_guard lock(mutex_);
    last_sequence_ = -1;
    field_type_ = -100;
    reported_buttons_ = 0;
  }
  send_all(socket, cookie_of(options_.cookie));
  send(socket, 0, -1, named("VRPN Control"));
  send(socket, kSender, -1, named(options_.device));
  send(socket, 1, -2, named("vrpn_Base pong_message"));
  send(socket, kPose, -2, named("vrpn_Tracker Pos_Quat"));
  send(socket, kVelocity, -2, named("vrpn_Tracker Velocity"));
  send(socket, kButton, -2, named("vrpn_Button Change"));
  send(socket, kError, -2, named("vrpn_ForceDevice Force_Error"));
  send(socket, 1234, -3, "127.0.0.1");  // a UDP port that nobody needs

  std::string received;
  bool has_cookie = false;
  auto next = std::chrono::steady_clock::now();
  for (int number = 0; !is_stopping_ && !closes; ++number) {
    next = std::max(next + std::chrono::nanoseconds(1'000'000'000 / options_.rate),
                    std::chrono::steady_clock::now());
    std::this_thread::sleep_until(next);
    const bool is_connected = receive(socket, received);
    if (!has_cookie && received.size() >= 24) {
      if (!received.starts_with("vrpn: ver. 07.")) return;
      received.erase(0, 24);
      has_cookie = true;
    }
    if (has_cookie) take(received);
    if (!is_connected) return;
    if (is_silent || report(socket, number)) continue;
    receive(socket, received);  // what the other side has sent before it closed
    if (has_cookie) take(received);
    return;
  }
  // Closing with messages unread would be an error to the other side instead of an end.
  ::shutdown(socket, SHUT_WR);
  while (!is_stopping_ && receive(socket, received)) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

bool VrpnServer::send(int socket, std::int32_t sender, std::int32_t type,
                      const std::string& payload) {
  const auto since = last_report_.time_since_epoch();  // when it was so, not when it is sent
  const auto now = std::chrono::duration_cast<std::chrono::microseconds>(since).count();
  std::string message;
  put(message, static_cast<std::int32_t>(24 + payload.size()));
  put(message, static_cast<std::int32_t>(has_no_clock ? 0 : now / 1000000));
  put(message, static_cast<std::int32_t>(has_no_clock ? 0 : now % 1000000));
  put(message, sender);
  put(message, type);
  put(message, std::int32_t{0});
  message += payload;
  message.resize((message.size() + 7) / 8 * 8, '\0');
  if (!dribbles) return send_all(socket, message);
  if (!send_all(socket, message.substr(0, 11))) return false;
  std::this_thread::sleep_for(std::chrono::microseconds(200));
  return send_all(socket, message.substr(11));
}

bool VrpnServer::report(int socket, int number) {
  if (sends_garbage) return send_all(socket, std::string(100, '\x55'));
  if (stops_in_message) {
    std::string half;
    put(half, std::int32_t{88});
    is_silent = true;
    return send_all(socket, half + std::string(30, '\0'));
  }
  if (sends_huge_length) {
    std::string head;
    put(head, std::int32_t{0x7fffffff});
    return send_all(socket, head + std::string(20, '\0'));
  }
  std::string pose, velocity, button, error;
  {
    const std::lock_guard lock(mutex_);
    // Velocities are by the clock: as much happens as time has passed, however late this report is.
    const auto time = std::chrono::steady_clock::now();
    const double passed = std::chrono::duration<double>(time - last_report_).count();
    last_report_ = time;
    constexpr double kLongest = 0.05, kStep = 2.5e-4;  // s
    const int num_steps = std::max(1, static_cast<int>(std::min(passed, kLongest) / kStep));
    const double step = std::min(passed, kLongest) / num_steps;
    force_ = field_.force_at(position_);
    for (int i = 0; i < num_steps; ++i) {
      const Vec3d sum = force_ - velocity_ * kDamping - (position_ - target_) * kStiffness;
      velocity_ += sum * (step / kMass);
      position_ += velocity_ * step;
    }
    put(pose, std::int32_t{0});
    put(pose, std::int32_t{0});
    const double away = is_wild && number % 2 == 0 ? 1e300 : 1;
    const double longer = is_wild && number % 2 == 1 ? 1e-160 : 1;
    for (int i = 0; i < 3; ++i) put(pose, away * position_[i] + (trembles ? 1e-9 * number : 0));
    for (double q : {rotation_.x, rotation_.y, rotation_.z, rotation_.w}) put(pose, longer * q);
    put(velocity, std::int32_t{0});
    put(velocity, std::int32_t{0});
    const Vec3d reported = ends_velocities ? Vec3d{1, 0, 0} : velocity_ * options_.velocity_unit;
    for (int i = 0; i < 3; ++i) put(velocity, reported[i]);
    for (int i = 0; i < 5; ++i) put(velocity, 0.0);  // as a Falcon's server does
    if (!options_.reports_velocity || have_ended_) velocity.clear();
    have_ended_ = ends_velocities;
    const std::uint32_t changed = buttons ^ reported_buttons_;
    for (std::int32_t i = 0; i < 4 && changed != 0; ++i) {
      if (!(changed >> i & 1)) continue;
      put(button, i);
      put(button, static_cast<std::int32_t>(buttons >> i & 1));
      reported_buttons_ ^= 1u << i;
      break;
    }
    if (force_error != 4) put(error, static_cast<std::int32_t>(force_error));
  }
  // Another sensor and another device must not confuse anybody.
  std::string other = pose;
  other[3] = 1;
  return send(socket, kSender, kPose, other) && send(socket, 0, kPose, std::string(64, '\x7f')) &&
         send(socket, kSender, kPose, pose) &&
         (velocity.empty() || send(socket, kSender, kVelocity, velocity)) &&
         (button.empty() || send(socket, kSender, kButton, button)) &&
         (error.empty() || number % 10 != 0 || send(socket, kSender, kError, error));
}

void VrpnServer::take(std::string& received) {
  const std::lock_guard lock(mutex_);
  while (received.size() >= 24) {
    const auto length = get<std::int32_t>(received, 0);
    const auto sender = get<std::int32_t>(received, 12);
    const auto type = get<std::int32_t>(received, 16);
    const auto sequence = get<std::int32_t>(received, 20);
    if (length < 24 || length > 10000 || sequence != last_sequence_ + 1) {
      ++num_bad_messages_;
      received.clear();
      return;
    }
    const std::size_t size = (static_cast<std::size_t>(length) + 7) / 8 * 8;
    if (received.size() < size) return;
    last_sequence_ = sequence;
    const std::string payload = received.substr(24, static_cast<std::size_t>(length) - 24);
    received.erase(0, size);
    if (type == -2) {
      const std::string name = payload.substr(4, payload.size() - 5);
      if (name == "vrpn_ForceDevice Force_Field") field_type_ = sender;
      names_.push_back(name);
    } else if (type == field_type_) {
      if (payload.size() != 64) {
        ++num_bad_messages_;
        continue;
      }
      std::array<float, 16> field;
      for (std::size_t i = 0; i < 16; ++i) field[i] = get<float>(payload, 4 * i);
      fields_.push_back(field);
      field_.set(field);
    }
  }
}

void VrpnServer::set_target(const Vec3d& target, const Quaternion& rotation) {
  const std::lock_guard lock(mutex_);
  target_ = position_ = target;
  rotation_ = rotation;
}
Vec3d VrpnServer::hand_position() const {
  const std::lock_guard lock(mutex_);
  return position_;
}
Vec3d VrpnServer::hand_force() const {
  const std::lock_guard lock(mutex_);
  return force_;
}
std::vector<std::array<float, 16>> VrpnServer::fields() const {
  const std::lock_guard lock(mutex_);
  return fields_;
}
std::vector<std::string> VrpnServer::names() const {
  const std::lock_guard lock(mutex_);
  return names_;
}

}  // namespace palpate::test
