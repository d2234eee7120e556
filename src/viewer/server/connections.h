// Shared state of the server's connections. Only view_server.cpp includes headers with Boost.Beast,
// which takes long to compile.
#pragma once

#define BOOST_ASIO_DISABLE_FENCED_BLOCK  // one thread; the thread sanitizer knows no fences

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http.hpp>
#include <chrono>
#include <cstddef>
#include <functional>
#include <list>
#include <string>
#include <utility>

#include "src/viewer/server/door_limits.h"
#include "src/viewer/server/rate_limit.h"
#include "src/viewer/server/view_hub.h"

namespace palpate { inline namespace v0 {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using asio::ip::tcp;
using boost::system::error_code;

inline constexpr std::size_t kMaxMessage = 64 * 1024;
/// Rate limits of one connection: messages of a page, or requests. A page that holds the tool sends
/// one for every frame of its screen and one for every picture.
inline constexpr double kMessagesPerSecond = 1000, kMessagesAtOnce = 1000;
/// Returns the cost of a message in the rate limit: long ones take longer to read.
inline double message_cost(std::size_t num_bytes) {
  return 1 + static_cast<double>(num_bytes) / 4096;
}

class HttpConnection;
class PageSocket;

/// Calls a function after a delay, at once if that is 0; never once its connection has ended.
class Pause {
 public:
  explicit Pause(const asio::any_io_executor& executor) : timer_(executor) {}
  template <class Then>
  void begin(double seconds, Then then) {
    if (seconds <= 0) return then();
    timer_.expires_after(std::chrono::duration_cast<std::chrono::steady_clock::duration>(
        std::chrono::duration<double>(seconds)));
    is_on_ = true;
    timer_.async_wait([this, then = std::move(then)](error_code error) {
      is_on_ = false;
      if (!error) then();
    });
  }
  bool is_on() const { return is_on_; }
  void end() { timer_.cancel(); }

 private:
  asio::steady_timer timer_;
  bool is_on_ = false;
};

/// State of the server that every connection uses.
struct Shared {
  ViewHub hub;
  std::string token;
  std::size_t max_pages;
  DoorLimits limits;
  std::list<HttpConnection*> connections = {};  // oldest first
  std::list<PageSocket*> pages = {};
  std::function<void()> wake = {};  // call it when a page may need data now
};

/// A member of a list of raw pointers, for as long as it lives or until it leaves.
template <class T>
class Membership {
 public:
  Membership(std::list<T*>& list, T* member)
      : list_(list), place_(list.insert(list.end(), member)) {}
  Membership(const Membership&) = delete;
  Membership& operator=(const Membership&) = delete;
  ~Membership() { leave(); }
  void leave() {
    if (place_ != list_.end()) list_.erase(place_);
    place_ = list_.end();
  }

 private:
  std::list<T*>& list_;
  typename std::list<T*>::iterator place_;
};

}}  // namespace palpate::v0
