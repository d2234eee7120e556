// A connection to the server, before it is a page.
#pragma once

#include "src/viewer/server/connections.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

#include "src/core/internal/monotonic_clock.h"
#include "src/viewer/server/access.h"
#include "src/viewer/server/http_answer.h"
#include "src/viewer/server/page_socket.h"

namespace palpate { inline namespace v0 {

/// HTTP, until it becomes a page or ends.
class HttpConnection : public std::enable_shared_from_this<HttpConnection> {
 public:
  HttpConnection(Shared& shared, tcp::socket socket)
      : shared_(shared),
        membership_(shared.connections, this),
        stream_(std::move(socket)),
        pause_(stream_.get_executor()) {}

  void read() {
    parser_.emplace();
    parser_->header_limit(kMaxHeader);
    parser_->body_limit(kMaxMessage);
    stream_.expires_after(shared_.limits.request_time);  // for the whole request
    http::async_read(stream_, buffer_, *parser_,
                     [self = shared_from_this()](error_code error, std::size_t) {
                       error ? self->refuse(error) : self->take(self->parser_->get());
                     });
  }

  void close() {
    membership_.leave();
    pause_.end();
    stream_.close();
  }

 private:
  static constexpr std::uint32_t kMaxHeader = 8 * 1024;
  static constexpr std::chrono::seconds kLingerTime{2};

  using Request = http::request<http::string_body>;

  void refuse(error_code error) {
    if (error == http::error::header_limit || error == http::error::buffer_overflow)
      return respond(http_error(431, "the request's headers are longer than 8 KiB"), false, false);
    if (error == http::error::body_limit)
      return respond(http_error(413, "a message is at most 64 KiB"), false, false);
    if (error == http::error::end_of_stream || error == http::error::partial_message) return;
    if (error.category() == http::make_error_code(http::error::bad_method).category())
      respond(http_error(400, "this is not HTTP: " + error.message()), false, false);
  }

  void take(const Request& request) {
    const HttpQuestion question = question_of(request);
    if (websocket::is_upgrade(request) && question.path() == "/ws") {
      const auto refusal = refuse_page(question);
      return refusal ? respond(*refusal, false, false) : become_page(request);
    }
    respond(answer_http(question, shared_.token, shared_.hub, monotonic_now()),
            request.method() == http::verb::head, request.keep_alive());
  }

  static HttpQuestion question_of(const Request& request) {
    const auto view = [](beast::string_view text) {
      return std::string_view(text.data(), text.size());
    };
    const auto header = [&](http::field name) -> std::optional<std::string_view> {
      switch (request.count(name)) {
        case 0: return std::nullopt;
        case 1: return view(request[name]);
        default: return "";  // contradictory, and matches nothing
      }
    };
    return {.method = view(request.method_string()),
            .target = view(request.target()),
            .host = header(http::field::host),
            .origin = header(http::field::origin),
            .authorization = header(http::field::authorization),
            .accept_encoding = header(http::field::accept_encoding),
            .body = request.body()};
  }

  std::optional<HttpAnswer> refuse_page(const HttpQuestion& question) const {
    if (auto refusal = refuse_stranger(question, shared_.token)) return refusal;
    if (auto refusal = refuse_without_token(question, shared_.token)) return refusal;
    if (shared_.pages.size() < shared_.max_pages) return std::nullopt;
    return http_error(503, "too many pages are open: close one of them");
  }

  void become_page(const Request& request) {
    membership_.leave();
    stream_.expires_never();  // pages have other limits
    std::make_shared<PageSocket>(shared_, std::move(stream_))->accept(request);
  }

  void respond(HttpAnswer answer, bool is_head, bool is_kept) {
    answer_ = std::move(answer);
    response_ = {};
    response_.result(static_cast<unsigned>(answer_.status));
    set_headers();
    const char* gzip = reinterpret_cast<const char*>(answer_.gzip.data());
    response_.body() = answer_.gzip.empty()
                           ? beast::span<const char>(answer_.text.data(), answer_.text.size())
                           : beast::span<const char>(gzip, answer_.gzip.size());
    response_.keep_alive(is_kept);
    response_.prepare_payload();
    serializer_.emplace(response_);
    stream_.expires_after(shared_.limits.answer_time);
    auto next = [self = shared_from_this(), is_kept](error_code error, std::size_t) {
      if (error) return;
      if (!is_kept) return self->print_closing();
      const double cost = message_cost(self->parser_->get().body().size());
      self->pause_.begin(self->limit_.take(monotonic_now(), cost), [self] { self->read(); });
    };
    is_head ? http::async_write_header(stream_, *serializer_, std::move(next))
            : http::async_write(stream_, *serializer_, std::move(next));
  }

  void set_headers() {
    if (!answer_.type.empty() && answer_.status != 204)
      response_.set(http::field::content_type,
                    beast::string_view(answer_.type.data(), answer_.type.size()));
    if (!answer_.gzip.empty()) response_.set(http::field::content_encoding, "gzip");
    if (!answer_.allow.empty())
      response_.set(http::field::allow,
                    beast::string_view(answer_.allow.data(), answer_.allow.size()));
    response_.set(http::field::cache_control, answer_.gzip.empty() ? "no-store" : "no-cache");
    // The page loads from here alone, cannot be shown inside another page, and sends nobody its
    // address, which may hold the token.
    response_.set("Content-Security-Policy",
                  "default-src 'self'; connect-src 'self'; img-src 'self' data: blob:; "
                  "style-src 'self' 'unsafe-inline'; object-src 'none'; base-uri 'none'; "
                  "form-action 'none'; frame-ancestors 'none'");
    response_.set("X-Content-Type-Options", "nosniff");
    response_.set("X-Frame-Options", "DENY");
    response_.set("Referrer-Policy", "no-referrer");
    response_.set("Cross-Origin-Resource-Policy", "same-origin");
    response_.set("Cross-Origin-Opener-Policy", "same-origin");
  }

  /// Reads incoming data for a moment: closing at once would take the answer away from a client
  /// that has not read it yet.
  void print_closing() {
    error_code ignored;
    stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
    stream_.expires_after(kLingerTime);
    drain();
  }
  void drain() {
    buffer_.clear();
    stream_.async_read_some(buffer_.prepare(4096),
                            [self = shared_from_this()](error_code error, std::size_t) {
                              if (!error) self->drain();
                            });
  }

  Shared& shared_;
  Membership<HttpConnection> membership_;
  beast::tcp_stream stream_;
  RateLimit limit_{kMessagesPerSecond, kMessagesAtOnce};
  Pause pause_;
  beast::flat_buffer buffer_{2 * kMaxMessage};
  std::optional<http::request_parser<http::string_body>> parser_;
  HttpAnswer answer_;
  http::response<http::span_body<const char>> response_;
  std::optional<http::response_serializer<http::span_body<const char>>> serializer_;
};

}}  // namespace palpate::v0
