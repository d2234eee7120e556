// A backend that is slow, as a GPU that others use too: in a live run every query takes as long as
// a test wants. The linker puts `slow_query` in the place of make_contact_query (CMakeLists.txt):
// all around it is what users run.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/session/run.h"
#include "tests/session/live_hand.h"
#include "tests/session/recorded_messages.h"
#include "tests/session/repeated_run.h"
#include "tests/session/synthetic_stream.h"

namespace palpate {
namespace {

std::atomic<double> g_seconds_per_sphere = 0;

/// Another query, and the time that it takes.
class SlowQuery final : public ContactQuery {
 public:
  explicit SlowQuery(std::unique_ptr<ContactQuery> query)
      : ContactQuery(query->index(), query->method()), query_(std::move(query)) {}

  using ContactQuery::measure;
  ContactResult measure_one(const SurfaceView& from, const SurfaceView& to, double alpha,
                            const Pose& X_CT, const ContactWants& wants) const noexcept override {
    const auto num = static_cast<double>(index()->tool().spheres().size());
    std::this_thread::sleep_for(std::chrono::duration<double>(g_seconds_per_sphere * num));
    return query_->measure(from, to, alpha, X_CT, wants);
  }

 private:
  std::unique_ptr<ContactQuery> query_;
};

}  // namespace

// PALPATE_MAKE_QUERY is the name that the compiler gives make_contact_query.
using MadeQuery = Result<std::unique_ptr<ContactQuery>>;
MadeQuery usual_query(const Place& place, std::shared_ptr<const ToolIndex> index,
                      const ContactMethod& method,
                      const ExecutionOptions& options) asm("__real_" PALPATE_MAKE_QUERY);
MadeQuery slow_query(const Place& place, std::shared_ptr<const ToolIndex> index,
                     const ContactMethod& method,
                     const ExecutionOptions& options) asm("__wrap_" PALPATE_MAKE_QUERY);
MadeQuery slow_query(const Place& place, std::shared_ptr<const ToolIndex> index,
                     const ContactMethod& method, const ExecutionOptions& options) {
  auto query = usual_query(place, std::move(index), method, options);
  if (!query) return query.error();
  return std::unique_ptr<ContactQuery>(std::make_unique<SlowQuery>(*std::move(query)));
}

namespace {

using std::chrono::steady_clock;
using test::expect_repeats;
using test::patient_settings;
using test::pressing_device;
using test::RecordedMessage;
using test::small_tool;
using test::SyntheticStream;
using test::TemporaryFolder;

/// A wall that stands still.
class StandingStream final : public SyntheticStream {
 public:
  StandingStream() : SyntheticStream(1 << 30) {}
  Result<bool> next(DepthFrame& frame) override {
    auto got = SyntheticStream(1).next(frame);
    frame.timestamp += number_++ / info().rate;
    return got;
  }

 private:
  int number_ = 0;
};

/// Runs until `is_done` is true of a tick, or for five minutes.
template <class IsDone>
Result<RunOutcome> run_until(const std::filesystem::path& folder, const RunSettings& settings,
                             RunMonitor& monitor, const IsDone& is_done) {
  std::atomic<bool> has_ended = false;
  monitor.observer.on_ticks = [&](std::span<const TickRecord> ticks) {
    for (const TickRecord& tick : ticks) has_ended = has_ended || is_done(tick);
  };
  StandingStream stream;
  const auto device = pressing_device();
  const auto deadline = steady_clock::now() + std::chrono::minutes(5);
  RunOptions options;
  options.monitor = &monitor;
  options.keep_going = [&] { return !has_ended && steady_clock::now() < deadline; };
  auto outcome = record_run(small_tool(), stream, *device, settings, folder, options);
  g_seconds_per_sphere = 0;  // whoever repeats the run need not wait
  EXPECT_TRUE(has_ended);
  return outcome;
}

// Contacts of a second while 0.3 s are allowed: the force fades. Then the backend is fast again,
// and the force comes back by itself once the hand has left the wall.
TEST(SlowBackend, TheForceFadesAndComesBackAndAllIsRepeated) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  RunSettings settings = patient_settings();
  settings.safety.max_contact_age = 0.3;
  settings.safety.recover_seconds = 0.1;
  settings.safety.ramp_seconds = 0.1;
  settings.may_thin = false;
  const auto num_spheres = static_cast<double>(small_tool().spheres().size());
  enum { pushing, slow, well } stage = pushing;
  RunMonitor monitor;
  const auto outcome = run_until(run, settings, monitor, [&](const TickRecord& tick) {
    if (stage == pushing && norm(tick.F_H_B.force) > 0.2) {
      g_seconds_per_sphere = 1 / num_spheres;
      stage = slow;
    } else if (stage == slow && tick.safety.state == ForceState::off) {
      g_seconds_per_sphere = 0;
      stage = well;
    }
    return stage == well && tick.safety.gain == 1 && norm(tick.F_H_B.force) > 0.2;
  });
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_EQ(outcome->failure, "");
  const auto summary = nlohmann::json::parse(outcome->summary_json);
  ASSERT_FALSE(summary["faults"].empty());
  EXPECT_EQ(summary["faults"][0]["fault"], "stale_contact");
  EXPECT_GT(summary["faults"][0]["seconds"], 0.1);

