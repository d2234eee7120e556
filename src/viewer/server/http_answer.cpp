#include "src/viewer/server/http_answer.h"

#include <algorithm>

#include "src/pages/internal/pages.h"
#include "src/viewer/server/access.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::string_view kNoPage = R"(<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Palpate</title></head><body>
<h1>This build of Palpate has no page</h1>
<p>Scripts can use it all the same: see docs/viewer-protocol.md. To get the page, install Node.js 18
or newer with npm (make setup does), configure with -DPALPATE_PAGE=ON, and build again.</p>
</body></html>
)";

HttpAnswer wrong_method(std::string_view allow) {
  HttpAnswer answer = http_error(405, "here one can only " + std::string(allow));
  answer.allow = allow;
  return answer;
}

/// The page's files are no secret: they need no token, which what a page loads would not carry.
HttpAnswer answer_file(const HttpQuestion& question) {
  const std::string_view path = question.path();
  const auto files = page_files();
  const auto file = std::find_if(files.begin(), files.end(),
                                 [path](const PageFile& each) { return each.path == path; });
  if (file == files.end()) {
    if (path == "/") return {.type = "text/html; charset=utf-8", .text = std::string(kNoPage)};
    if (path == "/favicon.ico") return {.status = 204};
    return http_error(404, "there is nothing here");
  }
  const auto& accepted = question.accept_encoding;
  if (accepted && accepted->find("gzip") == std::string_view::npos &&
      accepted->find('*') == std::string_view::npos)
    return http_error(406, "the page is stored compressed: accept the encoding gzip");
  return {.type = file->type, .gzip = file->gzip};
}

HttpAnswer answer_command(std::string_view body, ViewHub& hub) {
  ViewRequest request = parse_request(body);
  if (request.error.empty() && (request.command == "show" || request.command == "get"))
    request.error = "\"" + request.command + "\" is for the WebSocket /ws";
  if (request.error.empty() && request.command.empty())
    request.error = "there is nothing to acknowledge here";
  ViewHub::Answer answer = hub.execute(request, body);
  return {.status = answer.is_ok ? 200 : 400, .text = std::move(answer.text)};
}

HttpAnswer answer_api(const HttpQuestion& question, ViewHub& hub, double now) {
  const std::string_view path = question.path();
  const bool is_read = question.method == "GET" || question.method == "HEAD";
  if (path == "/api/hello") return is_read ? HttpAnswer{.text = hub.hello()} : wrong_method("GET");
  if (path == "/api/state")
    return is_read ? HttpAnswer{.text = *hub.fresh_state(now).bytes} : wrong_method("GET");
  if (path == "/api/command")
    return question.method == "POST" ? answer_command(question.body, hub) : wrong_method("POST");
  if (path == "/ws") return http_error(426, "this is a WebSocket: ask for an upgrade");
  return http_error(404, "there is nothing here");
}

}  // namespace

HttpAnswer http_error(int status, std::string_view error) {
  return {.status = status, .text = error_text(nullptr, error)};
}

HttpAnswer answer_http(const HttpQuestion& question, std::string_view token, ViewHub& hub,
                       double now) {
  if (const auto refusal = refuse_stranger(question, token)) return *refusal;
  if (question.path() == "/ws" || question.path().starts_with("/api/")) {
    if (const auto refusal = refuse_without_token(question, token)) return *refusal;
    return answer_api(question, hub, now);
  }
  if (question.method != "GET" && question.method != "HEAD") return wrong_method("GET");
  return answer_file(question);
}

}}  // namespace palpate::v0
