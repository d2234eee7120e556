#include "src/run/internal/run_inputs.h"

#include <atomic>
#include <chrono>
#include <thread>

#include <gtest/gtest.h>

#include "tests/run/loop_fakes.h"
#include "tests/test_util/own_nice.h"

namespace palpate {
namespace {

using test::WallSource;

/// A wall that counts how often it was called, and makes no frame before the test lets it.
class GuardedWall final : public DepthSource {
 public:
  GuardedWall(const WallSource::Options& options, std::atomic<int>& num_requested,
              const std::atomic<int>& num_allowed)
      : wall_(options), num_requested_(num_requested), num_allowed_(num_allowed) {}
  const DepthStreamInfo& info() const override { return wall_.info(); }
  Result<bool> next(DepthFrame& frame) override {
    nice = test::own_nice();
    const int number = num_requested_++;
    for (int num = num_allowed_; num <= number; num = num_allowed_) num_allowed_.wait(num);
    return wall_.next(frame);
  }

  static inline std::atomic<int> nice = 0;  ///< of the thread that asked last

 private:
  WallSource wall_;
  std::atomic<int>& num_requested_;
  const std::atomic<int>& num_allowed_;
};

TEST(ReadAhead, GivesTheSameFramesAndTheEnd) {
  WallSource::Options options;
  options.num_frames = 20;
  options.depth = [](int frame) { return 0.5 + 0.001 * frame; };
  WallSource plain(options);
  const auto ahead = read_ahead(std::make_unique<WallSource>(options), 3).value();
  EXPECT_EQ(ahead->info().name, plain.info().name);
  DepthFrame want, got;
  for (int k = 0; k < 20; ++k) {
    ASSERT_TRUE(plain.next(want).value());
    ASSERT_TRUE(ahead->next(got).value());
    EXPECT_EQ(got.pixels, want.pixels);
    EXPECT_EQ(got.timestamp, want.timestamp);
  }
  EXPECT_FALSE(ahead->next(got).value());
  EXPECT_FALSE(ahead->next(got).value());
}

TEST(ReadAhead, ASourceThatNeverReturnsIsCancelled) {
  const auto ahead = read_ahead(std::make_unique<test::SilentSource>()).value();
  DepthFrame frame;
  ASSERT_TRUE(ahead->next(frame).value());
  std::thread other([&] { ahead->cancel(); });
  EXPECT_FALSE(ahead->next(frame).value());
  other.join();
}

TEST(ReadAhead, TellsAnErrorAfterTheFramesBeforeIt) {
  WallSource::Options options;
  options.fails_at = 5;
  const auto ahead = read_ahead(std::make_unique<WallSource>(options)).value();
  DepthFrame frame;
  for (int k = 0; k < 5; ++k) ASSERT_TRUE(ahead->next(frame));
  const auto failed = ahead->next(frame);
  ASSERT_FALSE(failed);
  EXPECT_EQ(failed.error().message, "the wall fell over");
}

// Frames that are there do not wait for the one that is being made.
TEST(ReadAhead, IsAheadButNotByMoreThanWanted) {
  std::atomic<int> num_requested{0}, num_allowed{2};
  const auto ahead =
      read_ahead(std::make_unique<GuardedWall>(WallSource::Options{}, num_requested, num_allowed),
                 4)
          .value();
  DepthFrame frame;
  ASSERT_TRUE(ahead->next(frame).value());
  ASSERT_TRUE(ahead->next(frame).value());
  num_allowed = 1000;
  num_allowed.notify_all();
  while (num_requested < 2 + 4 + 1) std::this_thread::yield();  // four wait, one more is at hand
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  EXPECT_EQ(num_requested, 2 + 4 + 1);
  ASSERT_TRUE(ahead->next(frame).value());
  while (num_requested < 2 + 4 + 2) std::this_thread::yield();
  // Whoever needs the frames comes first.
  const int usual = test::own_nice();
  EXPECT_TRUE(GuardedWall::nice > usual || usual == 19) << GuardedWall::nice;
}  // and ends while all places are taken

}  // namespace
}  // namespace palpate
