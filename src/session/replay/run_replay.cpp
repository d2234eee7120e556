// Repeats a run from its recording alone.
#include <deque>
#include <map>
#include <memory>
#include <utility>

#include "palpate/session/run.h"
#include "src/run/internal/pipeline.h"
#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_reader.h"
#include "src/session/replay/run_repetition.h"

namespace palpate { inline namespace v0 {
namespace fs = std::filesystem;
namespace {

/// Repeats both sides from messages in the order of the file. Related messages may come out of
/// order by a few milliseconds, so each side waits for those that it needs.
class Repetition {
 public:
  /// `first` has the shapes of all objects.
  Repetition(std::shared_ptr<const ToolIndex> index, const RunSetup& first, SafetyFilter safety,
             ThreadPool& pool)
      : index_(std::move(index)),
        first_(first),
        contacts_(index_, pool),
        ticks_(std::move(safety)) {}

  /// Takes the settings of the run, then those of later changes.
  Status take(RunSetup setup) {
    if (setup.revision < num_settings_) return Done{};  // a part begins with them
    if (setup.revision != num_settings_) return missing_settings();
    if (setup.streams.size() != first_.streams.size()) return other_settings("cameras");
    if (const Status status = know_objects(setup.settings.objects); !status) return status;
    setup.settings.regions = first_.settings.regions;  // and labels
    RunPartsOptions options;
    if (num_settings_ > 0) options.before = &settings_;
    options.leaves_out_large = true;
    auto parts = make_run_parts(index_, setup.streams, setup.device, setup.settings, options);
    if (!parts) return parts.error();
    contacts_.add(setup, *parts);
    ticks_.add(setup, *parts);
    settings_ = setup.settings;
    ++num_settings_;
    return Done{};
  }

  const ReplayOutcome& outcome() const { return outcome_; }
  bool has_differed() const { return !outcome_.difference.empty(); }

  Status take(std::string_view topic, std::string_view message) {
    auto joined = joiner_.take(topic, message);
    if (!joined) return joined.error();
    if (*joined) {
      RecordedDepth& frame = **joined;
      if (frame.record.revision >= num_settings_) return missing_settings();
      if (can_repeat_contacts_ && !contacts_.add(std::move(frame))) end_contacts("a depth frame");
    } else if (topic == kSettingsTopic) {
      auto setup = read_settings(message);
      if (!setup) return setup.error();
      if (const Status status = take(*std::move(setup)); !status) return status;
    } else if (topic == kContactTopic) {
      const auto contact = read_contact(message);
      if (!contact) return contact.error();
      if (contact->revision >= num_settings_) return missing_settings();
      if (contact->number <= last_contact_) return Done{};
      // Objects that move rest on all contacts before.
      const bool is_next = contact->number == last_contact_ + 1;
      if (!is_next && has_moving_objects(first_.settings)) end_contacts("a contact");
      num_missing_ += contact->number - last_contact_ - 1;
      last_contact_ = contact->number;
      known_[contact->number] = *contact;
      if (can_repeat_contacts_) waiting_contacts_.push_back(*contact);
    } else if (topic == kTickTopic) {
      const auto tick = read_tick(message);
      if (!tick) return tick.error();
      if (tick->revision >= num_settings_) return missing_settings();
      if (tick->number != num_ticks_) end_ticks("ticks");
      num_ticks_ = tick->number + 1;
      if (can_repeat_ticks_) waiting_ticks_.push_back(*tick);
    }
    if (const Status status = repeat_contacts(); !status) return status;
    repeat_ticks();
    return Done{};
  }

  /// True if a part continues the one before.
  bool goes_on_with(const PartStart& part) const { return part.tick == num_ticks_; }

  /// Ends the repetition. `why` is empty at the end of the run.
  void end(const std::string& why) {
    note_missing();
    if (!why.empty()) return add_note(why);
    if (!waiting_contacts_.empty()) end_contacts("a depth frame");
    if (!waiting_ticks_.empty()) end_ticks("a contact");
  }

 private:
  /// Gives objects the shapes of those in the first settings; they keep their present friction.
  Status know_objects(std::vector<SceneObject>& objects) const {
    const std::vector<SceneObject>& first = first_.settings.objects;
    if (objects.size() != first.size()) return other_settings("objects");
    for (std::size_t i = 0; i < objects.size(); ++i) {
      const SceneObject now = objects[i];
      objects[i] = first[i];
      objects[i].friction = now.friction;
      objects[i].static_ratio = now.static_ratio;
      objects[i].viscous = now.viscous;
    }
    return Done{};
  }
  Error other_settings(const char* what) const {
    return {Errc::bad_input, "settings of revision " + std::to_string(num_settings_) +
                                 " have other " + what + "; record the run again"};
  }
  Error missing_settings() const {
    return {Errc::bad_input, "settings of revision " + std::to_string(num_settings_) +
                                 " are missing; record the run again"};
  }
  void add_note(const std::string& note) {
    outcome_.note += (outcome_.note.empty() ? "" : "; ") + note;
  }
  /// Notes the contacts that were not recorded, also those that no tick needs.
  void note_missing() {
    if (num_missing_ == 0) return;
    add_note(std::to_string(num_missing_) +
             (num_missing_ == 1 ? " contact was not recorded" : " contacts were not recorded"));
  }
  void end_contacts(const char* missing) {
    if (!std::exchange(can_repeat_contacts_, false)) return;
    add_note("queries are repeated up to number " + std::to_string(outcome_.num_contacts) +
             " only: " + missing + " after it was not recorded");
    waiting_contacts_.clear();
  }
  void end_ticks(const char* missing) {
    if (!std::exchange(can_repeat_ticks_, false)) return;
    add_note("ticks are repeated up to number " + std::to_string(outcome_.num_ticks) +
             " only: " + missing + " after it were not recorded");
    waiting_ticks_.clear();
  }
  template <class Record>
  void compare(const char* what, const Record& recorded, const Record& repeated) {
    const std::string found = difference(recorded, repeated);
    if (!found.empty()) {
      outcome_.difference = what + (" " + std::to_string(recorded.number)) + ", " + found;
    }
  }

