// The parts of the live loop, each by itself.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <fstream>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "palpate/mesh/mesh.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/run/internal/real_time.h"
#include "src/run/loop/blend_clock.h"
#include "src/run/loop/contact_stage.h"
#include "src/run/loop/load_governor.h"
#include "src/run/loop/queues/paced_source.h"
#include "src/run/loop/queues/record_queue.h"
#include "src/run/loop/stiffness_schedule.h"
#include "src/run/loop/surface_stage.h"
#include "tests/run/live_loop_fixtures.h"
#include "tests/test_util/sanitized.h"

namespace palpate {
namespace {

using test::WallSource;

TEST(RecordQueue, KeepsTheOrderAndCountsWhatDoesNotFit) {
  RecordQueue<int> queue(4);
  EXPECT_EQ(queue.front(), nullptr);
  for (int i = 0; i < 6; ++i) queue.push(i);
  EXPECT_EQ(queue.num_lost(), 2u);
  for (int i = 0; i < 4; ++i) {
    ASSERT_NE(queue.front(), nullptr);
    EXPECT_EQ(*queue.front(), i);
    queue.pop();
  }
  EXPECT_EQ(queue.front(), nullptr);
  queue.push(7);
  EXPECT_EQ(*queue.front(), 7);
}

TEST(RecordQueue, TwoThreadsSeeEveryValueOnceInOrder) {
  constexpr int kNum = 20000;
  RecordQueue<std::pair<int, int>> queue(64);
  std::thread writer([&] {
    for (int i = 0; i < kNum;) {
      if (auto* slot = queue.draft()) {
        *slot = {i, -i};
        queue.push();
        ++i;
      } else {
        std::this_thread::yield();
      }
    }
  });
  for (int i = 0; i < kNum;) {
    const auto* value = queue.front();
    if (value == nullptr) {
      std::this_thread::yield();
      continue;
    }
    ASSERT_EQ(value->first, i);
    ASSERT_EQ(value->second, -i);
    queue.pop();
    ++i;
  }
  writer.join();
}

// Surfaces are ready at uneven times; each is taken up when the blend to the last is complete.
TEST(BlendClock, NoStepsFromEarlySurfacesAndNoLastingLagFromLateOnes) {
  constexpr double kPeriod = 1.0 / 30;
  const auto ready = [](int k) {
    const double jitter = k == 10 ? 0.030 : 0.004 * std::sin(12.9898 * k);
    return k * kPeriod + jitter;
  };
  BlendClock clock;
  double now = 0, last = 0;
  int k = 0;
  std::vector<double> waits;
  for (; k < 60; now += 1e-3) {
    if (now >= ready(k) && clock.is_complete(now)) {
      EXPECT_EQ(clock.progress(now), 1);
      waits.push_back(now - ready(k));
      clock.begin(now, now - 1e-3, ready(k), kPeriod);
      EXPECT_GE(clock.progress(now), 0.99e-3 / kPeriod);  // it is felt at once
      last = 0;
      ++k;
    }
    const double progress = clock.progress(now);
    EXPECT_GE(progress, last);
    EXPECT_LE(progress - last, 2.1e-3 / kPeriod);  // at most twice the usual pace
    last = progress;
  }
  EXPECT_GT(waits[11], 0.02);  // behind the late one
  for (std::size_t i = 15; i < waits.size(); ++i) EXPECT_LT(waits[i], 0.012);
}

TEST(StiffnessSchedule, TakesNoMoreTimeThanIsLeft) {
  const auto share_of = [](double query, double stiffness) {
    StiffnessSchedule schedule(1e-3);
    int num = 0;
    for (int i = 0; i < 1000; ++i) {
      if (schedule.is_due()) {
        schedule.took(query + stiffness, true);
        ++num;
      } else {
        schedule.took(query, false);
      }
    }
    return num;
  };
  EXPECT_EQ(share_of(1e-4, 5e-4), 1000);
  EXPECT_NEAR(share_of(1e-4, 2e-3), 333, 5);
  EXPECT_GE(share_of(5e-3, 1), 30);  // now and then, whatever it takes
}

// Work that a loop leaves out when time is short.

LoadWindow late_frames() { return {.old_frames = 0.5, .ageing = 0.6}; }
LoadWindow late_contacts() { return {.old_contacts = 0.5, .ageing = 0.6}; }
int total(const ReliefSteps& steps) { return steps.page + steps.image + steps.spheres; }

TEST(LoadRelief, GivesThePageFirstThenWhatIsLate) {
  LoadRelief relief(2, 3);
  LoadWindow window = late_frames();
  window.has_page = true;
  EXPECT_TRUE(relief.look(window));
  EXPECT_EQ(relief.steps(), (ReliefSteps{1, 0, 0}));
  EXPECT_TRUE(relief.look(window));
  EXPECT_EQ(relief.steps(), (ReliefSteps{1, 1, 0}));
  EXPECT_TRUE(relief.look(late_contacts()));
  EXPECT_EQ(relief.steps(), (ReliefSteps{1, 1, 1}));
  // No smaller than that.
  for (int i = 0; i < 9; ++i) relief.look(late_frames());
  for (int i = 0; i < 9; ++i) relief.look(late_contacts());
  EXPECT_EQ(relief.steps(), (ReliefSteps{1, 2, 3}));
  EXPECT_FALSE(relief.look(late_frames()));
}

TEST(LoadRelief, APageThatIsOnlyLateMakingCostsNothingElse) {
  LoadRelief relief(2, 3);
  const LoadWindow window{.ageing = 0.1, .has_page = true};
  for (int i = 0; i < 50; ++i) relief.look(window);
  EXPECT_EQ(relief.steps(), (ReliefSteps{1, 0, 0}));
  // Without a page nothing is late enough.
  LoadRelief alone(2, 3);
  for (int i = 0; i < 50; ++i) alone.look({.ageing = 0.1});
  EXPECT_FALSE(alone.steps().any());
}

TEST(LoadRelief, ACameraThatSendsNothingIsNotHelpedBySmallerImages) {
  LoadRelief relief(2, 3);
  LoadWindow window = late_frames();
  window.has_frames = false;
  for (int i = 0; i < 50; ++i) EXPECT_FALSE(relief.look(window));
}

// A load that only the smaller image can bear: the tries to come back get rarer and rarer, and
// end once the load is gone.
TEST(LoadRelief, ComesBackByItselfAndDoesNotHunt) {
  LoadRelief relief(2, 3);
  int num_changes = 0;
  for (int i = 0; i < 3600; ++i) {
    num_changes += relief.look(relief.steps().image == 0 ? late_frames() : LoadWindow{});
  }
  // Every 160 s in the end: forth and back again.
  EXPECT_GT(num_changes, 20);
  EXPECT_LT(num_changes, 2 * (3600 / 160 + 8));
  int needed = 0;
  while (relief.steps().any() && ++needed < 1000) relief.look({});
  EXPECT_LE(needed, LoadRelief::kMaxCalm);
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(relief.look({}));
}

// Whatever comes: one step at a time and kind, within bounds, further only if something was late,
// back only if nothing was for as long as it takes; and all the way back when it is over.
TEST(LoadRelief, AnyLoadIsAnsweredWithinBoundsAndForgotten) {
  for (unsigned seed = 0; seed < 300; ++seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> share(0, 1);
    const int max_image = static_cast<int>(seed % 3), max_spheres = static_cast<int>(seed % 4);
    LoadRelief relief(max_image, max_spheres);
    double calm = 0;
    for (int i = 0; i < 2000; ++i) {
      const bool is_bad = std::fmod(i, 200) < 200 * share(random) * share(random);
      LoadWindow window;
      window.seconds = 0.5 + share(random);
      window.has_page = share(random) < 0.5;
      window.has_frames = share(random) < 0.9;
      if (is_bad) {
        window.old_frames = share(random) < 0.5 ? share(random) : 0;
        window.old_contacts = share(random) < 0.3 ? share(random) : 0;
        window.ageing = std::max({window.old_frames, window.old_contacts, 0.1 * share(random)});
      }
      const bool is_late = window.old_frames > LoadRelief::kFew ||
                           window.old_contacts > LoadRelief::kFew ||
                           (window.has_page && window.ageing > LoadRelief::kFew);
      const ReliefSteps before = relief.steps();
      const double patience = relief.patience();
      calm = is_late ? 0 : calm + window.seconds;
      const bool has_changed = relief.look(window);
      const ReliefSteps& after = relief.steps();
      ASSERT_EQ(has_changed, before != after);
      ASSERT_LE(after.page, 1);
      ASSERT_LE(after.image, max_image);
      ASSERT_LE(after.spheres, max_spheres);
      ASSERT_GE(std::min({after.page, after.image, after.spheres}), 0);
      if (total(after) > total(before)) {
        ASSERT_TRUE(is_late);
        if (after.page > before.page) {
          ASSERT_EQ(total(after), total(before) + 1);
        }
        ASSERT_LE(after.image - before.image, window.old_frames > 0 ? 1 : 0);
        ASSERT_LE(after.spheres - before.spheres, window.old_contacts > 0 ? 1 : 0);
      } else if (has_changed) {
        ASSERT_EQ(total(after), total(before) - 1);
        ASSERT_GE(calm, patience);
        calm = 0;
      }
      ASSERT_LE(relief.patience(), LoadRelief::kMaxCalm);
    }
    for (int i = 0; i < 2000; ++i) relief.look({});
    ASSERT_FALSE(relief.steps().any());
  }
}

TEST(LoadRelief, SaysWhatIsLessAndWhatIsBack) {
  EXPECT_EQ(describe_relief({}, {1, 0, 0}, 1, 1000),
            "the computer is overloaded: pages are drawn less often from now on");
  EXPECT_EQ(describe_relief({1, 0, 0}, {1, 1, 1}, 1, 1000),
            "the computer is overloaded: depth images are made 2 times smaller, 500 of "
            "1000 spheres are used from now on");
  EXPECT_EQ(describe_relief({1, 1, 0}, {1, 0, 0}, 1, 1000),
            "the load is lower again: depth images are used in full from now on");
  EXPECT_EQ(describe_relief({}, {}, 1, 1000), "");
}

TEST(PacedSource, KeepsTheDistancesOfTheTimeStamps) {
  WallSource wall({});
  PacedSource source(wall);
  DepthFrame frame;
  double now = 1000;
  for (int k = 0; k < 5; ++k) {
    ASSERT_TRUE(*source.read(frame));
    EXPECT_NEAR(source.capture_time(frame, now), 1000 + k / 30.0, 1e-9);
    now = 1000 + k / 30.0;
  }
  EXPECT_EQ(source.num_late(), 0u);
  // A slow source moves all that follows.
  now += 0.5;
  ASSERT_TRUE(*source.read(frame));
  EXPECT_NEAR(source.capture_time(frame, now), now, 1e-9);
  ASSERT_TRUE(*source.read(frame));
  EXPECT_NEAR(source.capture_time(frame, now), now + 1 / 30.0, 1e-9);
  EXPECT_EQ(source.num_late(), 1u);
}

TEST(RealTime, NamesWhyFramesWereLeftOut) {
  LatencyHistogram fast, slow;
  for (int i = 0; i < 100; ++i) fast.record(200'000);
  for (int i = 0; i < 100; ++i) slow.record(i < 90 ? 20'000'000 : 60'000'000);
  const auto has = [](const std::string& text, const char* words) {
    return text.find(words) != std::string::npos;
  };
  const std::string by_surfaces = frames_left_out(8, 2, slow, 1 / 30.0);
  EXPECT_TRUE(has(by_surfaces, "8 depth frames")) << by_surfaces;
  EXPECT_TRUE(has(by_surfaces, "surfaces take 2")) << by_surfaces;
  EXPECT_TRUE(has(by_surfaces, "10 of them took longer than the 33 ms")) << by_surfaces;
  // A camera that renders late is not the surfaces' fault.
  const std::string by_camera = frames_left_out(8, 5, fast, 1 / 30.0);
  EXPECT_TRUE(has(by_camera, "frames came late 5 times")) << by_camera;
  EXPECT_FALSE(has(by_camera, "surfaces")) << by_camera;
  EXPECT_TRUE(has(frames_left_out(8, 0, fast, 1 / 30.0), "the processor was busy"));
}

/// kB of this program that cannot be paged out.
long locked_memory() {
  std::ifstream file("/proc/self/status");
  for (std::string word; file >> word;) {
    long kilobytes = 0;
    if (word == "VmLck:" && file >> kilobytes) return kilobytes;
  }
  return -1;
}

// Two runs of one program: the end of the first leaves the second its memory.
TEST(RealTime, MemoryIsLockedUntilTheLastRunHasEnded) {
  MemoryLock first, second;
  if (const int refused = first.hold()) GTEST_SKIP() << memory_lock_refused(refused);
  if (test::kIsSanitized) GTEST_SKIP() << "sanitizers lock no memory";
  ASSERT_EQ(second.hold(), 0);
  ASSERT_EQ(second.hold(), 0);  // again, for what has come since
  ASSERT_GT(locked_memory(), 0);
  first.release();
  first.release();
  EXPECT_GT(locked_memory(), 0);
  second.release();
  EXPECT_EQ(locked_memory(), 0);
}

// With a tick of 10 ms a contact is that old, however much time there is.
TEST(LoadCounts, ContactsAreAsOldAsATickAndNotLateForThat) {
  const auto counts_of = [](double age, double tick_rate) {
    LoopTimes times;
    for (int k = 0; k < 100; ++k) times.contact_age.record(static_cast<std::int64_t>(1e9 * age));
    LoadCounts counts;
    counts.count_ages(times, SafetyOptions(), 30, 1000, tick_rate);
    return counts;
  };
  EXPECT_EQ(counts_of(0.0105, 100).old_contacts, 0u);
  EXPECT_EQ(counts_of(0.0105, 100).ageing_contacts, 0u);
  EXPECT_EQ(counts_of(0.0105, 1000).old_contacts, 100u);
  EXPECT_EQ(counts_of(0.0195, 100).old_contacts, 100u);
}

TEST(PacedSource, RefusesFramesThatDoNotFit) {
  class Odd final : public DepthSource {
   public:
    const DepthStreamInfo& info() const override { return wall.info(); }
    Result<bool> next(DepthFrame& frame) override {
      auto got = wall.next(frame);
      if (++number == wrong) spoil(frame);
      return got;
    }
    WallSource wall{WallSource::Options{}};
    int number = 0, wrong = 3;
    std::function<void(DepthFrame&)> spoil;
  };
  const std::pair<std::function<void(DepthFrame&)>, const char*> spoils[] = {
      {[](DepthFrame& frame) { frame.width += 1; }, "has another size"},
      {[](DepthFrame& frame) { frame.pixels.pop_back(); }, "has another size"},
      {[](DepthFrame& frame) { frame.timestamp = -100; }, "is not later than the one before"},
      {[](DepthFrame& frame) { frame.timestamp = NAN; }, "has a time stamp of nan s; give seconds"},
      {[](DepthFrame& frame) { frame.timestamp = 1.7e18; }, "has a time stamp of 1.7e+18 s; give"},
      {[](DepthFrame& frame) { frame.unit = 2; }, "has a unit of 2 m per count"},
      {[](DepthFrame& frame) { frame.unit = 0; }, "has a unit of 0 m per count"},
  };
  for (const auto& [spoil, words] : spoils) {
    Odd odd;
    odd.spoil = spoil;
    PacedSource source(odd);
    DepthFrame frame;
    for (int k = 0; k < 2; ++k) {
      ASSERT_TRUE(source.read(frame).has_value());
      source.capture_time(frame, k / 30.0);
    }
    const auto got = source.read(frame);
    ASSERT_FALSE(got.has_value());
    EXPECT_NE(got.error().message.find(std::string("frame 2 ") + words), std::string::npos)
        << got.error().message;
  }
}

std::vector<SurfaceTimeline> timelines_of(const DepthSources& sources, TimeMode mode) {
  TimeOptions time;
  time.mode = mode;
  std::vector<SurfaceTimeline> timelines;
  for (const DepthSource* source : sources) {
    timelines.push_back(SurfaceTimeline::create(
                            source->info(), {.time = time, .num_spare = SurfaceStage::kNumSpare})
                            .value());
  }
  return timelines;
}

double wall_depth(int frame) { return 0.4 + 0.0001 * (frame % 1000); }

// Every frame is a wall of another depth. A reader of surfaces that are being rewritten sees points
// of two walls (and the thread sanitizer sees it too).
TEST(SurfaceStage, NobodyRewritesTheSurfacesThatAreLookedAt) {
  for (const TimeMode mode : {TimeMode::interpolate, TimeMode::latest, TimeMode::predict}) {
    WallSource source({.depth = wall_depth, .rate = 400});
    LatencyHistogram times;
    SurfaceStage stage(source, timelines_of(source, mode), test::patient_settings(), {}, false,
                       times);
    ASSERT_TRUE(stage.start());
    const auto look_at = [](const PointCloudView& cloud) {
      double least = 1e9, most = 0;
      for (int v = 5; v < cloud.height - 5; ++v) {
        for (int u = 5; u < cloud.width - 5; ++u) {
          const double z = static_cast<double>(cloud.z[v * cloud.width + u]);
          least = std::min(least, z);
          most = std::max(most, z);
        }
      }
      EXPECT_NEAR(least, most, 1e-5);
    };
    int num_taken = 0;
    const double begin = monotonic_now();
    while (num_taken < 40 && monotonic_now() - begin < 120) {
      if (!stage.take(0)) continue;
      ++num_taken;
      const LiveSurfaces& live = stage.taken(0);
      // Long enough for frames to come meanwhile.
      std::this_thread::sleep_for(std::chrono::milliseconds(num_taken % 8));
      look_at(live.blend.to.cloud);
      if (live.frame_number == 0) continue;
      EXPECT_EQ(live.blend.progress, mode == TimeMode::latest ? 1 : 0);
      look_at(live.blend.from.cloud);
    }
    EXPECT_GE(num_taken, 20);
    stage.stop();
  }
}

/// A query with given results.
class SpoiltQuery final : public ContactQuery {
 public:
  explicit SpoiltQuery(int good) : good_(good) {}
  using ContactQuery::measure;
  ContactResult measure_one(const SurfaceView&, const SurfaceView&, double, const Pose&,
                            const ContactWants&) const noexcept override {
    Penetration result;
    if (good_-- > 0) {
      result.volume = 1e-6;
      result.measure_W.force = {0, 0, -1e-6};
    } else {
      result.status = StepStatus::backend_failed;
    }
    return {result, {}};
  }

 private:
  mutable int good_;
};

TEST(ContactStage, KeepsTheLastContactWhenTheBackendFails) {
  WallSource source({});
  LatencyHistogram surface_times, contact_times;
  SurfaceStage surfaces(source, timelines_of(source, TimeMode::interpolate),
                        test::patient_settings(), {}, false, surface_times);
  ASSERT_TRUE(surfaces.start());
  ContactStage::Settings settings;
  settings.wants_real_time = false;
  ContactStage contacts(
      std::make_unique<ContactPart>(test::box_tool(), std::make_unique<SpoiltQuery>(10),
                                    ContactScale{VolumeStiffness{1e6}}),
      surfaces, settings, contact_times);
  contacts.start(monotonic_now(), [](const Error& error) { ADD_FAILURE() << error.message; });
  const double begin = monotonic_now();
  while (!contacts.has_backend_failed() && monotonic_now() - begin < 120) {
    contacts.move_tool({monotonic_now(), Pose{}});
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_TRUE(contacts.has_backend_failed());
  EXPECT_GT(contacts.newest().number, 0u);
  EXPECT_EQ(contacts.newest().number, contacts.num_contacts());
  EXPECT_NEAR(contacts.newest().contact.F_C_W.force.z, -1, 1e-12);
  contacts.stop();
}

}  // namespace
}  // namespace palpate
