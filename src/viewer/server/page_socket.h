// A page's WebSocket.
#pragma once

#include "src/viewer/server/connections.h"

#include <algorithm>
#include <boost/beast/websocket.hpp>
#include <memory>
#include <optional>
#include <utility>

#include "src/core/internal/monotonic_clock.h"
#include "src/viewer/server/page_outbox.h"

namespace palpate { inline namespace v0 {

namespace websocket = boost::beast::websocket;

/// A WebSocket. Lives as long as it reads or writes.
class PageSocket : public std::enable_shared_from_this<PageSocket> {
 public:
  PageSocket(Shared& shared, beast::tcp_stream stream)
      : shared_(shared),
        membership_(shared.pages, this),
        socket_(std::move(stream)),
        pause_(socket_.get_executor()) {
    socket_.set_option(websocket::stream_base::timeout{kHandshakeTime, kSilence, true});
    socket_.read_message_max(kMaxMessage);
    socket_.auto_fragment(false);
  }

  void accept(const http::request<http::string_body>& request) {
    socket_.async_accept(request, [self = shared_from_this()](error_code error) {
      if (error) return;
      self->outbox_.emplace(self->shared_.hub);
      self->read();
      self->pump(monotonic_now());
    });
  }

  /// Starts sending the next message, if there is one.
  void pump(double now) {
    if (!outbox_ || is_writing_ || is_closed_) return;
    sending_ = outbox_->next(now);
    if (!sending_) return;
    num_sent_ = 0;
    socket_.text(sending_.is_text);
    write_piece(now);
  }

  void drop_if_stalled(double now) {
    if (is_writing_ && now > write_began_ + kStallTime) close();
  }

 private:
  static constexpr std::chrono::seconds kHandshakeTime{10}, kSilence{60};
  static constexpr double kStallTime = 10;  // s
  /// Size of the pieces of long messages, bytes: a slow connection differs from one that stalls.
  static constexpr std::size_t kPiece = 256 * 1024;

  void read() {
    is_reading_ = true;
    socket_.async_read(received_, [self = shared_from_this()](error_code error, std::size_t) {
      self->is_reading_ = false;
      if (error) return self->close();
      const double cost = message_cost(self->received_.size());
      self->receive();
      const double now = monotonic_now();
      self->pump(now);
      self->pause_.begin(self->limit_.take(now, cost), [self] { self->read_if_it_may(); });
    });
  }

  void receive() {
    if (socket_.got_text()) {
      const auto data = received_.cdata();
      outbox_->receive({static_cast<const char*>(data.data()), data.size()});
    } else {
      outbox_->receive_binary();
    }
    received_.consume(received_.size());
    shared_.wake();
  }

  /// Reads, except from a page that takes no answers or, for a while, one that sends too much.
  void read_if_it_may() {
    if (!is_closed_ && !is_reading_ && !pause_.is_on() && !outbox_->is_full()) read();
  }

  void write_piece(double now) {
    const std::string& bytes = *sending_.bytes;
    const std::size_t count = std::min(kPiece, bytes.size() - num_sent_);
    const bool is_last = num_sent_ + count == bytes.size();
    is_writing_ = true;
    write_began_ = now;
    socket_.async_write_some(
        is_last, asio::buffer(bytes.data() + num_sent_, count),
        [self = shared_from_this()](error_code error, std::size_t num_written) {
          self->is_writing_ = false;
          if (error) return self->close();
          self->num_sent_ += num_written;
          self->go_on();
        });
  }

  void go_on() {
    if (is_closed_) return;
    if (num_sent_ < sending_.bytes->size()) return write_piece(monotonic_now());
    sending_ = {};
    pump(monotonic_now());
    read_if_it_may();
  }

  /// Closes the socket: pending reads and writes end with an error.
  void close() {
    is_closed_ = true;
    pause_.end();
    beast::get_lowest_layer(socket_).close();
  }

  Shared& shared_;
  Membership<PageSocket> membership_;
  websocket::stream<beast::tcp_stream> socket_;
  RateLimit limit_{kMessagesPerSecond, kMessagesAtOnce};
  Pause pause_;
  beast::flat_buffer received_{2 * kMaxMessage};
  std::optional<PageOutbox> outbox_;  // once the handshake is done
  ViewMessage sending_;
  std::size_t num_sent_ = 0;
  double write_began_ = 0;
  bool is_reading_ = false, is_writing_ = false, is_closed_ = false;
};

}}  // namespace palpate::v0
