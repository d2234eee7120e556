// Nothing here hands work from thread to thread, and the thread sanitizer knows no fences.
#define BOOST_ASIO_DISABLE_FENCED_BLOCK

#include "tests/devices/haply_service.h"

#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <functional>
#include <list>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>
#include <utility>

namespace palpate::test {
namespace {

namespace asio = boost::asio;
namespace http = boost::beast::http;
namespace websocket = boost::beast::websocket;
using asio::ip::tcp;
using boost::system::error_code;
using nlohmann::json;

// The hand: mass, damping, and the spring towards its target.
constexpr double kMass = 0.2, kDamping = 3, kStiffness = 100;
constexpr double kStep = 2.5e-4;  // s

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

json to_json(const Vec3d& v) { return {{"x", v.x}, {"y", v.y}, {"z", v.z}}; }
Vec3d from_json(const json& v) { return {v.value("x", 0.0), v.value("y", 0.0), v.value("z", 0.0)}; }

/// Takes connections on a port of its own and gives each a thread.
class Listener {
 public:
  using Serve = std::function<void(tcp::socket&)>;

  Listener(asio::io_context& context, Serve serve)
      : acceptor_(context, {asio::ip::address_v4::loopback(), 0}),
        port_(acceptor_.local_endpoint().port()),
        serve_(std::move(serve)),
        thread_([this] { accept(); }) {}
  ~Listener() {
    {
      const std::lock_guard lock(mutex_);
      is_stopping_ = true;
      ::shutdown(acceptor_.native_handle(), SHUT_RDWR);
      for (const int handle : handles_) ::shutdown(handle, SHUT_RDWR);
    }
    thread_.join();
    for (std::thread& connection : connections_) connection.join();
  }
  int port() const { return port_; }

 private:
  void accept() {
    for (;;) {
      auto socket = std::make_unique<tcp::socket>(acceptor_.get_executor());
      error_code error;
      acceptor_.accept(*socket, error);
      const std::lock_guard lock(mutex_);
      if (is_stopping_ || error) return;
      socket->set_option(tcp::no_delay(true), error);
      handles_.push_back(socket->native_handle());
      connections_.emplace_back([this, socket = std::move(socket)] {
        const int handle = socket->native_handle();
        serve_(*socket);
        const std::lock_guard inner_lock(mutex_);
        handles_.remove(handle);
        error_code ignored;
        socket->close(ignored);
      });
    }
  }

  tcp::acceptor acceptor_;
  int port_;
  Serve serve_;
  std::mutex mutex_;
  bool is_stopping_ = false;
  std::list<int> handles_;
  std::list<std::thread> connections_;
  std::thread thread_;
};

}  // namespace

struct HaplyService::Impl {
  Impl(HaplyService& service, const HaplyServiceOptions& given) : outer(service), options(given) {
    if (options.has_events) {
      events.emplace(context, [this](tcp::socket& socket) { serve_events(socket); });
    }
    main.emplace(context, [this](tcp::socket& socket) { serve(socket); });
  }
  ~Impl() { is_stopping = true; }

  void serve(tcp::socket& socket);
  void serve_version(tcp::socket& socket, const http::request<http::string_body>& request);
  void serve_events(tcp::socket& socket);
  bool answer(websocket::stream<tcp::socket&>& stream);
  void execute(const json& message);
  void move_hand();
  json inventory(bool is_first);
  void sleep(int milliseconds) const;

  HaplyService& outer;
  const HaplyServiceOptions options;
  asio::io_context context;
  std::atomic<bool> is_stopping = false;

  mutable std::mutex mutex;
  Vec3d target, position, velocity, force;
  Quaternion orientation;
  double last_step = now(), last_message = 0;
  std::vector<Vec3d> forces;
  std::vector<std::string> messages;
  std::vector<std::string> pending_events;

