// The parts of the live loop, each by itself.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <thread>
#include <vector>

#include "palpate/mesh/shapes.h"
#include "src/core/monotonic_clock.h"
#include "src/run/loop/blend_clock.h"
#include "src/run/loop/contact_stage.h"
#include "src/run/loop/paced_source.h"
#include "src/run/loop/real_time.h"
#include "src/run/loop/record_queue.h"
#include "src/run/loop/stiffness_schedule.h"
#include "src/run/loop/surface_stage.h"
#include "tests/run/live_loop_fixtures.h"

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
      clock.begin(now, ready(k), kPeriod);
      EXPECT_EQ(clock.progress(now), 0);
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
  const std::function<void(DepthFrame&)> spoils[] = {
      [](DepthFrame& frame) { frame.width += 1; },
      [](DepthFrame& frame) { frame.pixels.pop_back(); },
      [](DepthFrame& frame) { frame.timestamp = 100; },
      [](DepthFrame& frame) { frame.timestamp = NAN; },
  };
  for (const auto& spoil : spoils) {
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
    EXPECT_NE(got.error().message.find("frame 2"), std::string::npos) << got.error().message;
  }
}

SurfaceTimeline timeline_of(const DepthSource& source, TimeMode mode) {
  TimeOptions time;
  time.mode = mode;
  return SurfaceTimeline::create(source.info(), {}, DepthFieldOptions{}, time, {},
                                 SurfaceStage::kNumSpare)
      .value();
}

double wall_depth(int frame) { return 0.4 + 0.0001 * (frame % 1000); }

// Every frame is a wall of another depth. Whoever looks at surfaces that are being rewritten sees
// points of two walls (and the thread sanitizer sees it too).
TEST(SurfaceStage, NobodyRewritesTheSurfacesThatAreLookedAt) {
  for (const TimeMode mode : {TimeMode::interpolate, TimeMode::latest, TimeMode::predict}) {
    WallSource source({.depth = wall_depth, .rate = 400});
    LatencyHistogram times;
    SurfaceStage stage(source, timeline_of(source, mode), test::patient_settings(), {}, false,
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
    while (num_taken < 40 && monotonic_now() - begin < 5) {
      if (!stage.take()) continue;
      ++num_taken;
      const LiveSurfaces& live = stage.taken();
      // Long enough for frames to come meanwhile.
      std::this_thread::sleep_for(std::chrono::milliseconds(num_taken % 8));
      look_at(live.moment.to.cloud);
      if (live.frame_number == 0) continue;
      EXPECT_EQ(live.moment.progress, mode == TimeMode::latest ? 1 : 0);
      look_at(live.moment.from.cloud);
    }
    EXPECT_GE(num_taken, 20);
    stage.stop();
  }
}

/// Measures what it is told to.
class SpoiltQuery final : public ContactQuery {
 public:
  explicit SpoiltQuery(int good) : good_(good) {}
  using ContactQuery::measure;
  ContactResult measure(const Surfaces&, const Surfaces&, double, const Pose&,
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
  SurfaceStage surfaces(source, timeline_of(source, TimeMode::interpolate),
                        test::patient_settings(), {}, false, surface_times);
  ASSERT_TRUE(surfaces.start());
  ContactStage::Settings settings;
  settings.wants_real_time = false;
  ContactStage contacts(std::make_unique<ContactPart>(
                            test::box_tool(), std::make_unique<SpoiltQuery>(10), ForceScale{1e6}),
                        surfaces, settings, contact_times);
  contacts.start(monotonic_now());
  const double begin = monotonic_now();
  while (!contacts.has_backend_failed() && monotonic_now() - begin < 10) {
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
