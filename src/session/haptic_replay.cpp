// A haptic run once more, from its recording alone.
#include <deque>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "palpate/io/atomic_file.h"
#include "palpate/io/tool_file.h"
#include "palpate/session/checksum.h"
#include "palpate/session/haptic_run.h"
#include "src/session/haptic_repetition.h"
#include "src/session/haptic_results.h"

namespace palpate {
namespace fs = std::filesystem;
namespace {

/// "tick 12, /felt/force/x: recorded 1, repeated 2"; empty if the messages are the same.
std::string difference(const std::string& what, const std::string& recorded,
                       const std::string& repeated) {
  if (recorded == repeated) return {};
  using Json = nlohmann::json;
  const Json a = Json::parse(recorded), b = Json::parse(repeated);
  const Json patch = Json::diff(a, b);
  if (patch.empty()) return what + ": the sign of a zero differs";
  const auto path = patch[0].at("path").get<std::string>();
  const Json::json_pointer at(path);
  return what + ", " + path + ": recorded " + a.at(at).dump() + ", repeated " + b.at(at).dump();
}

/// A repetition that is kept as a run of its own. Times of computing are those of the recording.
class RepeatedRun {
 public:
  /// Errors: the folder is in the way or cannot be made, the recording cannot be copied.
  static Result<std::unique_ptr<RepeatedRun>> create(const fs::path& output, const fs::path& run) {
    auto folder = RunFolder::create(output);
    if (!folder) return folder.error();
    for (const char* file : {kHapticRecording, kHapticTool}) {
      std::error_code error;
      fs::copy_file(run / file, folder->partial() / file, error);
      if (error) {
        return Error{Errc::io_failure,
                     "cannot copy " + (run / file).string() + ": " + error.message()};
      }
    }
    return std::unique_ptr<RepeatedRun>(new RepeatedRun(*std::move(folder)));
  }

  void add(const HapticSetup& setup) {
    if (setup.revision == 0) {
      log_.setup = setup;
    } else {
      results_.add_settings(setup.settings);
    }
  }
  void add(const HapticFrame& frame) {
    results_.add_frame(frame.capture_time);
    ++log_.loop.num_frames;
  }
  void add(const HapticRecord& tick) {
    results_.add_tick(tick);
    LoopReport& loop = log_.loop;
    if (loop.num_ticks++ > 0) times_.haptic_period.record(nanoseconds(tick.time - loop.seconds));
    loop.seconds = tick.time;
    if (tick.safety.fault != Fault::none) loop.fault = tick.safety.fault;
    times_.haptic_compute.record(tick.compute_nanoseconds);
    loop.num_missed += static_cast<double>(tick.compute_nanoseconds) > 1e9 / log_.setup.device.rate;
    if (tick.contact_number == 0) return;
    times_.contact_age.record(nanoseconds(tick.contact_age));
    times_.sensor_to_force.record(nanoseconds(tick.sensor_age));
  }
  Status finish(const Tool& tool, const ReplayOutcome& outcome) {
    const HapticSetup& setup = log_.setup;
    const auto coupling = check_coupling(setup.settings.coupling, setup.device.limits,
                                         1 / setup.device.rate, tool.sphere_mass());
    if (!coupling) return coupling.error();
    log_.coupling = coupling->options;
    log_.loop.num_contacts = outcome.num_contacts;
    if (!outcome.note.empty()) log_.warnings.push_back(outcome.note);
    results_.write(folder_.partial(), tool, times_, log_);
    return folder_.commit();
  }

 private:
  explicit RepeatedRun(RunFolder folder)
      : folder_(std::move(folder)), results_(folder_.partial()) {}
  static std::int64_t nanoseconds(double seconds) {
    return static_cast<std::int64_t>(1e9 * seconds);
  }

  RunFolder folder_;
  HapticResults results_;
  LoopTimes times_;
  HapticLog log_;
};

/// Both sides, fed with messages in the order of the file. What belongs together may come out of
/// order by a few milliseconds, so each side waits for what it needs.
class Repetition {
 public:
  /// `kept` may be null.
  Repetition(const Tool& tool, SafetyFilter safety, int num_threads, RepeatedRun* kept)
      : tool_(tool), kept_(kept), contacts_(num_threads), ticks_(std::move(safety)) {}

