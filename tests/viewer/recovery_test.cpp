// Pages of a live run whose force a fault has taken, or that is short of time.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <regex>
#include <string>
#include <thread>
#include <utility>

#include "palpate/session/run.h"
#include "palpate/viewer/viewer.h"
#include "src/core/internal/monotonic_clock.h"
#include "tests/session/live_hand.h"
#include "tests/session/synthetic_stream.h"
#include "tests/viewer/watcher.h"

namespace palpate {
namespace {

using test::patient_settings;
using test::pressing_device;
using test::small_tool;
using test::SyntheticStream;
using test::Watcher;

/// A live run in a thread, with a view that ends it.
class SeenRun {
 public:
  SeenRun(DepthSource& stream, const RunSettings& settings)
      : view(LiveView::create(tool_, {stream.info()}, "hand")), watcher(*view) {
    view->monitor().observer.on_note = [this](std::string_view note) {
      const auto has = [note](const char* words) { return note.find(words) != note.npos; };
      is_page_thinned = is_page_thinned || has("pages are drawn less often");
      is_image_thinned = is_image_thinned || has("depth images are made");
    };
    thread_ = std::thread([this, &stream, settings] {
      const auto device = pressing_device();
      RunOptions options;
      options.keep_going = [this] { return !view->wants_end(); };
      options.monitor = &view->monitor();
      outcome_ = record_run(tool_, stream, *device, settings, folder_.path() / "run", options);
      has_ended_ = true;
    });
  }
  ~SeenRun() { end(); }

  /// The summary of the run.
  nlohmann::json end() {
    if (thread_.joinable()) {
      watcher.until([&] {
        return watcher.command({{"command", "end"}}).has_value() || has_ended_;
      });
      thread_.join();
    }
    EXPECT_TRUE(*outcome_) << outcome_->error().message;
    return *outcome_ ? nlohmann::json::parse((*outcome_)->summary_json) : nlohmann::json();
  }

 private:
  const Tool tool_ = small_tool();

 public:
  std::unique_ptr<LiveView> view;
  Watcher watcher;
  std::atomic<bool> is_page_thinned = false, is_image_thinned = false;

 private:
  test::TemporaryFolder folder_;
  std::optional<Result<RunOutcome>> outcome_;
  std::atomic<bool> has_ended_ = false;
  std::thread thread_;
};

/// Sends nothing while it is held.
class HeldStream final : public SyntheticStream {
 public:
  HeldStream() : SyntheticStream(100000) {}
  Result<bool> next(DepthFrame& frame) override {
    test::wait_for([&] { return !is_held; });
    return SyntheticStream::next(frame);
  }
  std::atomic<bool> is_held = false;
};

TEST(PageOfALiveRun, SaysWhyThereIsNoForceAndSinceWhenAndBringsItBack) {
  RunSettings settings = patient_settings();
  settings.safety.max_sensor_age = 0.5;
  settings.safety.recover_seconds = 0.1;
  settings.safety.max_recoveries = 0;  // after any fault a person has to ask
  HeldStream stream;
  SeenRun run(stream, settings);
  Watcher& page = run.watcher;
  const auto is = [&](const char* state) { return page.state()["force"] == state; };
  ASSERT_TRUE(page.until([&] { return is("engaged") || is("held_off"); }));
  stream.is_held = true;
  ASSERT_TRUE(page.until([&] { return is("held_off"); }));

  struct Told {
    double time, seconds;  // of the run; since the fault
  };
  const auto told = [&]() -> Told {
    const auto state = page.state();
    const std::string note = state["note"];
    EXPECT_EQ(note.find(describe(Fault::stale_sensor)), 0u) << note;
    EXPECT_NE(note.find("it stays off until you ask for it"), std::string::npos) << note;
    std::smatch found;
    const std::regex since(R"(\(for ([0-9.]+) s, fault ([0-9]+)\))");
    EXPECT_TRUE(std::regex_search(note, found, since)) << note;
    return {state["time"], found.empty() ? 0 : std::stod(found[1])};
  };
  const Told first = told();
  Told later = first;
  ASSERT_TRUE(page.until([&] { return (later = told()).seconds >= first.seconds + 0.3; }));
  EXPECT_NEAR(later.seconds - first.seconds, later.time - first.time, 0.11);  // in tenths

  // All is well again, and still there is no force.
  stream.is_held = false;
  ASSERT_TRUE(page.until([&] { return page.state()["sensor_age"] < 0.2; }));
  EXPECT_TRUE(is("held_off"));
  ASSERT_TRUE(page.until([&] {  // a busy machine may be late again
    if (is("held_off")) page.execute({{"command", "force"}});
    return is("engaged");
  }));
  EXPECT_EQ(run.end()["faults"][0]["fault"], "stale_sensor");
}

/// Nothing is sent by a poll while the computer is short of time, but four times a second.
TEST(PageOfALiveRun, IsDrawnLessOftenWhereTheComputerIsShortOfTime) {
  class SlowStream final : public SyntheticStream {
   public:
    SlowStream() : SyntheticStream(100000, 100) {}
    Result<bool> next(DepthFrame& frame) override {
      std::this_thread::sleep_for(std::chrono::milliseconds(80));
      return SyntheticStream::next(frame);
    }
  };
  RunSettings settings = patient_settings();
  settings.safety.max_sensor_age = 0.1;
  SlowStream stream;
  SeenRun run(stream, settings);
  ASSERT_TRUE(run.watcher.until([&] { return run.is_page_thinned.load(); }));
  // Ticks come all the time, so each poll that is not spared has some.
  int num_polls = 0, num_pictures = 0;
  std::size_t num_samples = run.watcher.samples.size();
  const double begin = monotonic_now();
  ASSERT_TRUE(run.watcher.until([&] {
    ++num_polls;
    num_pictures +=
        run.watcher.samples.size() > std::exchange(num_samples, run.watcher.samples.size());
    return num_polls > 100 && num_pictures > 4 && run.is_image_thinned;  // a window later
  }));
  EXPECT_LE(num_pictures, 1 + (monotonic_now() - begin) / 0.25);
  EXPECT_GT(run.end()["page_thinned_s"], 0.0);
}

}  // namespace
}  // namespace palpate
