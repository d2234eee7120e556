#include "src/viewer/server/page_outbox.h"

#include <string>
#include <utility>

namespace palpate { inline namespace v0 {
namespace {

constexpr double kPatience = 1;  // s, for an acknowledgement

}  // namespace

PageOutbox::PageOutbox(ViewHub& hub) : hub_(hub), sent_parts_(hub.num_parts()) {
  answers_.push_back(text_message(hub_.hello()));
  number_ = hub_.add(this);
}

/// Releases the tool of a page that goes away.
PageOutbox::~PageOutbox() {
  hub_.release(number_);
  hub_.remove(this);
}

void PageOutbox::receive(std::string_view text) {
  const ViewRequest request = parse_request(text);
  if (request.hand) return move(request);
  if (request.error.empty() && request.command.empty()) return acknowledge(request);
  if (request.error.empty() && request.command == "hold") return say(request, hub_.hold(number_));
  if (request.error.empty() && request.command == "release") {
    hub_.release(number_);
    return say(request, Done{});
  }
  if (request.error.empty() && request.command == "show") return show(request);
  if (request.error.empty() && request.command == "get") return get(request);
  answers_.push_back(text_message(hub_.execute(request, text).text));
}

/// Moves the tool. Poses come sixty times a second: only errors are answered.
void PageOutbox::move(const ViewRequest& request) {
  if (const Status status = hub_.move(number_, *request.hand); !status) say(request, status);
}

void PageOutbox::say(const ViewRequest& request, const Status& status) {
  answers_.push_back(text_message(status ? answer_text(request.id, "{}")
                                         : error_text(request.id, status.error().message)));
}

void PageOutbox::receive_binary() {
  answers_.push_back(text_message(error_text(nullptr, "messages to the server are JSON text")));
}

void PageOutbox::acknowledge(const ViewRequest& request) {
  // An acknowledgement of another picture, or before all of it was sent, does not count.
  if (picture_.empty() && request.json["ack"].get<std::uint64_t>() == picture_number_)
    awaits_ack_ = false;
}

void PageOutbox::show(const ViewRequest& request) {
  ViewSubscription subscription = subscription_;
  for (const auto& [name, is_requested] :
       {std::pair("frames", &subscription.frames), std::pair("contacts", &subscription.contacts),
        std::pair("surfaces", &subscription.surfaces),
        std::pair("samples", &subscription.samples)}) {
    const auto member = request.json.find(name);
    if (member == request.json.end()) continue;
    if (!member->is_boolean()) {
      answers_.push_back(text_message(
          error_text(request.id, '"' + std::string(name) + "\" must be true or false")));
      return;
    }
    *is_requested = member->get<bool>();
  }
  subscription_ = subscription;
  poll_of_subscription_ = hub_.num_polls();
  answers_.push_back(text_message(answer_text(request.id, "{}")));
}

void PageOutbox::get(const ViewRequest& request) {
  const auto what = request.json.find("what");
  ViewMessage message;
  if (what != request.json.end() && what->is_string())
    message = hub_.stored(what->get_ref<const std::string&>());
  if (!message) {
    answers_.push_back(text_message(
        error_text(request.id, "\"what\" must be spheres, graph, mesh, tree or objects")));
    return;
  }
  answers_.push_back(std::move(message));
  answers_.push_back(text_message(answer_text(request.id, "{}")));
}

ViewSubscription PageOutbox::subscription(double now) const {
  if (!awaits_ack_ || now < picture_time_ + kPatience) return subscription_;
  return {.samples = subscription_.samples};
}

bool PageOutbox::wants(PicturePart part) const {
  switch (part) {
    case PicturePart::frame: return subscription_.frames;
    case PicturePart::contact: return subscription_.contacts;
    case PicturePart::normals:
    case PicturePart::edges: return subscription_.surfaces;
  }
  return false;
}

void PageOutbox::begin_picture(double now) {
  // The newest data may be from before the page subscribed to it.
  if (awaits_ack_ || hub_.num_polls() == poll_of_subscription_) return;
  for (std::size_t part = 0; part < hub_.num_parts(); ++part) {
    if (!wants(hub_.kind(part)) || hub_.number(part) == sent_parts_[part]) continue;
    sent_parts_[part] = hub_.number(part);
    picture_.push_back(hub_.message(part));
  }
  if (subscription_.samples && hub_.num_samples() > next_sample_) {
    picture_.push_back(hub_.samples_from(next_sample_));
    next_sample_ = hub_.num_samples();
  }
  if (picture_.empty()) return;
  picture_.push_back(text_message(picture_text(++picture_number_)));
  picture_time_ = now;
  awaits_ack_ = true;
}

ViewMessage PageOutbox::next(double now) {
  if (!answers_.empty()) {
    ViewMessage message = std::move(answers_.front());
    answers_.pop_front();
    return message;
  }
  if (hub_.state_number() > sent_state_ && hub_.state()) {
    sent_state_ = hub_.state_number();
    return hub_.state();
  }
  if (picture_.empty()) begin_picture(now);
  if (picture_.empty()) return {};
  ViewMessage message = std::move(picture_.front());
  picture_.pop_front();
  return message;
}

}}  // namespace palpate::v0