  /// The settings of the run, then those that followed while it went on.
  Status take(const HapticSetup& setup) {
    if (setup.revision != num_settings_) return missing_settings();
    RunPartsOptions options;
    if (num_settings_ > 0) options.before = &settings_;
    auto parts = make_run_parts(tool_, setup.stream, setup.device, setup.settings, options);
    if (!parts) return parts.error();
    contacts_.add(setup, *parts);
    ticks_.add(setup, *parts);
    settings_ = setup.settings;
    ++num_settings_;
    if (kept_ != nullptr) kept_->add(setup);
    return Done{};
  }

  const ReplayOutcome& outcome() const { return outcome_; }
  bool has_differed() const { return !outcome_.difference.empty(); }

  Status take(std::string_view topic, std::string_view message) {
    if (topic == kSettingsTopic) {
      const auto setup = read_settings(message);
      if (!setup) return setup.error();
      if (const Status status = take(*setup); !status) return status;
    } else if (topic == kDepthTopic) {
      auto frame = read_depth(message);
      if (!frame) return frame.error();
      if (frame->revision >= num_settings_) return missing_settings();
      if (kept_ != nullptr) kept_->add(*frame);
      if (can_repeat_contacts_) contacts_.add(*std::move(frame));
      if (contacts_.has_gap()) end_contacts("a depth frame");
    } else if (topic == kContactTopic) {
      auto contact = read_contact(message);
      if (!contact) return contact.error();
      if (contact->revision >= num_settings_) return missing_settings();
      known_[contact->number] = *contact;
      if (can_repeat_contacts_) waiting_contacts_.push_back({*contact, std::string(message)});
    } else if (topic == kTickTopic && can_repeat_ticks_) {
      auto tick = read_tick(message);
      if (!tick) return tick.error();
      if (tick->revision >= num_settings_) return missing_settings();
      if (tick->number != num_seen_++) return end_ticks("ticks"), Done{};
      waiting_ticks_.push_back({*tick, std::string(message)});
    }
    repeat_contacts();
    repeat_ticks();
    return Done{};
  }

  void end(bool was_cut_off) {
    if (was_cut_off) add_note("the recording was cut off; it was repeated as far as it goes");
    if (!was_cut_off && !waiting_contacts_.empty()) end_contacts("a depth frame");
    if (!was_cut_off && !waiting_ticks_.empty()) end_ticks("a contact");
  }

 private:
  template <class Record>
  struct Waiting {
    Record record;
    std::string message;
  };

