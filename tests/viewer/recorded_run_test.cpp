// Recordings in which what is looked for is far away or missing: they are read once for it.
#include "src/viewer/sources/recorded_run.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "palpate/session/run.h"
#include "src/session/internal/run_messages.h"
#include "src/viewer/sources/frame_cache.h"
#include "src/viewer/sources/mcap_index.h"
#include "tests/session/path_run.h"
#include "tests/session/recorded_messages.h"
#include "tests/session/synthetic_stream.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using test::RecordedMessage;

constexpr double kRate = 200;

/// A run of which the recording loses what `is_lost`, and has a chunk for each message.
class SparseRecording {
 public:
  template <class IsLost>
  explicit SparseRecording(const IsLost& is_lost) {
    test::SyntheticStream stream(12);
    auto device = test::path_device(test::pressing_pose, kRate);
    const auto outcome =
        record_run(test::small_tool(), stream, **device, test::path_settings(kRate), run());
    EXPECT_TRUE(outcome) << outcome.error().message;
    std::vector<RecordedMessage> all = test::messages(run());
    std::erase_if(all, is_lost);
    test::rewrite(run(), all, {.chunk_bytes = 1});
  }

  fs::path run() const { return folder_.path() / "run"; }
  /// Whoever has the file open finds no more than this in it.
  void cut(double share) const {
    const fs::path file = run() / kRecordingFile;
    fs::resize_file(file, static_cast<std::uintmax_t>(share * double(fs::file_size(file))));
  }

 private:
  test::TemporaryFolder folder_;
};

TEST(RecordedRun, IsReadOnceWhereTheQueryIsFarAway) {
  bool is_first = true;
  const SparseRecording recording([&](const RecordedMessage& message) {
    return message.channel.topic == kContactTopic && !std::exchange(is_first, false);
  });
  const auto run = open_recorded_run(recording.run());
  ASSERT_TRUE(run) << run.error().message;
  const double end = (*run)->duration();
  ASSERT_GT(end, 0.3);
  const auto query = (*run)->query_at(end);
  ASSERT_TRUE(query) << query.error().message;
  EXPECT_EQ(query->time, 0);
  recording.cut(0);
  for (const double time : {end, end / 2, end - 0.01}) {
    const auto again = (*run)->query_at(time);
    ASSERT_TRUE(again) << again.error().message;
    EXPECT_EQ(again->time, 0);
  }
}

TEST(RecordedRun, AFrameWithoutImageIsLookedForOnceAndNotFar) {
  const SparseRecording recording(
      [](const RecordedMessage& message) { return message.channel.topic == depth_topic(0); });
  const auto run = open_recorded_run(recording.run());
  ASSERT_TRUE(run) << run.error().message;
  const std::size_t num = (*run)->num_frames();
  ASSERT_EQ(num, 12u);
  FrameCache frames(**run);
  const auto last = frames.get(num - 1);
  ASSERT_FALSE(last);
  recording.cut(0.7);
  EXPECT_EQ(frames.get(num - 1).error().message, last.error().message);
  const auto second = frames.get(1);
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, Errc::bad_input) << second.error().message;
}

TEST(RecordedRun, KnowsItsFirstTouch) {
  const SparseRecording recording([](const RecordedMessage&) { return false; });
  const auto run = open_recorded_run(recording.run());
  ASSERT_TRUE(run) << run.error().message;
  const auto samples = (*run)->samples(-1, 10);
  ASSERT_TRUE(samples);
  double first = -1;
  for (const ViewSample& sample : *samples) {
    if (first < 0 && sample.volume > 0) first = sample.time;
  }
  ASSERT_GE(first, 0);
  EXPECT_EQ((*run)->first_touch(10).value(), first);
  EXPECT_EQ((*run)->first_touch(first - 0.5 / kRate).value(), std::nullopt);
}

TEST(RecordedRun, SettingsAreNotCopiedForWhoOnlyLooks) {
  const SparseRecording recording([](const RecordedMessage&) { return false; });
  const auto index = McapIndex::open(recording.run());
  ASSERT_TRUE(index) << index.error().message;
  EXPECT_EQ((*index)->settings(0), (*index)->settings(7));
}

}  // namespace
}  // namespace palpate
