#include "src/viewer/sources/mcap_index.h"

#include <algorithm>
#include <chrono>
#include <system_error>
#include <utility>

#include "src/core/internal/guarded.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::chrono::milliseconds kPatience{1000};  // to read all of a short recording
// Limits of marks in the time of the run.
constexpr std::size_t kMaxMarks = 5000, kMaxAlike = 200, kLongestMark = 1000;

/// Removes digits: repeated notes differ by their numbers only.
std::string without_digits(std::string text) {
  std::erase_if(text, [](char c) { return c >= '0' && c <= '9'; });
  return text;
}

Error no_run(const std::filesystem::path& path, const std::string& why) {
  return {Errc::bad_input, path.string() + " cannot be shown: " + why + "; record the run again"};
}

}  // namespace

McapIndex::McapIndex(RunReader reader)
    : reader_(std::move(reader)), setup_(reader_.setup()), file_size_(reader_.num_bytes()) {
  for (const DepthStreamInfo& stream : setup_.streams) {
    periods_.emplace_back(stream, setup_.settings.time);
  }
  settings_[setup_.revision] = std::make_shared<const RunSettings>(setup_.settings);
}

McapIndex::~McapIndex() {
  {
    const std::lock_guard lock(mutex_);
    is_stopping_ = true;
  }
  if (thread_.joinable()) thread_.join();
}

Result<std::unique_ptr<McapIndex>> McapIndex::open(const std::filesystem::path& path) {
  auto reader = RunReader::open(path);
  if (!reader) return reader.error();
  std::unique_ptr<McapIndex> index(new McapIndex(*std::move(reader)));
  // Reads until there is something to see, then in the background.
  while (index->frames_.empty() || index->chunks_.empty()) {
    const auto got = index->read_next();
    if (!got) return no_run(path, got.error().message);
    if (!*got) return no_run(path, "it ends before the tool meets a depth image");
  }
  try {
    index->thread_ = std::thread([i = index.get()] { i->read_all(); });
  } catch (const std::system_error& error) {
    return Error{Errc::unavailable, "cannot start the thread that reads " + path.string() + ": " +
                                        error.what() + "; end other programs and try again"};
  }
  std::unique_lock lock(index->mutex_);
  index->has_grown_.wait_for(lock, kPatience, [&] { return index->is_complete_; });
  lock.unlock();
  return index;
}

void McapIndex::read_all() {
  std::string trouble;
  const auto read = [&] {
    for (;;) {
      const auto got = read_next();
      {
        const std::lock_guard lock(mutex_);
        if (is_stopping_) return;
      }
      if (got && *got) continue;
      if (!got) {
        trouble = "the recording is shown as far as it can be read: " + got.error().message;
      } else if (reader_.was_cut_off()) {
        trouble = "the recording was cut off; it is shown as far as it goes";
      }
      break;
    }
  };
  guarded(read, [&](const Error&) { is_short_of_memory_ = true; });
  const std::lock_guard lock(mutex_);
  trouble_ = std::move(trouble);
  is_complete_ = true;
  has_grown_.notify_all();
}

Result<bool> McapIndex::read_next() {
  const auto message = reader_.next();
  if (!message) return message.error();
  if (!*message) return false;
  const Status status = take(**message);
  if (!status) return status.error();
  return true;
}

Status McapIndex::take(const RunReader::Message& message) {
  const std::string_view topic = message.topic;
  const std::uint64_t place = reader_.chunk_place();
  if (topic == kFrameTopic) {
    const auto frame = read_frame(message.data);
    if (!frame) return frame.error();
    const std::lock_guard lock(mutex_);
    if (!frames_.empty() && frame->number <= frames_.back().number) return Done{};
    if (frame->camera >= periods_.size()) return Done{};
    frames_.push_back({place, frame->number, frame->camera,
                       static_cast<std::int64_t>(frame->camera_frame), frame->capture_time,
                       periods_[frame->camera].add(frame->capture_time)});
  } else if (topic == kContactTopic) {
    if (!has_start_) {
      const auto contact = read_contact(message.data);
      if (!contact) return contact.error();
      start_ = contact->contact.time - contact->time;
      wall_start_ = message.time - static_cast<std::uint64_t>(1e9 * contact->time);
      has_start_ = true;
    }
    take_wall_time(message.time);
  } else if (topic == kTickTopic && has_start_) {
    take_wall_time(message.time);
  } else if (topic == kSettingsTopic) {
    auto setup = read_settings(message.data);
    if (!setup) return setup.error();
    auto settings = std::make_shared<const RunSettings>(std::move(setup->settings));
    const std::lock_guard lock(mutex_);
    settings_[setup->revision] = std::move(settings);
  } else if (topic == kNoteTopic) {
    auto note = read_note(message.data);
    if (!note) return note.error();
    const std::lock_guard lock(mutex_);
    add_mark(message.time, *std::move(note));
  }
  return Done{};
}