  Error missing_settings() const {
    return {Errc::bad_input, "settings of revision " + std::to_string(num_settings_) +
                                 " are missing; record the run again"};
  }
  void add_note(const std::string& note) {
    outcome_.note += (outcome_.note.empty() ? "" : "; ") + note;
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

  void repeat_contacts() {
    while (!has_differed() && can_repeat_contacts_ && !waiting_contacts_.empty() &&
           contacts_.has_frames_until(waiting_contacts_.front().record.frame_number)) {
      const auto& [recorded, message] = waiting_contacts_.front();
      outcome_.difference = difference("contact " + std::to_string(recorded.number), message,
                                       contact_message(contacts_.repeat(recorded)));
      ++outcome_.num_contacts;
      waiting_contacts_.pop_front();
    }
  }

  void repeat_ticks() {
    while (!has_differed() && can_repeat_ticks_ && !waiting_ticks_.empty()) {
      const auto& [recorded, message] = waiting_ticks_.front();
      known_.erase(known_.begin(), known_.lower_bound(recorded.contact_number));
      const bool is_measured = recorded.contact_number > 0;
      if (is_measured && known_.empty()) return;
      if (is_measured && known_.begin()->first != recorded.contact_number) {
        return end_ticks("contacts");
      }
      const HapticRecord repeated =
          ticks_.repeat(recorded, is_measured ? known_.begin()->second : ContactRecord{});
      if (kept_ != nullptr) kept_->add(repeated);
      outcome_.difference =
          difference("tick " + std::to_string(recorded.number), message, tick_message(repeated));
      ++outcome_.num_ticks;
      waiting_ticks_.pop_front();
    }
  }

  const Tool& tool_;
  RepeatedRun* kept_;
  ContactRepetition contacts_;
  TickRepetition ticks_;
  HapticSettings settings_;  // the newest
  std::uint32_t num_settings_ = 0;
  std::map<std::uint64_t, ContactRecord> known_;  // by number
  std::deque<Waiting<ContactRecord>> waiting_contacts_;
  std::deque<Waiting<HapticRecord>> waiting_ticks_;
  std::uint64_t num_seen_ = 0;
  bool can_repeat_contacts_ = true, can_repeat_ticks_ = true;
  ReplayOutcome outcome_;
};

Result<Tool> load_recorded_tool(const fs::path& path, const std::string& expected) {
  const auto bytes = read_file(path);
  if (!bytes) return bytes.error();
  if (checksum(*bytes) != expected) {
    return Error{Errc::bad_input, path.string() +
                                      " was changed after the recording (its checksum differs); "
                                      "record the run again"};
  }
  return load_tool(path);
}

Result<Repetition> make_repetition(const Tool& tool, const HapticSetup& setup, int num_threads,
                                   RepeatedRun* kept) {
  if (!(setup.device.rate > 0)) {
    return Error{Errc::bad_input, "the recording tells no rate of ticks; record the run again"};
  }
  auto safety = SafetyFilter::create(setup.device.limits, setup.settings.safety);
  if (!safety) return safety.error();
  Repetition repetition(tool, *std::move(safety), num_threads, kept);
  if (const Status status = repetition.take(setup); !status) return status.error();
  return repetition;
}

/// The settings, which are the first message of every recording.
Result<HapticSetup> next_settings(McapReader& reader, const fs::path& path) {
  const auto first = reader.next();
  if (!first) return first.error();
  if (!*first || reader.channels().at((*first)->channel).topic != kSettingsTopic) {
    return Error{Errc::bad_input,
                 path.string() + " is not the recording of a haptic run; give another folder"};
  }
  return read_settings((*first)->data);
}

}  // namespace

bool is_haptic_run(const fs::path& folder) {
  auto reader = McapReader::open(folder / kHapticRecording);
  return reader && next_settings(*reader, folder / kHapticRecording);
}

Result<ReplayOutcome> replay_haptic_run(const fs::path& folder, const ReplayOptions& options) {
  const fs::path path = folder / kHapticRecording;
  auto reader = McapReader::open(path);
  if (!reader) return reader.error();
  const auto setup = next_settings(*reader, path);
  if (!setup) return setup.error();
  const auto tool = load_recorded_tool(folder / kHapticTool, setup->tool_checksum);
  if (!tool) return tool.error();
  std::unique_ptr<RepeatedRun> kept;
  if (options.output) {
    auto run = RepeatedRun::create(*options.output, folder);
    if (!run) return run.error();
    kept = *std::move(run);
  }
  auto repetition = make_repetition(
      *tool, *setup, options.num_threads.value_or(setup->settings.num_threads), kept.get());
  if (!repetition) return repetition.error();

  while (!repetition->has_differed()) {
    if (options.keep_going && !options.keep_going({})) {
      return Error{Errc::cancelled, "the replay was interrupted before its end"};
    }
    const auto message = reader->next();
    if (!message) return message.error();
    if (!*message) break;
    const std::string& topic = reader->channels().at((*message)->channel).topic;
    if (const Status status = repetition->take(topic, (*message)->data); !status) {
      return Error{status.error().code, path.string() + ": " + status.error().message};
    }
  }
  if (!repetition->has_differed()) repetition->end(reader->was_cut_off());
  if (kept) {
    if (const Status status = kept->finish(*tool, repetition->outcome()); !status) {
      return status.error();
    }
  }
  return repetition->outcome();
}

}  // namespace palpate