  // The fault in the recording.
  std::vector<ForceState> states;
  std::vector<std::string> notes;
  TickRecord last;
  double fade_began = 0;
  for (const RecordedMessage& message : test::messages(run)) {
    if (message.channel.topic == kNoteTopic) notes.push_back(*read_note(message.data));
    if (message.channel.topic != kTickTopic) continue;
    const TickRecord tick = *read_tick(message.data);
    const SafetyStatus& now = tick.safety;
    if (states.empty() || states.back() != now.state) states.push_back(now.state);
    const double force = norm(tick.F_H_B.force), before = norm(last.F_H_B.force);
    const double dt = tick.device.time - last.device.time;
    if (now.fault == Fault::none) {
      ASSERT_LE(force, before + settings.safety.max_slew * dt + 1e-9) << tick.number;
    } else {
      EXPECT_TRUE(now.fault == Fault::stale_contact || now.fault == Fault::stopped);
      ASSERT_LE(force, before * (1 + 1e-12)) << tick.number;
      if (last.safety.fault == Fault::none) fade_began = tick.device.time;
      if (tick.device.time - fade_began > settings.safety.fade_seconds + 1e-9) {
        ASSERT_EQ(force, 0) << tick.number;
      }
    }
    last = tick;
  }
  const ForceState desired[] = {ForceState::engaged, ForceState::fading, ForceState::off,
                                ForceState::waiting, ForceState::engaged};
  EXPECT_NE(std::search(states.begin(), states.end(), std::begin(desired), std::end(desired)),
            states.end());
  EXPECT_EQ(states.back(), ForceState::ended);
  const auto is_noted = [&](std::string_view words) {
    return std::any_of(notes.begin(), notes.end(), [&](const std::string& note) {
      return note.find(words) != std::string::npos;
    });
  };
  EXPECT_TRUE(is_noted(describe(Fault::stale_contact)));
  EXPECT_TRUE(is_noted("the force comes up"));
  expect_repeats(run, *outcome);
}

// A third of the limit for one contact: the next one comes when it is two thirds old, which is more
// than half. With fewer spheres it is less.
TEST(SlowBackend, FewerSpheresAreUsedAndAllIsRepeated) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  RunSettings settings = patient_settings();
  settings.safety.max_contact_age = 3;
  const auto num_spheres = static_cast<int>(small_tool().spheres().size());
  g_seconds_per_sphere = settings.safety.max_contact_age / 3 / num_spheres;
  std::vector<int> requested;
  RunMonitor monitor;
  monitor.observer.on_settings = [&](std::uint32_t, const RunSettings& now) {
    requested.push_back(now.num_spheres);
  };
  std::uint64_t thinned_from = 0;
  const auto outcome = run_until(run, settings, monitor, [&](const TickRecord& tick) {
    if (requested.empty() || requested.back() == 0) return false;
    if (thinned_from == 0) thinned_from = tick.contact_number;
    return tick.contact_number > thinned_from + 3;
  });
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_EQ(outcome->failure, "");
  ASSERT_FALSE(requested.empty());
  EXPECT_EQ(requested.front(), num_spheres / 2);
  const auto summary = nlohmann::json::parse(outcome->summary_json);
  EXPECT_GT(summary["spheres_thinned_s"], 0.0);
  bool is_reported = false;
  for (const RecordedMessage& message : test::messages(run)) {
    is_reported =
        is_reported || (message.channel.topic == kNoteTopic &&
                        read_note(message.data)->find("spheres are used") != std::string::npos);
  }
  EXPECT_TRUE(is_reported);
  expect_repeats(run, *outcome);
}

}  // namespace
}  // namespace palpate