  Status repeat_contacts() {
    while (!has_differed() && can_repeat_contacts_ && !waiting_contacts_.empty() &&
           contacts_.has_frames_of(waiting_contacts_.front())) {
      const ContactRecord& recorded = waiting_contacts_.front();
      const auto repeated = contacts_.repeat(recorded);
      if (!repeated) return repeated.error();
      compare("contact", recorded, *repeated);
      ++outcome_.num_contacts;
      waiting_contacts_.pop_front();
    }
    return Done{};
  }

  void repeat_ticks() {
    while (!has_differed() && can_repeat_ticks_ && !waiting_ticks_.empty()) {
      const TickRecord& recorded = waiting_ticks_.front();
      known_.erase(known_.begin(), known_.lower_bound(recorded.contact_number));
      const bool is_measured = recorded.contact_number > 0;
      if (is_measured && known_.empty()) return;
      if (is_measured && known_.begin()->first != recorded.contact_number) {
        return end_ticks("contacts");
      }
      compare("tick", recorded,
              ticks_.repeat(recorded, is_measured ? known_.begin()->second : ContactRecord{}));
      ++outcome_.num_ticks;
      waiting_ticks_.pop_front();
    }
  }

  std::shared_ptr<const ToolIndex> index_;
  const RunSetup& first_;
  FrameJoiner joiner_{first_.streams};
  ContactRepetition contacts_;
  TickRepetition ticks_;
  RunSettings settings_;            // the newest
  std::uint32_t num_settings_ = 0;  // the revision that comes next
  std::uint64_t last_contact_ = 0, num_missing_ = 0;
  std::map<std::uint64_t, ContactRecord> known_;  // by number
  std::deque<ContactRecord> waiting_contacts_;
  std::deque<TickRecord> waiting_ticks_;
  std::uint64_t num_ticks_ = 0;  // the number that comes next
  bool can_repeat_contacts_ = true, can_repeat_ticks_ = true;
  ReplayOutcome outcome_;
};

}  // namespace

bool is_run(const fs::path& folder) {
  const auto reader = RunReader::open(folder);
  // A recording of another version is a run, too.
  return reader || reader.error().code == Errc::unavailable;
}

Result<ReplayOutcome> replay_run(const fs::path& folder, const ReplayOptions& options) {
  auto reader = RunReader::open(folder);
  if (!reader) return reader.error();
  if (const Status whole = reader->begins_with_run(); !whole) return whole.error();
  const auto tool = reader->load_tools();
  if (!tool) return tool.error();
  const RunSetup& setup = reader->setup();
  ThreadPool pool(options.num_threads.value_or(setup.settings.num_threads));
  auto safety = SafetyFilter::create(setup.device.limits, setup.settings.safety);
  if (!safety) return safety.error();
  Repetition repetition(ToolIndex::create(*tool), setup, *std::move(safety), pool);
  const auto in_run = [&](const Error& error) {
    return Error{error.code, folder.string() + ": " + error.message};
  };
  if (const Status status = repetition.take(setup); !status) return in_run(status.error());

  std::string why_it_ends;
  ReadShare share(*reader, options.progress);
  while (!repetition.has_differed()) {
    if (options.keep_going && !options.keep_going()) {
      return Error{Errc::cancelled, "the replay was interrupted before its end"};
    }
    const auto message = reader->next();
    if (!message) return message.error();
    if (!*message) {
      if (reader->was_cut_off()) {
        why_it_ends = "the recording was cut off; it was repeated as far as it goes";
      }
      break;
    }
    share.look(*reader);
    if ((*message)->topic == kPartTopic) {
      const auto part = read_part((*message)->data);
      if (!part) return in_run(part.error());
      if (repetition.goes_on_with(*part)) continue;
      why_it_ends = "what comes from part " + std::to_string(part->number) +
                    " on is not repeated: ticks before it were not recorded; look at it with "
                    "palpate view";
      break;
    }
    if (const Status status = repetition.take((*message)->topic, (*message)->data); !status) {
      return in_run(status.error());
    }
  }
  if (!repetition.has_differed()) repetition.end(why_it_ends);
  const ReplayOutcome& outcome = repetition.outcome();
  if (outcome.difference.empty() && outcome.num_ticks == 0) {
    const std::string why = outcome.note.empty() ? "record the run again" : outcome.note;
    return Error{Errc::bad_input, folder.string() + " has no tick that can be repeated: " + why};
  }
  return outcome;
}

}}  // namespace palpate::v0
