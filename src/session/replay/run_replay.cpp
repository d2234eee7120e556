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
  /// Starts at the beginning of a run, or of a part of it. `first` has the shapes of all objects.
  Repetition(std::shared_ptr<const ToolIndex> index, const RunSetup& first, SafetyFilter safety,
             ThreadPool& pool, const std::optional<PartStart>& start)
      : index_(std::move(index)),
        first_(first),
        start_(start),
        contacts_(index_, pool, start),
        ticks_(std::move(safety), start),
        first_revision_(start ? start->revision : 0),
        num_settings_(first_revision_),
        num_seen_(start ? start->hand.tick : 0),
        can_repeat_contacts_(!start || start->has_surfaces) {
    if (!can_repeat_contacts_) {
      add_note(
          (has_moving_objects(first.settings) ? "objects of part " : "the depth images of part ") +
          std::to_string(start->number) +
          (has_moving_objects(first.settings) ? " moved before it began"
                                              : " rest on averages with earlier ones or on a "
                                                "memory of them") +
          ": its queries are not repeated");
    }
  }

  /// Takes the settings of the run, then those of later changes.
  Status take(RunSetup setup) {
    if (has_settings_ && setup.revision < num_settings_) return Done{};  // a part begins with them
    if (setup.revision != num_settings_) return missing_settings();
    if (setup.streams.size() != first_.streams.size()) return other_settings("cameras");
    if (const Status status = know_objects(setup.settings.objects); !status) return status;
    setup.settings.regions = first_.settings.regions;  // and labels
    RunPartsOptions options;
    if (has_settings_) options.before = &settings_;
    options.leaves_out_large = true;
    auto parts = make_run_parts(index_, setup.streams, setup.device, setup.settings, options);
    if (!parts) return parts.error();
    has_settings_ = true;
    contacts_.add(setup, *parts);
    ticks_.add(setup, *parts);
    settings_ = setup.settings;
    ++num_settings_;
    return Done{};
  }

  /// True if a part goes on where the one before has ended: then its first messages are known. Else
  /// it has to be repeated by itself.
  Result<bool> goes_on_with(const PartStart& part) {
    if (const Status status = repeat_contacts(); !status) return status.error();
    repeat_ticks();
    if (part.hand.tick != num_seen_ || !can_repeat_ticks_ || !can_repeat_contacts_) return false;
    if (waiting_ticks_.empty() && outcome_.num_ticks > 0 && !ticks_.is_at(part.hand)) {
      outcome_.difference = "the state of the hand before tick " + std::to_string(num_seen_);
    }
    return true;
  }
  /// Ends the repetition here, as the next part does not go on from here.
  void break_off() {
    note_missing();
    if (!waiting_contacts_.empty()) end_contacts("a depth frame");
    if (!waiting_ticks_.empty()) end_ticks("a contact");
  }

  const ReplayOutcome& outcome() const { return outcome_; }
  bool has_differed() const { return !outcome_.difference.empty(); }

  Status take(std::string_view topic, std::string_view message) {
    auto joined = joiner_.take(topic, message);
    if (!joined) return joined.error();
    if (*joined) {
      RecordedDepth& frame = **joined;
      if (frame.record.revision >= num_settings_) return missing_settings();
      if (!last_frames_.is_new(frame.record)) return Done{};
      if (can_repeat_contacts_ && !contacts_.add(std::move(frame))) end_contacts("a depth frame");
    } else if (topic == kSettingsTopic) {
      auto setup = read_settings(message);
      if (!setup) return setup.error();
      if (const Status status = take(*std::move(setup)); !status) return status;
    } else if (topic == kEstimateTopic) {
      const auto estimate = read_estimate(message);
      if (!estimate) return estimate.error();
      if (!start_ || !can_repeat_contacts_) return Done{};
      if (const Status status = contacts_.add(*estimate); !status) return status;
    } else if (topic == kContactTopic) {
      const auto contact = read_contact(message);
      if (!contact) return contact.error();
      if (contact->revision >= num_settings_) return missing_settings();
      if (contact->number <= last_contact_) return Done{};
      // Objects that move rest on all contacts before.
      const bool is_next = contact->number == last_contact_ + 1;
      if (!is_next && has_moving_objects(first_.settings)) end_contacts("a contact");
      if (last_contact_ > 0 || !start_) num_missing_ += contact->number - last_contact_ - 1;
      last_contact_ = contact->number;
      known_[contact->number] = *contact;
      if (contact->revision < first_revision_) {
        if (!std::exchange(lacks_settings_, true)) {
          add_note("contact " + std::to_string(contact->number) +
                   " is not repeated: its settings were not recorded");
        }
      } else if (can_repeat_contacts_) {
        waiting_contacts_.push_back(*contact);
      }
    } else if (topic == kTickTopic && can_repeat_ticks_) {
      const auto tick = read_tick(message);
      if (!tick) return tick.error();
      if (tick->revision >= num_settings_) return missing_settings();
      if (tick->number != num_seen_++) return end_ticks("ticks"), Done{};
      waiting_ticks_.push_back(*tick);
    }
    if (const Status status = repeat_contacts(); !status) return status;
    repeat_ticks();
    return Done{};
  }

  void end(bool was_cut_off) {
    note_missing();
    if (was_cut_off) add_note("the recording was cut off; it was repeated as far as it goes");
    if (!was_cut_off && !waiting_contacts_.empty()) end_contacts("a depth frame");
    if (!was_cut_off && !waiting_ticks_.empty()) end_ticks("a contact");
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
      if (contacts_.lacks_frame_of(recorded)) {
        if (has_moving_objects(first_.settings) || contacts_.rests_on_all(recorded)) {
          end_contacts("a depth frame");
          break;
        }
        if (!std::exchange(lacks_frames_, true)) {
          add_note("contact " + std::to_string(recorded.number) +
                   " is not repeated: its depth frames were not all recorded");
        }
      } else {
        const auto repeated = contacts_.repeat(recorded);
        if (!repeated) return repeated.error();
        compare("contact", recorded, *repeated);
        ++outcome_.num_contacts;
      }
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
  const std::optional<PartStart> start_;
  FrameJoiner joiner_;
  ContactRepetition contacts_;
  TickRepetition ticks_;
  RunSettings settings_;  // the newest
  const std::uint32_t first_revision_;
  std::uint32_t num_settings_;  // the revision that comes next
  bool has_settings_ = false, lacks_settings_ = false, lacks_frames_ = false;
  NewestFrames last_frames_;
  std::uint64_t last_contact_ = 0, num_missing_ = 0;
  std::map<std::uint64_t, ContactRecord> known_;  // by number
  std::deque<ContactRecord> waiting_contacts_;
  std::deque<TickRecord> waiting_ticks_;
  std::uint64_t num_seen_;
  bool can_repeat_contacts_, can_repeat_ticks_ = true;
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
  const auto tool = reader->load_tools();
  if (!tool) return tool.error();
  const RunSetup& setup = reader->setup();
  const auto index = ToolIndex::create(*tool);
  ThreadPool pool(options.num_threads.value_or(setup.settings.num_threads));
  ReplayOutcome all;
  const auto begin =
      [&](const std::optional<PartStart>& start) -> Result<std::unique_ptr<Repetition>> {
    auto safety = SafetyFilter::create(setup.device.limits, setup.settings.safety);
    if (!safety) return safety.error();
    return std::make_unique<Repetition>(index, setup, *std::move(safety), pool, start);
  };
  const auto add = [&](const ReplayOutcome& part) {
    all.num_ticks += part.num_ticks;
    all.num_contacts += part.num_contacts;
    all.difference = part.difference;
    if (!part.note.empty()) all.note += (all.note.empty() ? "" : "; ") + part.note;
  };
  const auto in_run = [&](const Error& error) {
    return Error{error.code, folder.string() + ": " + error.message};
  };
  auto repetition = begin(reader->start());
  if (!repetition) return repetition.error();
  if (const Status status = (*repetition)->take(setup); !status) return in_run(status.error());

  ReadShare share(*reader, options.progress);
  while (!(*repetition)->has_differed()) {
    if (options.keep_going && !options.keep_going()) {
      return Error{Errc::cancelled, "the replay was interrupted before its end"};
    }
    const auto message = reader->next();
    if (!message) return message.error();
    if (!*message) break;
    share.look(*reader);
    if ((*message)->topic == kPartTopic) {
      const auto part = read_part((*message)->data);
      if (!part) return in_run(part.error());
      const auto goes_on = (*repetition)->goes_on_with(*part);
      if (!goes_on) return in_run(goes_on.error());
      if (*goes_on) continue;
      (*repetition)->break_off();
      add((*repetition)->outcome());
      repetition = begin(*part);
      if (!repetition) return repetition.error();
      continue;
    }
    if (const Status status = (*repetition)->take((*message)->topic, (*message)->data); !status) {
      return in_run(status.error());
    }
  }
  if (!(*repetition)->has_differed()) (*repetition)->end(reader->was_cut_off());
  add((*repetition)->outcome());
  if (all.difference.empty() && all.num_ticks == 0) {
    const std::string why = all.note.empty() ? "record the run again" : all.note;
    return Error{Errc::bad_input, folder.string() + " has no tick that can be repeated: " + why};
  }
  return all;
}

}}  // namespace palpate::v0
