#include "src/devices/transport/web_socket.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <random>
#include <span>
#include <utility>

#include "src/core/internal/monotonic_clock.h"
#include "src/io/internal/base64.h"
#include "src/io/internal/hashes.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kMaxResponse = 64 * 1024;
constexpr std::string_view kBlankLine = "\r\n\r\n";

std::string lower_case(std::string_view text) {
  std::string lower(text);
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return lower;
}

/// The value of a header line; empty if there is none.
std::string_view header_value(std::string_view head, std::string_view name) {
  const std::string desired = lower_case(name) + ':';
  while (!head.empty()) {
    const std::size_t end = std::min(head.find("\r\n"), head.size());
    std::string_view line = head.substr(0, end);
    if (lower_case(line.substr(0, desired.size())) == desired) {
      line.remove_prefix(desired.size());
      const std::size_t first = line.find_first_not_of(" \t");
      if (first == std::string_view::npos) return {};
      return line.substr(first, line.find_last_not_of(" \t") - first + 1);
    }
    head.remove_prefix(std::min(end + 2, head.size()));
  }
  return {};
}

bool has_status(std::string_view head, std::string_view status) {
  return head.starts_with("HTTP/1.") && head.size() > 12 && head.substr(9, 3) == status;
}

/// One response: its head, and the part of its body received so far.
struct Response {
  std::string text;
  std::size_t body = std::string::npos;

  std::string_view head() const { return std::string_view(text).substr(0, body); }
};

/// Sends a request and waits for the head of the response.
Result<Response> exchange(TcpSocket& socket, const NetAddress& address, const std::string& request,
                          double deadline) {
  Response response;
  if (socket.write(request, deadline - monotonic_now())) {
    std::array<char, 4096> buffer;
    std::size_t count = 0;
    while (response.text.size() < kMaxResponse &&
           socket.read(buffer, count, std::max(1e-3, deadline - monotonic_now())) ==
               TcpSocket::Got::bytes) {
      response.text.append(buffer.data(), count);
      response.body = response.text.find(kBlankLine);
      if (response.body != std::string::npos) {
        response.body += kBlankLine.size();
        return response;
      }
    }
  }
  return Error{Errc::unavailable, describe(address) + " does not answer an HTTP request"};
}

std::string request_head(std::string_view path, const NetAddress& address) {
  return "GET " + std::string(path) + " HTTP/1.1\r\nHost: " + describe(address) + "\r\n";
}

}  // namespace

Result<std::string> http_get(const NetAddress& address, std::string_view path, double timeout) {
  const double deadline = monotonic_now() + timeout;
  Result<TcpSocket> socket = TcpSocket::connect(address, timeout);
  if (!socket) return socket.error();
  Result<Response> response = exchange(
      *socket, address, request_head(path, address) + "Connection: close\r\n\r\n", deadline);
  if (!response) return response.error();
  if (!has_status(response->head(), "200")) {
    return Error{Errc::not_found,
                 describe(address) + " does not know " + std::string(path) + " over HTTP"};
  }
  // The body ends with the connection or where its length says.
  std::size_t length = kMaxResponse;
  const std::string_view length_text = header_value(response->head(), "Content-Length");
  if (!length_text.empty() && length_text.size() < 7 &&
      std::all_of(length_text.begin(), length_text.end(),
                  [](unsigned char c) { return std::isdigit(c); }))
    length = std::min<std::size_t>(length, std::stoul(std::string(length_text)));
  std::string body = response->text.substr(response->body);
  std::array<char, 4096> buffer;
  std::size_t count = 0;
  while (body.size() < length &&
         socket->read(buffer, count, deadline - monotonic_now()) == TcpSocket::Got::bytes)
    body.append(buffer.data(), count);
  body.resize(std::min(body.size(), length));
  return body;
}

Result<WebSocket> WebSocket::connect(const NetAddress& address, double timeout) {
  const double deadline = monotonic_now() + timeout;
  Result<TcpSocket> socket = TcpSocket::connect(address, timeout);
  if (!socket) return socket.error();

  std::random_device random;
  std::array<std::uint8_t, 16> nonce;
  for (std::uint8_t& byte : nonce) byte = static_cast<std::uint8_t>(random());
  const std::string key = base64(nonce);
  const std::string request = request_head("/", address) +
                              "Upgrade: websocket\r\nConnection: Upgrade\r\n"
                              "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: " +
                              key + "\r\n\r\n";
  const Result<Response> response = exchange(*socket, address, request, deadline);
  if (!response) return response.error();
  const std::string accepted = base64(sha1(key + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"));
  if (!has_status(response->head(), "101") ||
      header_value(response->head(), "Sec-WebSocket-Accept") != accepted) {
    return Error{Errc::bad_input, describe(address) + " does not speak the WebSocket protocol"};
  }

  WebSocket web_socket(std::move(*socket));
  web_socket.mask_ = random();
  web_socket.frame_.reserve(4096);
  const std::string_view rest = std::string_view(response->text).substr(response->body);
  std::copy(rest.begin(), rest.end(), web_socket.reader_.space().begin());
  web_socket.reader_.added(rest.size());
  return web_socket;
}

WebSocket::Got WebSocket::receive(std::string_view& message, double timeout) noexcept {
  const double deadline = timeout > 0 ? monotonic_now() + timeout : 0;
  for (;;) {
    switch (reader_.next(message)) {
      case WebSocketReader::Got::message: return Got::message;
      case WebSocketReader::Got::ping:
        if (!send(WebSocketOpcode::pong, message, 0)) return Got::closed;
        continue;
      case WebSocketReader::Got::close:
      case WebSocketReader::Got::broken: return Got::closed;
      case WebSocketReader::Got::nothing: break;
    }
    std::size_t count = 0;
    const double left = timeout > 0 ? deadline - monotonic_now() : 0;
    switch (socket_.read(reader_.space(), count, left)) {
      case TcpSocket::Got::bytes: reader_.added(count); break;
      case TcpSocket::Got::nothing: return Got::nothing;
      case TcpSocket::Got::closed: return Got::closed;
    }
  }
}

bool WebSocket::send(std::string_view text, double timeout) noexcept {
  return send(WebSocketOpcode::text, text, timeout);
}

bool WebSocket::send(WebSocketOpcode opcode, std::string_view payload, double timeout) noexcept {
  // Masks keep caches on the way from taking payload for HTTP: any sequence will do.
  mask_ = mask_ * 1664525u + 1013904223u;
  write_web_socket_frame(opcode, payload, mask_, frame_);
  return socket_.write(frame_, timeout);
}

void WebSocket::close() noexcept {
  send(WebSocketOpcode::close, "", 0.05);
  socket_.finish(0.1);
}

}}  // namespace palpate::v0
