// Messages to one page, in their order.
#pragma once

#include <cstdint>
#include <deque>
#include <string_view>
#include <vector>

#include "src/viewer/server/view_hub.h"

namespace palpate { inline namespace v0 {

/// Holds no more than the picture that is being sent and a few answers, whatever the page does: the
/// next picture is made of the newest data when the page has acknowledged the last one.
class PageOutbox {
 public:
  /// The first messages are hello and state.
  explicit PageOutbox(ViewHub& hub);
  ~PageOutbox();
  PageOutbox(const PageOutbox&) = delete;
  PageOutbox& operator=(const PageOutbox&) = delete;

  /// Takes a text message of the page; one of another kind is answered with an error.
  void receive(std::string_view text);
  void receive_binary();
  /// True if the page must not be read from until it has taken some answers.
  bool is_full() const { return answers_.size() >= kMaxAnswers; }

  /// Returns the next message to the page; null: nothing now.
  ViewMessage next(double now);
  /// Returns the page's subscription: samples alone if it has not drawn for a second, e.g. in a
  /// hidden tab, so that no pictures are made for it.
  ViewSubscription subscription(double now) const;

 private:
  static constexpr std::size_t kMaxAnswers = 16;

  void acknowledge(const ViewRequest& request);
  void show(const ViewRequest& request);
  void get(const ViewRequest& request);
  void move(const ViewRequest& request);
  void say(const ViewRequest& request, const Status& status);
  bool wants(PicturePart part) const;
  void begin_picture(double now);

  ViewHub& hub_;
  std::uint64_t number_;
  ViewSubscription subscription_;
  std::uint64_t poll_of_subscription_ = 0;  // pictures come of later polls than this
  std::deque<ViewMessage> answers_;         // and requested data
  std::uint64_t sent_state_ = 0;

  std::deque<ViewMessage> picture_;  // parts not yet sent
  std::uint64_t picture_number_ = 0;
  double picture_time_ = 0;
  bool awaits_ack_ = false;
  std::vector<std::uint64_t> sent_parts_;  // the number of each
  std::uint64_t next_sample_ = 0;          // a new page begins with the hub's oldest
};

}}  // namespace palpate::v0
