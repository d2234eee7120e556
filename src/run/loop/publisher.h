// Publishes the records of a live loop to its observer, each after those that it depends on.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include "palpate/run/run_loop.h"
#include "src/run/loop/queues/record_queue.h"

namespace palpate { inline namespace v0 {

struct PublishedFrame;

/// Records of the stages, and the numbers of frames and contacts that they have finished: a record
/// is written before it is counted, and may be used by others before both.
struct LoopRecords {
  RecordQueue<PublishedFrame>& frames;
  RecordQueue<ContactRecord>& contacts;
  RecordQueue<TickRecord>& ticks;
  std::function<std::uint64_t()> num_frames, num_contacts;
};

/// Empties the queues of the stages, in one thread. Where ticks are behind, contacts and frames of
/// later ticks wait in their queues.
class Publisher {
 public:
  Publisher(const RunObserver& observer, LoopRecords records);

  /// Any thread: settings of the next revision, before a stage is offered them.
  void add_settings(const RunSettings& settings);
  void add_note(std::string text);

  /// Publishes the records that are there. A surface can be felt, and a contact too, a moment
  /// before its record is written: records that need it are published the next time.
  void publish();

 private:
  void publish_frames(std::uint64_t last);
  void publish_contacts(std::uint64_t last);
  void publish_ticks();
  void publish_notes();
  void publish_settings(std::uint32_t revision);
  bool has_published_contact_of(const TickRecord& tick);

  const RunObserver& observer_;
  LoopRecords records_;
  const bool publishes_settings_;  // with the records of their revision; else they are not kept

  std::mutex mutex_;
  std::deque<RunSettings> settings_;  // those after `published_revision_`
  std::vector<std::string> notes_;
  // Used by the publishing thread only.
  std::uint32_t published_revision_ = 0;
  std::vector<TickRecord> batch_;
};

}}  // namespace palpate::v0
