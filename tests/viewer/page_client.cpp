#define BOOST_ASIO_DISABLE_FENCED_BLOCK

#include "tests/viewer/page_client.h"

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <optional>

#include "src/core/internal/monotonic_clock.h"

namespace palpate::test {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace websocket = boost::beast::websocket;
using asio::ip::tcp;
using boost::system::error_code;

/// Beast does not tell with which status it was refused: requests again.
int refusal(int port, const std::string& host, const std::string& target,
            const PageClient::Headers& headers) {
  std::string request = "GET " + target + " HTTP/1.1\r\nHost: " + host +
                        "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: "
                        "dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n";
  for (const auto& [name, value] : headers)
    if (name != "Host") request += name + ": " + value + "\r\n";
  return status_of(http_request(port, request + "\r\n"));
}

}  // namespace

struct PageClient::Impl {
  asio::io_context context;
  websocket::stream<tcp::socket> stream{context};
  beast::flat_buffer buffer;
  bool is_reading = false, is_open = false;
  std::optional<error_code> read_result;
  int status = 0;
};

PageClient::PageClient(int port, const std::string& target, const Headers& headers)
    : impl_(std::make_unique<Impl>()) {
  auto& stream = impl_->stream;
  error_code error;
  stream.next_layer().connect({asio::ip::address_v4::loopback(), static_cast<std::uint16_t>(port)},
                              error);
  if (error) return;
  std::string host = "127.0.0.1:" + std::to_string(port);
  for (const auto& [name, value] : headers)
    if (name == "Host") host = value;
  stream.set_option(websocket::stream_base::decorator([&headers](websocket::request_type& request) {
    for (const auto& [name, value] : headers) request.set(name, value);
  }));
  stream.read_message_max(std::size_t{1} << 28);
  websocket::response_type response;
  stream.handshake(response, host, target, error);
  impl_->is_open = !error;
  impl_->status = error ? refusal(port, host, target, headers) : response.result_int();
}

PageClient::~PageClient() = default;

int PageClient::status() const { return impl_->status; }
bool PageClient::is_open() const { return impl_->is_open; }
int PageClient::handle() const { return impl_->stream.next_layer().native_handle(); }

bool PageClient::receive(Received& message, double timeout) {
  Impl& my = *impl_;
  if (!my.is_open) return false;
  if (!my.is_reading) {
    my.is_reading = true;
    my.read_result.reset();
    my.stream.async_read(my.buffer,
                         [&my](error_code error, std::size_t) { my.read_result = error; });
  }
  const double deadline = monotonic_now() + timeout;
  while (!my.read_result) {
    const double left = deadline - monotonic_now();
    if (left <= 0) return false;
    my.context.restart();
    my.context.run_one_for(std::chrono::microseconds(static_cast<std::int64_t>(1e6 * left) + 1));
  }
  my.is_reading = false;
  if (*my.read_result) {
    my.is_open = false;
    return false;
  }
  const auto data = my.buffer.cdata();
  message.bytes.assign(static_cast<const char*>(data.data()), data.size());
  message.is_text = my.stream.got_text();
  my.buffer.consume(my.buffer.size());
  return true;
}

bool PageClient::send(const std::string& text, bool is_text) {
  error_code error;
  impl_->stream.text(is_text);
  impl_->stream.write(asio::buffer(text), error);
  return !error;
}

bool PageClient::send_in_frames(const std::string& text, std::size_t size) {
  error_code error;
  impl_->stream.text(true);
  for (std::size_t i = 0; i < text.size() && !error; i += size) {
    const std::size_t count = std::min(size, text.size() - i);
    impl_->stream.write_some(i + count == text.size(), asio::buffer(text.data() + i, count), error);
  }
  return !error;
}

RawSocket::RawSocket(int port) : descriptor_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  if (::connect(descriptor_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    ::close(descriptor_);
    descriptor_ = -1;
  }
}

RawSocket::~RawSocket() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

bool RawSocket::send(const std::string& bytes) {
  std::size_t sent = 0;
  while (sent < bytes.size()) {
    const ssize_t count =
        ::send(descriptor_, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL);
    if (count <= 0) return false;
    sent += static_cast<std::size_t>(count);
  }
  return true;
}

void RawSocket::end() { ::shutdown(descriptor_, SHUT_WR); }

std::string RawSocket::receive(double timeout) {
  const double deadline = monotonic_now() + timeout;
  std::string bytes;
  for (;;) {
    const double left = deadline - monotonic_now();
    pollfd requested{descriptor_, POLLIN, 0};
    if (left <= 0) return bytes;
    if (::poll(&requested, 1, static_cast<int>(left * 1e3) + 1) <= 0) continue;  // or a signal
    char buffer[16384];
    const ssize_t count = ::recv(descriptor_, buffer, sizeof buffer, 0);
    if (count < 0 && errno == EINTR) continue;
    is_closed_ = count <= 0;
    if (is_closed_) return bytes;
    bytes.append(buffer, static_cast<std::size_t>(count));
  }
}

std::string http_request(int port, const std::string& request) {
  RawSocket socket(port);
  socket.send(request);
  return socket.receive();
}

int status_of(const std::string& answer) {
  return answer.starts_with("HTTP/1.1 ") ? std::atoi(answer.c_str() + 9) : 0;
}

std::string body_of(const std::string& answer) {
  const std::size_t end = answer.find("\r\n\r\n");
  return end == std::string::npos ? "" : answer.substr(end + 4);
}

}  // namespace palpate::test
