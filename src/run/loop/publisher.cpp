#include "src/run/loop/publisher.h"

#include <limits>
#include <utility>

#include "src/run/loop/surface_stage.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kBatch = 256;  // ticks given to the observer at a time
constexpr std::uint64_t kAll = std::numeric_limits<std::uint64_t>::max();

}  // namespace

Publisher::Publisher(const RunObserver& observer, LoopRecords records)
    : observer_(observer),
      records_(std::move(records)),
      publishes_settings_(observer.on_settings &&
                          (observer.on_frame || observer.on_contact || observer.on_ticks)) {
  batch_.reserve(kBatch);
}

void Publisher::add_settings(const RunSettings& settings) {
  if (!publishes_settings_) return;
  const std::lock_guard lock(mutex_);
  settings_.push_back(settings);
}

void Publisher::add_note(std::string text) {
  const std::lock_guard lock(mutex_);
  notes_.push_back(std::move(text));
}

void Publisher::publish() {
  publish_ticks();
  if (records_.ticks.front() == nullptr) {
    publish_contacts(kAll);
    publish_frames(kAll);
  }
  publish_notes();
}

/// Publishes frames up to this number.
void Publisher::publish_frames(std::uint64_t last) {
  for (const PublishedFrame* seen = records_.frames.front();
       seen != nullptr && seen->record.number <= last; seen = records_.frames.front()) {
    publish_settings(seen->record.revision);
    observer_.on_frame(seen->record, seen->frame);
    records_.frames.pop();
  }
}

/// Publishes contacts up to this number.
void Publisher::publish_contacts(std::uint64_t last) {
  for (const ContactRecord* contact = records_.contacts.front();
       contact != nullptr && contact->number <= last; contact = records_.contacts.front()) {
    if (records_.num_frames() <= contact->frame_number) return;
    publish_frames(contact->frame_number);
    publish_settings(contact->revision);
    observer_.on_contact(*contact);
    records_.contacts.pop();
  }
}

void Publisher::publish_ticks() {
  RecordQueue<TickRecord>& ticks = records_.ticks;
  while (ticks.front() != nullptr && has_published_contact_of(*ticks.front())) {
    batch_.clear();
    for (const TickRecord* tick = ticks.front(); tick != nullptr && batch_.size() < kBatch;
         tick = ticks.front()) {
      if (!has_published_contact_of(*tick)) break;
      batch_.push_back(*tick);
      ticks.pop();
    }
    publish_settings(batch_.back().revision);
    observer_.on_ticks(batch_);
  }
}

/// True if the tick's contact is published, or its record was lost for lack of room.
bool Publisher::has_published_contact_of(const TickRecord& tick) {
  if (records_.num_contacts() < tick.contact_number) return false;
  publish_contacts(tick.contact_number);
  const ContactRecord* const next = records_.contacts.front();
  return next == nullptr || next->number > tick.contact_number;
}

/// Publishes settings up to this revision, each once.
void Publisher::publish_settings(std::uint32_t revision) {
  while (publishes_settings_ && published_revision_ < revision) {
    RunSettings settings;
    {
      const std::lock_guard lock(mutex_);
      settings = settings_.front();
      settings_.pop_front();
    }
    ++published_revision_;
    observer_.on_settings(published_revision_, settings);
  }
}

void Publisher::publish_notes() {
  std::vector<std::string> notes;
  {
    const std::lock_guard lock(mutex_);
    notes.swap(notes_);
  }
  for (const std::string& text : notes) {
    if (observer_.on_note) observer_.on_note(text);
  }
}

}}  // namespace palpate::v0
