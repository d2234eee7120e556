// Cameras that come and go, stall, change their mind and block for ever.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <thread>

#include "palpate/cameras/cameras.h"
#include "src/cameras/stream/camera_source.h"
#include "src/core/internal/bounded_call.h"
#include "src/core/internal/monotonic_clock.h"
#include "tests/cameras/conformance.h"
#include "tests/cameras/small_camera.h"
#include "tests/test_util/wait_for.h"

namespace palpate {
namespace {

using test::has;
using test::joined;
using test::kHeight;
using test::kWidth;
using test::ScriptedCamera;
using test::stream_info;

std::unique_ptr<DepthSource> live(ScriptedCamera::Script script, OpenRaw again = {},
                                  const char* uri = "test", StampClock stamps = StampClock::none) {
  const CameraUri said = parse_camera_uri(uri).value();
  DepthStreamInfo info = stream_info(kWidth, kHeight);
  info.rate = said.rate.value_or(info.rate);
  RawStream raw{std::make_unique<ScriptedCamera>(info, std::move(script)), stamps};
  return make_live(std::move(raw), std::move(again), said).value();
}

/// Gives a frame after ten milliseconds.
Result<bool> give(DepthFrame& frame, int number, double stamp) {
  test::sleep_seconds(0.01);
  frame = test::pattern_frame(kWidth, kHeight, number, stamp);
  return true;
}

/// Waits until cancelled, as a good driver does.
Result<bool> wait(const std::atomic<bool>& is_cancelled) {
  while (!is_cancelled) test::sleep_seconds(0.005);
  return false;
}

TEST(LiveCamera, GivesFramesAsTheyComeWithTheTimeOfTheirArrival) {
  const auto camera = live([](int number, DepthFrame& frame, DepthStreamInfo&, const auto&) {
    return give(frame, number, 77);
  });
  EXPECT_TRUE(camera->info().is_live);
  DepthFrame frame;
  double last = monotonic_now() - 1;
  int last_number = -1;
  for (int k = 0; k < 20; ++k) {
    ASSERT_TRUE(*camera->next(frame));
    const int number = test::number_of(frame, 4000);
    EXPECT_GT(number, last_number);
    EXPECT_GT(frame.timestamp, last);
    EXPECT_LE(frame.timestamp, monotonic_now());
    last = frame.timestamp;
    last_number = number;
  }
}

TEST(LiveCamera, TheNewestFrameWins) {
  std::atomic<int> num_given = 0;
  const auto camera = live([&](int number, DepthFrame& frame, DepthStreamInfo&,
                               const auto& is_cancelled) -> Result<bool> {
    num_given = number;  // all before it have been taken over
    if (number == 10) return wait(is_cancelled);
    frame = test::pattern_frame(kWidth, kHeight, number, number);
    return true;
  });
  while (num_given < 10) test::sleep_seconds(0.001);
  DepthFrame frame;
  ASSERT_TRUE(*camera->next(frame));
  EXPECT_EQ(test::number_of(frame, 20), 9);
  camera->cancel();
  EXPECT_TRUE(has(joined(camera->take_notes()), "9 were dropped for newer ones"));
}

TEST(LiveCamera, ComesBackAfterItWasUnplugged) {
  std::atomic<int> num_opened = 0;
  const auto script = [&](int number, DepthFrame& frame, DepthStreamInfo&,
                          const auto&) -> Result<bool> {
    if (number == 5 && num_opened < 3) return Error{Errc::unavailable, "the cable is out"};
    return give(frame, number, 0);
  };
  const OpenRaw again = [&]() -> Result<RawStream> {
    if (++num_opened < 3) return Error{Errc::not_found, "no camera"};
    return RawStream{std::make_unique<ScriptedCamera>(stream_info(kWidth, kHeight), script),
                     StampClock::none};
  };
  const auto camera = live(script, again);
  DepthFrame frame;
  double last = 0;
  for (int k = 0; k < 20; ++k) {
    ASSERT_TRUE(*camera->next(frame));
    EXPECT_GT(frame.timestamp, last);
    last = frame.timestamp;
  }
  EXPECT_EQ(num_opened, 3);
  const std::string notes = joined(camera->take_notes());
  EXPECT_TRUE(has(notes, "was lost: the cable is out")) << notes;
  EXPECT_TRUE(has(notes, "is back after")) << notes;
}

// It opens again and again, and sends nothing: nobody is told that it is back.
TEST(LiveCamera, IsBackWithItsFirstFrame) {
  std::atomic<int> num_opened = 0;
  const auto script = [&](int number, DepthFrame& frame, DepthStreamInfo&,
                          const auto&) -> Result<bool> {
    const bool sends_nothing = num_opened > 0 && num_opened < 4;
    const bool is_lost = num_opened == 0 && number == 5;
    if (sends_nothing || is_lost) return Error{Errc::unavailable, "it sends no frames"};
    return give(frame, number, 0);
  };
  const OpenRaw again = [&]() -> Result<RawStream> {
    ++num_opened;
    return RawStream{std::make_unique<ScriptedCamera>(stream_info(kWidth, kHeight), script),
                     StampClock::none};
  };
  const auto camera = live(script, again);
  DepthFrame frame;
  std::string notes;
  while (num_opened < 4) {
    ASSERT_TRUE(*camera->next(frame));
    notes += joined(camera->take_notes());
  }
  notes += joined(camera->take_notes());
  const auto count = [&](const std::string& what) {
    int num = 0;
    for (auto at = notes.find(what); at != std::string::npos; at = notes.find(what, at + 1)) ++num;
    return num;
  };
  EXPECT_EQ(count("was lost: it sends no frames"), 1) << notes;
  EXPECT_EQ(count("is back after"), 1) << notes;
}

TEST(LiveCamera, WithoutASecondChanceTheErrorIsTold) {
  const auto camera =
      live([](int number, DepthFrame& frame, DepthStreamInfo&, const auto&) -> Result<bool> {
        if (number == 3) return Error{Errc::io_failure, "gone for good"};
        return give(frame, number, 0);
      });
  DepthFrame frame;
  Result<bool> got = true;
  while (got && *got) got = camera->next(frame);
  ASSERT_FALSE(got);
  EXPECT_EQ(got.error().message, "gone for good");
}

TEST(LiveCamera, ACancelledNextReturnsAtOnce) {
  const auto camera =
      live([](int, DepthFrame&, DepthStreamInfo&, const auto& is_cancelled) -> Result<bool> {
        return wait(is_cancelled);
      });
  std::thread other([&] {
    test::sleep_seconds(0.1);
    camera->cancel();
  });
  DepthFrame frame;
  EXPECT_FALSE(*camera->next(frame));
  EXPECT_FALSE(*camera->next(frame));
  other.join();
}

TEST(LiveCamera, ACallThatNeverReturnsHoldsUpNobody) {
  static std::atomic<bool> is_over = false, has_left = false;
  {
    const auto camera = live([](int, DepthFrame&, DepthStreamInfo&, const auto&) -> Result<bool> {
      while (!is_over) test::sleep_seconds(0.01);  // deaf to cancel
      has_left = true;
      return false;
    });
    DepthFrame frame;
    std::thread other([&] { camera->cancel(); });
    EXPECT_FALSE(*camera->next(frame));
    other.join();
  }
  EXPECT_FALSE(has_left);
  is_over = true;
  while (!has_left) test::sleep_seconds(0.01);
}

/// Its driver does not return from closing it until it is let go.
class UnclosableCamera final : public DepthSource {
 public:
  struct Gate {
    std::atomic<bool> is_open = false;
    std::atomic<int> num_waiting = 0;
  };
  UnclosableCamera(std::shared_ptr<Gate> gate, ScriptedCamera::Script script)
      : gate_(std::move(gate)), camera_(stream_info(kWidth, kHeight), std::move(script)) {}
  ~UnclosableCamera() override {
    ++gate_->num_waiting;
    while (!gate_->is_open) test::sleep_seconds(0.001);
    --gate_->num_waiting;
  }
  const DepthStreamInfo& info() const override { return camera_.info(); }
  Result<bool> next(DepthFrame& frame) override { return camera_.next(frame); }
  void cancel() noexcept override { camera_.cancel(); }

