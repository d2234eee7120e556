// A haptic run once more, from its recording alone.
#include <deque>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "palpate/contact/blended_query.h"
#include "palpate/io/atomic_file.h"
#include "palpate/io/tool_file.h"
#include "palpate/session/checksum.h"
#include "palpate/session/haptic_run.h"
#include "src/session/haptic_messages.h"

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

/// The contact side: frames to surfaces, poses to contacts.
class ContactRepetition {
 public:
  static Result<ContactRepetition> create(const Tool& tool, const HapticSetup& setup,
                                          const CouplingOptions& coupling, int num_threads) {
    const HapticSettings& s = setup.settings;
    std::optional<DepthFieldOptions> field;
    if (s.contact.method == InsideMethod::field) field = s.field;
    auto timeline =
        SurfaceTimeline::create(setup.stream, s.surface, field, s.time, {s.backend, s.sensing_gpu});
    if (!timeline) return timeline.error();
    ContactCapacities capacities;
    capacities.gpu = s.contact_gpu;
    auto query = make_contact_query(s.backend, tool, capacities);
    if (!query) return query.error();
    return ContactRepetition(
        s.contact, *std::move(timeline), *std::move(query), num_threads,
        tool.sphere_mass().centre_of_mass,
        thesis_force_scale(coupling.force_at_eighth, full_volume(tool, s.contact)));
  }

  void add(HapticFrame frame) { frames_.push_back(std::move(frame)); }

  /// Whether all frames up to this one are there.
  bool has_frames_until(std::uint64_t number) const {
    return number < num_pushed_ + frames_.size();
  }
  /// The first frame that is there while one before it is not.
  bool has_gap() const {
    return !frames_.empty() && frames_.back().number + 1 != num_pushed_ + frames_.size();
  }

  /// What a query at the same moment and pose gives. Its frames must be there.
  ContactRecord repeat(const ContactRecord& recorded) {
    while (num_pushed_ <= recorded.frame_number) {
      const HapticFrame& next = frames_.front();
      timeline_.push(next.frame, next.capture_time, *pool_);
      moment_ = timeline_.at(next.capture_time);
      capture_time_ = next.capture_time;
      frames_.pop_front();
      ++num_pushed_;
    }
    ContactRecord repeated = recorded;
    repeated.capture_time = capture_time_;
    moment_.progress = recorded.progress;
    query_->set_moment(moment_);
    repeated.penetration = query_->query(recorded.X_WT, options_);
    // A stiffness that was kept from an earlier contact is taken as it was.
    Stiffness stiffness = recorded.contact.stiffness;
    if (recorded.has_new_stiffness) stiffness = query_->stiffness();
    repeated.contact =
        local_contact(repeated.penetration, stiffness, recorded.X_WT, centre_of_mass_T_, scale_,
                      recorded.contact.time, recorded.contact.time - capture_time_);
    if (!recorded.has_new_stiffness) {
      repeated.contact.stiffness = recorded.contact.stiffness;
      repeated.contact.max_stiffness = recorded.contact.max_stiffness;
    }
    return repeated;
  }

 private:
  ContactRepetition(const ContactOptions& options, SurfaceTimeline timeline,
                    std::unique_ptr<ContactQuery> query, int num_threads,
                    const Vec3d& centre_of_mass_T, const ForceScale& scale)
      : options_(options),
        timeline_(std::move(timeline)),
        query_(std::make_unique<BlendedQuery>(std::move(query))),
        pool_(std::make_unique<ThreadPool>(num_threads)),
        centre_of_mass_T_(centre_of_mass_T),
        scale_(scale) {}

  ContactOptions options_;
  SurfaceTimeline timeline_;
  std::unique_ptr<BlendedQuery> query_;
  std::unique_ptr<ThreadPool> pool_;
  Vec3d centre_of_mass_T_;
  ForceScale scale_;
  std::deque<HapticFrame> frames_;  // not yet pushed
  std::uint64_t num_pushed_ = 0;
  SurfaceMoment moment_;
  double capture_time_ = 0;
};

