#include "src/viewer/server/access.h"

#include <arpa/inet.h>

#include <algorithm>
#include <random>

namespace palpate { inline namespace v0 {
namespace {

bool is_digit(char c) { return c >= '0' && c <= '9'; }

std::string lower_case(std::string_view text) {
  std::string lower(text);
  for (char& c : lower)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return lower;
}

/// localhost, 127.x.y.z or [::1], with or without a port.
bool is_loopback(std::string_view host) {
  const std::size_t colon = host.find(':', host.starts_with('[') ? host.find(']') : 0);
  const std::string name = lower_case(host.substr(0, colon));
  if (colon != std::string_view::npos) {
    const std::string_view port = host.substr(colon + 1);
    if (port.empty() || port.size() > 5 || !std::all_of(port.begin(), port.end(), is_digit))
      return false;
  }
  in_addr address{};  // 127.evil.example is a name like any other
  return name == "localhost" || name == "[::1]" ||
         (name.starts_with("127.") && ::inet_pton(AF_INET, name.c_str(), &address) == 1);
}

/// Takes as long for a wrong first letter as for a wrong last one.
bool is_same(std::string_view given, std::string_view token) {
  if (given.size() != token.size()) return false;
  unsigned difference = 0;
  for (std::size_t i = 0; i < token.size(); ++i)
    difference |= static_cast<unsigned char>(given[i]) ^ static_cast<unsigned char>(token[i]);
  return difference == 0;
}

/// The value of `token=` in a target; empty: none.
std::string_view token_in(std::string_view target) {
  const std::size_t question_mark = target.find('?');
  std::string_view query =
      question_mark == std::string_view::npos ? "" : target.substr(question_mark + 1);
  constexpr std::string_view kName = "token=";
  while (!query.empty()) {
    const std::string_view pair = query.substr(0, query.find('&'));
    if (pair.starts_with(kName)) return pair.substr(kName.size());
    query.remove_prefix(std::min(pair.size() + 1, query.size()));
  }
  return {};
}

}  // namespace

bool is_good_token(std::string_view token) {
  return token.size() >= 16 && token.size() <= 128 &&
         std::all_of(token.begin(), token.end(), [](char c) {
           return is_digit(c) || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '-' ||
                  c == '_';
         });
}

std::string make_token() {
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::random_device random;  // the system's, not a generator of our own
  std::string token;
  for (int word = 0; word < 4; ++word) {
    unsigned bits = random();
    for (int digit = 0; digit < 8; ++digit, bits >>= 4) token += kDigits[bits & 15];
  }
  return token;
}

std::optional<HttpAnswer> refuse_stranger(const HttpQuestion& question, std::string_view token) {
  if (!question.host) return http_error(400, "the request must have one Host header");
  if (token.empty() && !is_loopback(*question.host)) {
    return http_error(403,
                      "this server answers only as localhost or 127.0.0.1; for other names start "
                      "it with a token");
  }
  if (question.origin) {
    const std::string origin = lower_case(*question.origin), host = lower_case(*question.host);
    if (origin != "http://" + host && origin != "https://" + host)
      return http_error(403, "pages of other origins may not use this server");
  }
  return std::nullopt;
}

std::optional<HttpAnswer> refuse_without_token(const HttpQuestion& question,
                                               std::string_view token) {
  if (token.empty()) return std::nullopt;
  constexpr std::string_view kBearer = "bearer ";
  std::string_view given = token_in(question.target);
  if (question.authorization &&
      lower_case(question.authorization->substr(0, kBearer.size())) == kBearer)
    given = question.authorization->substr(kBearer.size());
  if (is_same(given, token)) return std::nullopt;
  return http_error(401,
                    "the token is missing or wrong: use the whole address that palpate printed");
}

}}  // namespace palpate::v0
