// What the server's connections share. Only view_server.cpp includes what knows Boost.Beast, which
// takes long to compile.
#pragma once

#define BOOST_ASIO_DISABLE_FENCED_BLOCK  // one thread; the thread sanitizer knows no fences

#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http.hpp>
#include <chrono>
#include <cstddef>
#include <functional>
#include <list>
#include <string>

#include "src/viewer/view_hub.h"

namespace palpate::inline v0 {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using asio::ip::tcp;
using boost::system::error_code;

inline constexpr std::size_t kMaxMessage = 64 * 1024;

class HttpConnection;
class PageSocket;

/// What every connection knows of the server.
struct Shared {
  ViewHub hub;
  std::string token;
  std::size_t max_pages;
  std::list<HttpConnection*> connections = {};  // oldest first
  std::list<PageSocket*> pages = {};
  std::function<void()> wake = {};  // a page may want something now
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

}  // namespace palpate::inline v0