/// The hand's side: device states and contacts to wrenches.
class TickRepetition {
 public:
  TickRepetition(std::unique_ptr<Coupling> coupling, SafetyFilter safety)
      : coupling_(std::move(coupling)), safety_(std::move(safety)) {}

  HapticRecord repeat(const HapticRecord& recorded, const LocalContact& contact) {
    HapticRecord tick = recorded;
    tick.step = {};
    if (recorded.dt > 0) {
      if (!std::exchange(has_tool_, true)) coupling_->reset(recorded.device);
      tick.step = coupling_->step(recorded.device, contact, recorded.dt);
    }
    if (recorded.is_stopping && safety_.status().fault == Fault::none) safety_.stop();
    tick.F_H_B = safety_.filter(tick.step.F_H_B,
                                {recorded.device.time, recorded.device, recorded.contact_age,
                                 recorded.has_sensor_failed ? kLostSensorAge : recorded.sensor_age,
                                 recorded.has_backend_failed});
    tick.safety = safety_.status();
    return tick;
  }

 private:
  std::unique_ptr<Coupling> coupling_;
  SafetyFilter safety_;
  bool has_tool_ = false;
};

/// Both sides, fed with messages in the order of the file. What belongs together may come out of
/// order by a few milliseconds, so each side waits for what it needs.
class Repetition {
 public:
  Repetition(ContactRepetition contacts, TickRepetition ticks)
      : contacts_(std::move(contacts)), ticks_(std::move(ticks)) {}

  const ReplayOutcome& outcome() const { return outcome_; }
  bool has_differed() const { return !outcome_.difference.empty(); }

  Status take(std::string_view topic, std::string_view message) {
    if (topic == kDepthTopic) {
      auto frame = read_depth(message);
      if (!frame) return frame.error();
      if (can_repeat_contacts_) contacts_.add(*std::move(frame));
      if (contacts_.has_gap()) end_contacts("a depth frame");
    } else if (topic == kContactTopic) {
      auto contact = read_contact(message);
      if (!contact) return contact.error();
      known_[contact->number] = contact->contact;
      if (can_repeat_contacts_) waiting_contacts_.push_back({*contact, std::string(message)});
    } else if (topic == kTickTopic && can_repeat_ticks_) {
      auto tick = read_tick(message);
      if (!tick) return tick.error();
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
      outcome_.difference =
          difference("tick " + std::to_string(recorded.number), message,
                     tick_message(ticks_.repeat(
                         recorded, is_measured ? known_.begin()->second : LocalContact{})));
      ++outcome_.num_ticks;
      waiting_ticks_.pop_front();
    }
  }

  ContactRepetition contacts_;
  TickRepetition ticks_;
  std::map<std::uint64_t, LocalContact> known_;  // by number
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

Result<Repetition> make_repetition(const Tool& tool, const HapticSetup& setup, int num_threads) {
  const DeviceLimits& limits = setup.device.limits;
  if (!(setup.device.rate > 0)) {
    return Error{Errc::bad_input, "the recording tells no rate of ticks; record the run again"};
  }
  const auto coupling = check_coupling(setup.settings.coupling, limits, 1 / setup.device.rate);
  if (!coupling) return coupling.error();
  auto safety = SafetyFilter::create(limits, setup.settings.safety);
  if (!safety) return safety.error();
  auto contacts = ContactRepetition::create(tool, setup, coupling->options, num_threads);
  if (!contacts) return contacts.error();
  return Repetition(*std::move(contacts),
                    TickRepetition(make_coupling(coupling->options, limits, tool.sphere_mass()),
                                   *std::move(safety)));
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
  if (options.output) {
    return Error{Errc::invalid_argument,
                 "a haptic run is repeated and compared, but not kept once more; copy its folder"};
  }
  const fs::path path = folder / kHapticRecording;
  auto reader = McapReader::open(path);
  if (!reader) return reader.error();
  const auto setup = next_settings(*reader, path);
  if (!setup) return setup.error();
  const auto tool = load_recorded_tool(folder / kHapticTool, setup->tool_checksum);
  if (!tool) return tool.error();
  auto repetition =
      make_repetition(*tool, *setup, options.num_threads.value_or(setup->settings.num_threads));
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
  return repetition->outcome();
}

}  // namespace palpate
