// The page in a browser: HTTP and WebSocket on one port, from a thread of its own.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "palpate/viewer/view_source.h"

namespace palpate {

struct ViewServerOptions {
  /// Where to listen. Anything but a loopback address (127.0.0.0/8, ::1, localhost) needs a token,
  /// which is made if there is none.
  std::string address = "127.0.0.1";
  std::uint16_t port = 8787;  ///< 0: any free one
  std::string token = {};     ///< 16 to 128 letters, digits, - and _; empty: none on loopback
  int max_pages = 8;          ///< at a time
  /// What the options port, address and token begin with where a user gives them: for messages.
  std::string option_prefix = "--view-";
};

/// Serves until it is destroyed. Pages can neither slow nor block whom they look at: the server
/// asks the source at its own pace, a page gets the next picture when it has drawn the last one,
/// and what it missed meanwhile is left out. Requests whose Host or Origin is not the server's own
/// are refused, so that no other web page can read along or command.
class ViewServer {
 public:
  /// `source` must outlive it. Errors: the address cannot be used (port taken, not allowed), a bad
  /// token; what to do. A build without the page serves scripts, and a page that says so.
  static Result<std::unique_ptr<ViewServer>> start(ViewSource& source,
                                                   const ViewServerOptions& options = {});
  virtual ~ViewServer() = default;

  /// To open in a browser, with the token if there is one.
  virtual std::string url() const = 0;
  virtual int num_pages() const noexcept = 0;
};

}  // namespace palpate
