// The other end of the viewer's server: a WebSocket client, and plain sockets for what no honest
// client would send.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace palpate::test {

struct Received {
  std::string bytes;
  bool is_text = false;
};

/// A page as a program.
class PageClient {
 public:
  using Headers = std::vector<std::pair<std::string, std::string>>;

  /// `status` of the HTTP answer: 101 if it has become a WebSocket.
  explicit PageClient(int port, const std::string& target = "/ws", const Headers& headers = {});
  ~PageClient();
  int status() const;

  /// False: nothing came in this time, or the connection is over.
  bool receive(Received& message, double timeout = 10);
  bool is_open() const;
  bool send(const std::string& text, bool is_text = true);
  /// Sends a message in frames of `size` bytes.
  bool send_in_frames(const std::string& text, std::size_t size);
  /// The socket, to send bytes that are no WebSocket frame.
  int handle() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// A TCP connection to 127.0.0.1.
class RawSocket {
 public:
  explicit RawSocket(int port);
  ~RawSocket();
  RawSocket(const RawSocket&) = delete;
  RawSocket& operator=(const RawSocket&) = delete;

  bool is_open() const { return descriptor_ >= 0; }
  bool send(const std::string& bytes);
  /// Shuts down sending.
  void end();
  /// Receives until the other end closes, or for `timeout` s.
  std::string receive(double timeout = 10);
  /// True if the other end had closed at the last call of `receive`.
  bool is_closed() const { return is_closed_; }

 private:
  int descriptor_ = -1;
  bool is_closed_ = false;
};

/// Sends a request to 127.0.0.1 and reads the whole answer.
std::string http_request(int port, const std::string& request);
/// The status in an HTTP answer; 0: it is none.
int status_of(const std::string& answer);
/// Returns the part after the headers.
std::string body_of(const std::string& answer);

}  // namespace palpate::test