  std::optional<Listener> events, main;  // last: they end first
};

void HaplyService::Impl::sleep(int milliseconds) const {
  const double end = now() + 1e-3 * milliseconds;
  while (now() < end && !is_stopping) std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

void HaplyService::Impl::move_hand() {
  for (const double time = now(); last_step < time; last_step += kStep) {
    if (last_step > last_message + options.force_timeout) force = {};
    const Vec3d sum = force - velocity * kDamping - (position - target) * kStiffness;
    velocity += sum * (kStep / kMass);
    position += velocity * kStep;
  }
}

json HaplyService::Impl::inventory(bool is_first) {
  const Faults& faults = outer.faults;
  json message = {{"session_id", 7}};
  if (options.has_arm && !faults.has_vanished) {
    json arm = {{"device_id", "049D"},
                {"status", {{"calibrated", faults.is_calibrated.load()}, {"ready", true}}}};
    arm["state"] = {{"cursor_position", to_json(position)},
                    {"cursor_velocity", to_json(velocity)},
                    {"angular_position", {{"a0", 0}, {"a1", 1}, {"a2", 2}}},
                    {"control_mode", norm(force) > 0 ? "cursor_force" : "idle"}};
    if (options.echoes_forces) arm["state"]["current_cursor_force"] = to_json(force);
    if (faults.leaves_fields_out) {
      arm["state"].erase("cursor_velocity");
      arm.erase("status");
      for (const char* key : {"x", "y", "z"}) {  // zeros may be missing
        if (arm["state"]["cursor_position"][key] == 0.0) arm["state"]["cursor_position"].erase(key);
      }
    }
    if (is_first) {
      arm["config"] = {{"type", "inverse3"}, {"mount", {{"x", {1, 2}}}}};
      if (!options.preset.empty()) arm["config"]["preset"] = options.preset;
    }
    message["inverse3"] = json::array({arm});
  } else {
    message["inverse3"] = json::array();
  }
  if (!options.grip.empty() && !faults.leaves_fields_out) {
    json grip = {{"device_id", "61548"}, {"state", json::object()}, {"status", json::object()}};
    const Quaternion& q = orientation;
    grip["state"]["orientation"] = {{"x", q.x}, {"y", q.y}, {"z", q.z}, {"w", q.w}};
    const std::uint32_t down = outer.buttons;
    if (options.grip == "verse_grip") {
      grip["state"]["button"] = (down & 1) != 0;
      grip["state"]["hall"] = 3;
    } else {
      grip["state"]["buttons"] = {{"a", (down & 1) != 0},
                                  {"b", (down & 2) != 0},
                                  {"c", (down & 4) != 0},
                                  {"home", (down & 8) != 0}};
      grip["status"] = {{"connected", outer.faults.is_grip_connected.load()}, {"awake", true}};
    }
    message[options.grip] = json::array({grip});
  }
  return message;
}

void HaplyService::Impl::execute(const json& message) {
  const std::lock_guard lock(mutex);
  move_hand();
  messages.push_back(message.dump());
  last_message = now();
  Vec3d sum;
  for (const json& device : message.value("inverse3", json::array())) {
    const json commands = device.value("commands", json::object());
    if (device.value("device_id", "") != "049D" || !commands.contains("set_cursor_force")) continue;
    const json& command = commands["set_cursor_force"];
    if (options.accepts_vector && command.contains("vector")) {
      sum += from_json(command["vector"]);
    } else if (options.accepts_values && command.contains("values")) {
      sum += from_json(command["values"]);
    }
    forces.push_back(sum);
  }
  force = sum;
}

/// False: the connection is over.
bool HaplyService::Impl::answer(websocket::stream<tcp::socket&>& stream) {
  const Faults& faults = outer.faults;
  error_code error;
  if (faults.pings) stream.ping("are you there", error);
  sleep(faults.reply_delay);
  if (faults.is_silent) return true;
  std::string text;
  if (faults.says_garbage) {
    text = R"({"inverse3":[{"device_id":"049D","state":{"cursor_pos)";
  } else {
    const std::lock_guard lock(mutex);
    move_hand();
    text = inventory(false).dump();
  }
  if (faults.closes_in_message) {
    const std::array<char, 8> half = {'\x81', 126, 1, 0, '{', '"', 'i', 'n'};
    asio::write(stream.next_layer(), asio::buffer(half), error);
    ::shutdown(stream.next_layer().native_handle(), SHUT_RDWR);
    return false;
  }
  if (faults.fragments_messages) {
    for (std::size_t i = 0; i < text.size() && !error; i += 40)
      stream.write_some(i + 40 >= text.size(),
                        asio::buffer(text.data() + i, std::min<std::size_t>(40, text.size() - i)),
                        error);
  } else {
    stream.write(asio::buffer(text), error);
  }
  return !error;
}

void HaplyService::Impl::serve_version(tcp::socket& socket,
                                       const http::request<http::string_body>& request) {
  const bool is_known = request.target() == "/version" && !options.version.empty();
  http::response<http::string_body> response(is_known ? http::status::ok : http::status::not_found,
                                             request.version());
  response.body() = is_known ? options.version : "";
  response.keep_alive(false);
  response.prepare_payload();
  error_code error;
  http::write(socket, response, error);
}

void HaplyService::Impl::serve(tcp::socket& socket) {
  boost::beast::flat_buffer buffer;
  http::request<http::string_body> request;
  error_code error;
  http::read(socket, buffer, request, error);
  if (error) return;
  if (!websocket::is_upgrade(request)) return serve_version(socket, request);
  websocket::stream<tcp::socket&> stream(socket);
  stream.accept(request, error);
  if (error) return;
  stream.text(true);
  std::string first;
  {
    const std::lock_guard lock(mutex);
    move_hand();
    first = inventory(true).dump();
  }
  stream.write(asio::buffer(first), error);
  while (!error) {
    boost::beast::flat_buffer received;
    stream.read(received, error);
    if (error) return;
    const json message = json::parse(
        static_cast<const char*>(received.data().data()),
        static_cast<const char*>(received.data().data()) + received.size(), nullptr, false);
    if (message.is_discarded()) return;  // a client that talks nonsense fails its test
    execute(message);
    if (!answer(stream)) return;
  }
}

void HaplyService::Impl::serve_events(tcp::socket& socket) {
  websocket::stream<tcp::socket&> stream(socket);
  error_code error;
  stream.accept(error);
  stream.text(true);
  while (!error && !is_stopping) {
    std::vector<std::string> events_now;
    {
      const std::lock_guard lock(mutex);
      events_now.swap(pending_events);
    }
    for (const std::string& event : events_now) stream.write(asio::buffer(event), error);
    sleep(1);
    char byte = 0;
    if (::recv(socket.native_handle(), &byte, 1, MSG_PEEK | MSG_DONTWAIT) == 0) return;
  }
}

HaplyService::HaplyService(const HaplyServiceOptions& options)
    : impl_(std::make_unique<Impl>(*this, options)) {}
HaplyService::~HaplyService() = default;

int HaplyService::port() const { return impl_->main->port(); }
int HaplyService::event_port() const { return impl_->events ? impl_->events->port() : 1; }

void HaplyService::set_target(const Vec3d& target) {
  const std::lock_guard lock(impl_->mutex);
  impl_->target = impl_->position = target;
}
void HaplyService::set_orientation(const Quaternion& orientation) {
  const std::lock_guard lock(impl_->mutex);
  impl_->orientation = orientation;
}
void HaplyService::push_event(std::string_view json) {
  const std::lock_guard lock(impl_->mutex);
  impl_->pending_events.emplace_back(json);
}
std::vector<Vec3d> HaplyService::forces() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->forces;
}
Vec3d HaplyService::last_force() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->forces.empty() ? Vec3d{} : impl_->forces.back();
}
std::vector<std::string> HaplyService::messages() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->messages;
}
Vec3d HaplyService::hand_position() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->position;
}

}  // namespace palpate::test
