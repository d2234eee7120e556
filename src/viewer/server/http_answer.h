// The used parts of an HTTP request, and the answer to it.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "src/viewer/server/view_hub.h"

namespace palpate { inline namespace v0 {

/// Headers that are not there are nullopt.
struct HttpQuestion {
  std::string_view method, target;
  std::optional<std::string_view> host, origin, authorization, accept_encoding;
  std::string_view body;

  std::string_view path() const { return target.substr(0, target.find('?')); }
};

struct HttpAnswer {
  int status = 200;
  std::string_view type = "application/json";
  std::string text = {};
  std::span<const unsigned char> gzip = {};  ///< instead of the text
  std::string_view allow = {};               ///< methods, with status 405
};
/// Returns an error with a sentence for the client.
HttpAnswer http_error(int status, std::string_view error);

/// Answers everything but the WebSocket.
HttpAnswer answer_http(const HttpQuestion& question, std::string_view token, ViewHub& hub,
                       double now);

}}  // namespace palpate::v0