/// Adds a mark; a program that repeats itself all night does not crowd out other marks.
void McapIndex::add_mark(std::uint64_t wall_time, std::string text) {
  if (marks_.size() == kMaxMarks) return;
  if (text.size() > kLongestMark) text.resize(kLongestMark);
  const std::size_t num = ++num_alike_[without_digits(text)];
  if (num > kMaxAlike) return;
  if (num == kMaxAlike) text += " (later ones are not shown)";
  marks_.emplace_back(wall_time, std::move(text));
}

/// Extends the time span of the present chunk by a measurement.
void McapIndex::take_wall_time(std::uint64_t wall_time) {
  const double time =
      1e-9 * static_cast<double>(static_cast<std::int64_t>(wall_time - wall_start_));
  const std::uint64_t place = reader_.chunk_place();
  const std::lock_guard lock(mutex_);
  if (chunks_.empty() || chunks_.back().place != place) chunks_.push_back({place, time, time});
  chunks_.back().first = std::min(chunks_.back().first, time);
  chunks_.back().last = std::max(chunks_.back().last, time);
  duration_ = std::max(duration_, time);
}

double McapIndex::duration() const {
  const std::lock_guard lock(mutex_);
  return duration_;
}

std::shared_ptr<const RunSettings> McapIndex::settings(std::uint32_t revision) const {
  const std::lock_guard lock(mutex_);
  const auto next = settings_.upper_bound(revision);
  return (next == settings_.begin() ? next : std::prev(next))->second;
}

std::vector<RecordedMark> McapIndex::marks() const {
  const std::lock_guard lock(mutex_);
  std::vector<RecordedMark> marks;
  for (const auto& [wall_time, text] : marks_) {
    const auto time =
        1e-9 * static_cast<double>(static_cast<std::int64_t>(wall_time - wall_start_));
    marks.push_back({std::max(time, 0.0), text});
  }
  return marks;
}

std::size_t McapIndex::num_marks() const {
  const std::lock_guard lock(mutex_);
  return marks_.size();
}

std::string McapIndex::note() const {
  const std::lock_guard lock(mutex_);
  if (is_short_of_memory_) {
    return "there is no memory to read all of the recording; it is shown as far as it was read";
  }
  if (is_complete_) return trouble_;
  const double share = static_cast<double>(reader_.num_bytes_before(chunks_.back().place)) /
                       static_cast<double>(std::max<std::uint64_t>(file_size_, 1));
  return "the recording is still being read: " + std::to_string(static_cast<int>(100 * share)) +
         " %";
}

std::size_t McapIndex::num_frames() const {
  const std::lock_guard lock(mutex_);
  return frames_.size();
}

IndexedFrame McapIndex::frame(std::size_t index) const {
  const std::lock_guard lock(mutex_);
  return frames_[index];
}

std::size_t McapIndex::index_of(std::uint64_t number) const {
  const std::lock_guard lock(mutex_);
  const auto next =
      std::upper_bound(frames_.begin(), frames_.end(), number,
                       [](std::uint64_t n, const IndexedFrame& frame) { return n < frame.number; });
  return next == frames_.begin() ? 0 : static_cast<std::size_t>(next - frames_.begin()) - 1;
}

std::size_t McapIndex::num_chunks() const {
  const std::lock_guard lock(mutex_);
  return chunks_.size();
}

std::size_t McapIndex::chunk_at(double time) const {
  const std::lock_guard lock(mutex_);
  const auto next =
      std::upper_bound(chunks_.begin(), chunks_.end(), time,
                       [](double t, const IndexedChunk& chunk) { return t < chunk.first; });
  return next == chunks_.begin() ? 0 : static_cast<std::size_t>(next - chunks_.begin()) - 1;
}

IndexedChunk McapIndex::chunk(std::size_t index) const {
  const std::lock_guard lock(mutex_);
  return chunks_[index];
}

}}  // namespace palpate::v0
