#include "src/viewer/server/view_hub.h"

#include <algorithm>
#include <utility>

#include "src/viewer/protocol/samples.h"
#include "src/viewer/server/page_outbox.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kStatePeriod = 0.25;  // s
constexpr double kFreshState = 0.02;   // s
constexpr std::size_t kMaxSamples = 8192;

ViewSubscription either(const ViewSubscription& a, const ViewSubscription& b) {
  return {a.frames || b.frames, a.contacts || b.contacts, a.surfaces || b.surfaces,
          a.samples || b.samples};
}

}  // namespace

Status ViewSource::hold(std::uint64_t) {
  return Error{Errc::unavailable,
               "no page can hold this tool: that is for palpate touch ... --device page"};
}
Status ViewSource::move(std::uint64_t page, const Pose&) { return hold(page); }
void ViewSource::release(std::uint64_t) {}

ViewHub::ViewHub(ViewSource& source)
    : source_(source),
      tool_radius_(tool_radius(*source.content().tool)),
      num_cameras_(source.content().streams.size()),
      parts_(num_cameras_) {
  for (const PicturePart kind : {PicturePart::contact, PicturePart::normals, PicturePart::edges}) {
    parts_.push_back({kind, 0, {}, {}});
  }
}

void ViewHub::poll(double now) {
  ViewSubscription subscription;
  for (const PageOutbox* page : pages_)
    subscription = either(subscription, page->subscription(now));
  ViewUpdate update = source_.poll(subscription);
  ++num_polls_;
  take_samples(update.samples);
  take_parts(std::move(update));
  if (!pages_.empty() && (is_state_old_ || now >= state_time_ + kStatePeriod)) poll_state(now);
}

bool ViewHub::is_requested(double now) const {
  return std::any_of(pages_.begin(), pages_.end(), [now](const PageOutbox* page) {
    const ViewSubscription subscription = page->subscription(now);
    return subscription.frames || subscription.contacts || subscription.surfaces ||
           subscription.samples;
  });
}

void ViewHub::set(std::size_t part, std::function<std::string(std::uint64_t)> encode) {
  Newest& slot = parts_[part];
  slot = {slot.kind, slot.number + 1, std::move(encode), {}};
}

void ViewHub::take_parts(ViewUpdate update) {
  for (auto& frame : update.frames) {
    newest_time_ = frame->time;
    const std::size_t camera = frame->camera;
    set(camera, [frame = std::move(frame)](std::uint64_t) { return encode_frame(*frame); });
  }
  if (update.contact) {
    newest_time_ = update.contact->time;
    set(num_cameras_, [this, contact = std::move(update.contact)](std::uint64_t number) {
      return encode_contact(*contact, source_.content().tool->spheres(), number);
    });
  }
  if (update.surface) {
    const auto surface = std::move(update.surface);
    set(num_cameras_ + 1, [surface, time = newest_time_](std::uint64_t) {
      return encode_normals(*surface, surface->frame_number, time);
    });
    set(num_cameras_ + 2, [surface, time = newest_time_](std::uint64_t) {
      return encode_edges(*surface, surface->frame_number, time);
    });
  }
}

/// Ages samples by the run, not by the clock: a page that joins a paused or ended run gets them.
void ViewHub::take_samples(const std::vector<ViewSample>& samples) {
  for (const ViewSample& sample : samples) {
    const bool goes_back = !samples_.empty() && sample.time < samples_.back().time;  // a seek
    while (!samples_.empty() &&
           (goes_back || samples_.front().time < sample.time - SampleQueue::kSeconds ||
            samples_.size() >= kMaxSamples)) {
      samples_.pop_front();
      ++first_sample_;
    }
    samples_.push_back(sample);
  }
}

const ViewMessage& ViewHub::message(std::size_t part) {
  Newest& slot = parts_[part];
  if (slot.encode) {
    slot.message = binary_message(slot.encode(slot.number));
    slot.encode = nullptr;
  }
  return slot.message;
}

ViewMessage ViewHub::samples_from(std::uint64_t number) const {
  number = std::max(number, first_sample_);
  std::vector<ViewSample> samples;
  for (std::uint64_t i = number; i < num_samples(); ++i)
    samples.push_back(samples_[i - first_sample_]);
  return binary_message(encode_samples(samples, number));
}

void ViewHub::poll_state(double now) {
  state_ = text_message(state_text(source_, num_pages()));
  state_time_ = now;
  is_state_old_ = false;
  ++state_number_;
}

const ViewMessage& ViewHub::fresh_state(double now) {
  if (is_state_old_ || now >= state_time_ + kFreshState) poll_state(now);
  return state_;
}

ViewMessage ViewHub::stored(std::string_view what) {
  const Tool& tool = *source_.content().tool;
  const auto keep = [this](std::size_t slot, auto encode) {
    if (!stored_[slot]) stored_[slot] = binary_message(encode());
    return stored_[slot];
  };
  if (what == "spheres") return keep(0, [&] { return encode_spheres(tool.spheres()); });
  if (what == "graph") return keep(1, [&] { return encode_graph(tool.graph()); });
  if (what == "mesh") return keep(2, [&] { return encode_mesh(tool.mesh()); });
  if (what == "tree") return keep(3, [&] { return encode_tree(tool.tree()); });
  if (what == "objects") {
    return keep(4, [&] { return encode_objects(source_.content().objects); });
  }
  return {};
}

ViewHub::Answer ViewHub::execute(const ViewRequest& request, std::string_view text) {
  if (!request.error.empty()) return {false, error_text(request.id, request.error)};
  const Result<std::string> said = source_.command(text);
  is_state_old_ = true;
  if (!said) return {false, error_text(request.id, said.error().message)};
  return {true, answer_text(request.id, *said)};
}

Status ViewHub::hold(std::uint64_t page) {
  is_state_old_ = true;
  return source_.hold(page);
}

void ViewHub::release(std::uint64_t page) {
  is_state_old_ = true;
  source_.release(page);
}

std::uint64_t ViewHub::add(PageOutbox* page) {
  pages_.push_back(page);
  num_pages_ = static_cast<int>(pages_.size());
  is_state_old_ = true;
  return ++last_page_;
}

void ViewHub::remove(PageOutbox* page) {
  std::erase(pages_, page);
  num_pages_ = static_cast<int>(pages_.size());
  is_state_old_ = true;
}

}}  // namespace palpate::v0
