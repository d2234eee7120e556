// State that all pages share: the source, and the newest of each part, encoded once.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "src/viewer/protocol/messages.h"

namespace palpate { inline namespace v0 {

class PageOutbox;

/// Parts of a picture, beside samples.
enum class PicturePart { frame, contact, normals, edges };

/// Keeps only the newest of each part, and of each camera's frames: data that a slow page misses is
/// never stored for it. One thread, but for num_pages(). Times are monotonic_now().
class ViewHub {
 public:
  explicit ViewHub(ViewSource& source);

  /// Gets the subscribed data from the source, and its state when it is due.
  void poll(double now);
  std::uint64_t num_polls() const { return num_polls_; }
  /// True if a page needs data.
  bool is_requested(double now) const;

  /// Parts of a picture, in the order in which they are sent.
  std::size_t num_parts() const { return parts_.size(); }
  PicturePart kind(std::size_t part) const { return parts_[part].kind; }
  /// Number of versions of this part so far; 0: none.
  std::uint64_t number(std::size_t part) const { return parts_[part].number; }
  /// Returns the newest version, encoded when the first page takes it.
  const ViewMessage& message(std::size_t part);
  /// Number of samples since the start of the server.
  std::uint64_t num_samples() const { return first_sample_ + samples_.size(); }
  /// Samples from `number` on, at most those of the last SampleQueue::kSeconds of the run.
  ViewMessage samples_from(std::uint64_t number) const;

  std::uint64_t state_number() const { return state_number_; }
  const ViewMessage& state() const { return state_; }
  /// Returns a state that is new enough for repeated requests.
  const ViewMessage& fresh_state(double now);
  /// Returns the hello message with the present controls.
  std::string hello() { return hello_text(source_, tool_radius_); }
  /// Returns stored data: spheres, graph, mesh, tree, objects. Null: there is no such thing.
  ViewMessage stored(std::string_view what);

  /// Answer to a command that the source executes, for the page that sent it.
  struct Answer {
    bool is_ok = false;
    std::string text;
  };
  Answer execute(const ViewRequest& request, std::string_view text);

  /// Lets a page hold, move and release the tool.
  Status hold(std::uint64_t page);
  Status move(std::uint64_t page, const Pose& X_WT) { return source_.move(page, X_WT); }
  void release(std::uint64_t page);

  /// Adds a page; returns its number.
  std::uint64_t add(PageOutbox* page);
  void remove(PageOutbox* page);
  int num_pages() const noexcept { return num_pages_; }

 private:
  struct Newest {
    PicturePart kind = PicturePart::frame;
    std::uint64_t number = 0;
    std::function<std::string(std::uint64_t number)> encode;
    ViewMessage message;
  };
  void set(std::size_t part, std::function<std::string(std::uint64_t)> encode);
  void take_parts(ViewUpdate update);
  void take_samples(const std::vector<ViewSample>& samples);
  void poll_state(double now);

  ViewSource& source_;
  const double tool_radius_;
  std::vector<PageOutbox*> pages_;
  std::atomic<int> num_pages_ = 0;
  std::uint64_t last_page_ = 0;  // its number
  std::uint64_t num_polls_ = 0;

  const std::size_t num_cameras_;
  std::vector<Newest> parts_;       // a frame of each camera, then the others
  double newest_time_ = 0;          // s since the run began, of the newest part
  std::deque<ViewSample> samples_;  // the last seconds of the run
  std::uint64_t first_sample_ = 0;  // its number

  ViewMessage state_;
  std::uint64_t state_number_ = 0;
  double state_time_ = 0;
  bool is_state_old_ = true;  // a command may have changed it
  std::array<ViewMessage, 5> stored_;
};

}}  // namespace palpate::v0
