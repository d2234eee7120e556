// Access control of the server: refuses requests from other web pages, and, with a token, from
// those without it.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "src/viewer/server/http_answer.h"

namespace palpate { inline namespace v0 {

/// True for 16 to 128 letters, digits, - and _.
bool is_good_token(std::string_view token);
/// Returns a token of 128 random bits.
std::string make_token();

/// Refuses a request that another web page may have caused, of its own or by a name that it has
/// pointed at this computer (DNS rebinding). Without a token, the server is addressed as localhost
/// or by a loopback address, at any port, as it may be forwarded; with one, by any name, as no
/// other page knows the token. An Origin must be the address itself.
std::optional<HttpAnswer> refuse_stranger(const HttpQuestion& question, std::string_view token);

/// Refuses a request without the token, if there is one. It is compared in constant time.
std::optional<HttpAnswer> refuse_without_token(const HttpQuestion& question,
                                               std::string_view token);

}}  // namespace palpate::v0