 private:
  const std::shared_ptr<Gate> gate_;
  ScriptedCamera camera_;
};

// When its cable is pulled, and at the end of a run: the thread that records asks every camera for
// notes, the end of the run cancels it, and the end of the program must not wait for it.
TEST(LiveCamera, OneThatDoesNotCloseHoldsUpNobody) {
  for (const bool is_unplugged : {true, false}) {
    const auto gate = std::make_shared<UnclosableCamera::Gate>();
    auto raw =
        std::make_unique<UnclosableCamera>(gate,
                                           [=](int number, DepthFrame& frame, DepthStreamInfo&,
                                               const auto& is_cancelled) -> Result<bool> {
                                             if (number < 3) return give(frame, number, 0);
                                             if (is_unplugged)
                                               return Error{Errc::unavailable, "the cable is out"};
                                             return wait(is_cancelled);
                                           });
    const OpenRaw again = []() -> Result<RawStream> { return Error{Errc::not_found, "no camera"}; };
    auto camera =
        make_live({std::move(raw), StampClock::none}, again, parse_camera_uri("test").value())
            .value();
    DepthFrame frame;
    ASSERT_TRUE(*camera->next(frame));
    if (!is_unplugged) camera->cancel();
    EXPECT_TRUE(test::wait_for([&] { return gate->num_waiting == 1; }));
    const bool has_ended = returns_within(60, [&] {
      camera->take_notes();
      camera->cancel();
      while (*camera->next(frame)) {
      }
      camera.reset();
    });
    EXPECT_TRUE(has_ended) << (is_unplugged ? "unplugged" : "at the end");
    EXPECT_EQ(gate->num_waiting, 1);
    EXPECT_TRUE(is_any_call_hung());  // so the program does not wait for it
    gate->is_open = true;
    EXPECT_TRUE(test::wait_for([&] { return !is_any_call_hung() && gate->num_waiting == 0; }));
  }
}

TEST(LiveCamera, AnotherSizeAndUnitAreFollowed) {
  const auto camera =
      live([](int number, DepthFrame& frame, DepthStreamInfo& info, const auto&) -> Result<bool> {
        if (number < 5) return give(frame, number, 0);
        test::sleep_seconds(0.01);
        info = stream_info(kWidth / 2, kHeight / 2);
        info.is_live = true;
        frame = test::pattern_frame(kWidth / 2, kHeight / 2, number, 0, 0.0001);
        return true;
      });
  DepthFrame frame;
  do {
    ASSERT_TRUE(*camera->next(frame));
    EXPECT_EQ(frame.width, kWidth);
    EXPECT_EQ(frame.pixels.size(), std::size_t{kWidth * kHeight});
  } while (frame.unit == 0.001);
  EXPECT_EQ(frame.unit, 0.0001);
  const std::string notes = joined(camera->take_notes());
  EXPECT_TRUE(has(notes, "from 32 x 24 to 16 x 12 pixels")) << notes;
  EXPECT_TRUE(has(notes, "from 0.001 to 0.0001 m")) << notes;
  // Each pixel of the old view shows the nearest one of the new.
  const int number = [&] {
    for (int k = 5; k < 4000; ++k) {
      if (frame.pixels[0] == test::count_at(0, 0, k) &&
          frame.pixels[31] == test::count_at(15, 0, k))
        return k;
    }
    return -1;
  }();
  ASSERT_GE(number, 5);
  EXPECT_EQ(frame.pixels[17], test::count_at(8, 0, number));
}

TEST(LiveCamera, FramesOfALensOfZerosAreLeftOut) {
  const auto camera = live([](int number, DepthFrame& frame, DepthStreamInfo& info, const auto&) {
    info.intrinsics = stream_info(kWidth, kHeight).intrinsics;
    if (number % 3 == 1) info.intrinsics = {};
    if (number % 3 == 2) info.intrinsics.cx = std::numeric_limits<double>::quiet_NaN();
    return give(frame, number, 0);
  });
  DepthFrame frame;
  for (int k = 0; k < 5; ++k) {
    ASSERT_TRUE(*camera->next(frame));
    EXPECT_EQ(test::number_of(frame, 4000) % 3, 0);
  }
  const std::string notes = joined(camera->take_notes());
  EXPECT_TRUE(has(notes, "without positive, finite intrinsics; they are dropped")) << notes;
  EXPECT_FALSE(has(notes, "has changed its intrinsics")) << notes;
}

TEST(LiveCamera, BlackFramesAndFramesFromThePastAreLeftOut) {
  const auto camera = live(
      [](int number, DepthFrame& frame, DepthStreamInfo&, const auto&) -> Result<bool> {
        const bool is_late = number % 7 == 3, is_black = number % 7 == 5;
        const auto got = give(frame, number, (number - (is_late ? 2.5 : 0)) / 100.0);
        // The sensor has a code of its own for what it has not measured.
        if (is_black) frame.pixels.assign(frame.pixels.size(), number % 2 == 0 ? 0 : 65535);
        return got;
      },
      {}, "test?rate=100&sensor=structured_light", StampClock::cameras);
  DepthFrame frame;
  for (int k = 0; k < 30; ++k) {
    ASSERT_TRUE(*camera->next(frame));
    const int number = test::number_of(frame, 4000);
    ASSERT_GE(number, 0);
    EXPECT_NE(number % 7, 3);
    EXPECT_NE(number % 7, 5);
  }
  camera->cancel();
  const std::string notes = joined(camera->take_notes());
  EXPECT_TRUE(has(notes, "frames with old timestamps")) << notes;
  EXPECT_TRUE(has(notes, "had no measurement")) << notes;
}

TEST(LiveCamera, FramesInWhichAllIsFarAreMeasurements) {
  const auto camera = live(
      [](int number, DepthFrame& frame, DepthStreamInfo&, const auto&) -> Result<bool> {
        const auto got = give(frame, number, number / 100.0);
        frame.pixels.assign(frame.pixels.size(), kFarCount);
        return got;
      },
      {}, "test?rate=100", StampClock::cameras);
  DepthFrame frame;
  ASSERT_TRUE(*camera->next(frame));
  EXPECT_EQ(frame.pixels, std::vector<std::uint16_t>(frame.pixels.size(), kFarCount));
}

TEST(LiveCamera, CountsWhatIsMissingAndDeclaresLatency) {
  const double begin = monotonic_now();
  const auto camera = live(
      [&](int number, DepthFrame& frame, DepthStreamInfo&,
          const auto& is_cancelled) -> Result<bool> {
        if (number == 20) return wait(is_cancelled);
        // Every second frame does not come.
        return give(frame, number, 1e6 + 2 * number / 100.0);
      },
      {}, "test?rate=100&latency=0.5", StampClock::cameras);
  DepthFrame frame;
  int num = 0;
  while (num < 1000 && test::number_of(frame, 20) != 19) {
    ASSERT_TRUE(*camera->next(frame));
    ++num;
  }
  EXPECT_LE(frame.timestamp, monotonic_now() - 0.5);
  EXPECT_GT(frame.timestamp, begin - 0.5);
  camera->cancel();
  const std::string notes = joined(camera->take_notes());
  EXPECT_TRUE(has(notes, "has sent 20 frames; 19 are missing")) << notes;
  EXPECT_TRUE(has(notes, "ppm")) << notes;
}

TEST(PushedSource, TheNewestOfManyPushersWinsAndNobodyWaits) {
  const auto camera = PushedSource::create(stream_info(kWidth, kHeight)).value();
  std::atomic<bool> is_over = false;
  std::atomic<int> num_pushed = 0;
  const auto push = [&](int first) {
    DepthFrame frame;
    for (int k = first; !is_over; k += 2) {
      frame.width = kWidth;
      frame.height = kHeight;
      frame.unit = 0.001;
      frame.pixels = test::pattern(kWidth, kHeight, k);
      camera->push(frame);
      ++num_pushed;
      test::sleep_seconds(0.002);
    }
  };
  std::thread even(push, 0), odd(push, 1);
  DepthFrame frame;
  double last = 0;
  for (int k = 0; k < 50; ++k) {
    ASSERT_TRUE(*camera->next(frame));
    EXPECT_GE(test::number_of(frame, 100000), 0);
    EXPECT_GT(frame.timestamp, last);
    last = frame.timestamp;
  }
  // Nobody takes frames any more, and pushing goes on.
  const int before = num_pushed;
  while (num_pushed < before + 20) test::sleep_seconds(0.001);
  is_over = true;
  even.join();
  odd.join();
  camera->end();
  while (*camera->next(frame)) {
  }
}

TEST(PushedSource, TenThousandFramesTakeNoMemory) {
  const auto camera = PushedSource::create(stream_info(kWidth, kHeight)).value();
  std::atomic<bool> is_over = false;
  std::thread pusher([&] {
    DepthFrame frame;
    for (int k = 0; !is_over; ++k) {
      frame.width = kWidth;
      frame.height = kHeight;
      frame.pixels = test::pattern(kWidth, kHeight, k);
      camera->push(frame);
    }
  });
  test::expect_no_growth(*camera, 10000);
  is_over = true;
  pusher.join();
}

TEST(PushedSource, RemovesDistortionAndRefusesWhatDoesNotFit) {
  DepthStreamInfo info = stream_info(kWidth, kHeight);
  info.distortion.k1 = 0.3;
  const auto camera = PushedSource::create(info).value();
  EXPECT_EQ(camera->info().distortion, Distortion{});
  DepthFrame odd = test::pattern_frame(kWidth, kHeight, 0, 0);
  odd.pixels.pop_back();
  camera->push(odd);
  DepthFrame whole = test::pattern_frame(kWidth, kHeight, 1, 0);
  camera->push(whole);
  DepthFrame frame;
  ASSERT_TRUE(*camera->next(frame));
  EXPECT_EQ(frame.pixels.size(), std::size_t{kWidth * kHeight});
  EXPECT_EQ(frame.pixels[0], 0);  // a corner that the lens does not show
  EXPECT_EQ(frame.pixels[12 * kWidth + 16], test::count_at(16, 12, 1));
  EXPECT_TRUE(has(joined(camera->take_notes()), "does not match its size"));
  EXPECT_FALSE(PushedSource::create(stream_info(2, 2)));
  for (const double latency : {-0.01, 33.0, std::nan("")}) {
    PushedSource::Options options;
    options.latency = latency;
    EXPECT_FALSE(PushedSource::create(stream_info(kWidth, kHeight), options)) << latency;
  }
}

}  // namespace
}  // namespace palpate
