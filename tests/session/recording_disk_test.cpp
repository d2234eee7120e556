// Recordings on a disk that is slow, stands still or fails: only the end of a run waits for it, and
// possible losses are reported.
#include <errno.h>
#include <gtest/gtest.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <atomic>
#include <cmath>
#include <condition_variable>
#include <filesystem>
#include <fstream>
#include <map>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>

#include "palpate/session/run.h"
#include "src/io/internal/mcap_file.h"
#include "src/session/internal/record_stream.h"
#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_reader.h"
#include "src/session/recording/run_recorder.h"
#include "tests/session/live_hand.h"
#include "tests/session/path_run.h"
#include "tests/session/synthetic_stream.h"
#include "tests/test_util/wait_for.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

/// Stand-in for the disk of this program.
class Disk {
 public:
  /// Resets the disk; the calling thread is the one that must not wait for it.
  void begin() {
    const std::lock_guard lock(mutex_);
    is_stuck_ = is_given_up_ = false;
    num_good_.clear();
    num_interruptions_ = num_by_owner_ = 0;
    owner_ = std::this_thread::get_id();
  }
  void set_stuck(bool is_stuck) {
    const std::lock_guard lock(mutex_);
    is_stuck_ = is_stuck;
    changed_.notify_all();
  }
  /// Lets `num_good` calls for the file of this name succeed, and all later ones fail.
  void break_after(const std::string& file, int num_good) {
    const std::lock_guard lock(mutex_);
    num_good_[file] = num_good;
  }
  void interrupt(int times) {
    const std::lock_guard lock(mutex_);
    num_interruptions_ = times;
  }
  /// True if a call has waited so long for a stuck disk that the test would have waited for ever.
  bool is_given_up() {
    const std::lock_guard lock(mutex_);
    return is_given_up_;
  }
  int num_by_owner() {
    const std::lock_guard lock(mutex_);
    return num_by_owner_;
  }
  /// s: of the newest tick when the last good call for a file that breaks began.
  double good_time() const { return good_time_; }

  int sync(int descriptor) {
    std::error_code ignored;
    const fs::path path = fs::read_symlink("/proc/self/fd/" + std::to_string(descriptor), ignored);
    std::unique_lock lock(mutex_);
    num_by_owner_ += std::this_thread::get_id() == owner_ ? 1 : 0;
    if (num_interruptions_ > 0) {
      --num_interruptions_;
      errno = EINTR;
      return -1;
    }
    const auto is_free = [this] { return !is_stuck_; };
    if (!changed_.wait_for(lock, std::chrono::seconds(60), is_free)) {
      is_given_up_ = true;
      is_stuck_ = false;
    }
    if (const auto breaks = num_good_.find(path.filename()); breaks != num_good_.end()) {
      if (breaks->second-- <= 0) {
        errno = EIO;
        return -1;
      }
      good_time_ = time.load();
    }
    lock.unlock();
    return static_cast<int>(syscall(SYS_fdatasync, descriptor));
  }

  std::atomic<double> time = 0;  // s, of the newest tick

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool is_stuck_ = false, is_given_up_ = false;
  std::map<std::string, int> num_good_;
  int num_interruptions_ = 0, num_by_owner_ = 0;
  std::thread::id owner_;
  std::atomic<double> good_time_ = 0;
};
/// Threads may use it until the program ends.
Disk& disk = *new Disk;

}  // namespace
}  // namespace palpate

extern "C" int fdatasync(int descriptor) { return palpate::disk.sync(descriptor); }

namespace palpate {
namespace {

using test::SyntheticStream;
using test::wait_for;

class RecordingDisk : public ::testing::Test {
 protected:
  RecordingDisk() { disk.begin(); }
  ~RecordingDisk() override { disk.set_stuck(false); }

  void make(const RecordingOptions& options) {
    RunSetup setup;
    setup.settings = test::path_settings(100);
    setup.streams = {stream_.info()};
    setup.device.rate = 100;
    auto made = RunRecorder::create(path(1), tool_, setup, false, options);
    ASSERT_TRUE(made) << made.error().message;
    recorder_.emplace(*std::move(made));
  }
  void add_frame() {
    ASSERT_TRUE(stream_.next(frame_).value());
    record_.capture_time = time_;
    recorder_->add_frame(record_, frame_);
    record_.number = ++record_.camera_frame;
  }
  /// A frame, a contact and a tick, 10 ms later than the last.
  void add_tick() {
    time_ = std::round(100 * time_ + 1) / 100;
    ASSERT_NO_FATAL_FAILURE(add_frame());
    contact_.cameras.of[0].camera_frame = static_cast<std::int64_t>(record_.camera_frame) - 1;
    contact_.contact.time = tick_.time = tick_.device.time = time_;
    tick_.contact_number = ++contact_.number;
    recorder_->add_contact(contact_);
    recorder_->add_tick(tick_);
    ++tick_.number;
    disk.time = time_;
  }
  /// Adds the ticks of a second.
  void add_second() {
    for (int i = 0; i < 100; ++i) ASSERT_NO_FATAL_FAILURE(add_tick());
  }
  /// Adds ticks until there is a note; returns the notes.
  std::vector<std::string> add_until_told() {
    std::vector<std::string> notes;
    EXPECT_TRUE(wait_for([&] {
      add_tick();
      notes = recorder_->take_notes();
      return !notes.empty();
    }));
    return notes;
  }
  fs::path path(int part) const {
    return folder_.path() / (part == 1 ? std::string(kRecordingFile) : part_file(part));
  }
  std::string name(int part) const { return path(part).filename(); }
  /// Makes the file of this part impossible to write.
  void block(int part) const {
    fs::create_directory(path(part));
    std::ofstream(path(part) / "in the way") << "x";
  }
  static bool is_whole(const fs::path& file) {
    auto reader = McapReader::open(file);
    while (reader) {
      const auto message = reader->next();
      if (!message) return false;
      if (!*message) return !reader->was_cut_off();
    }
    return false;
  }

  test::TemporaryFolder folder_;
  const Tool tool_ = test::small_tool();
  SyntheticStream stream_{100000};
  std::optional<RunRecorder> recorder_;
  DepthFrame frame_;
  FrameRecord record_;
  ContactRecord contact_;
  TickRecord tick_;
  double time_ = 0;
};

TEST_F(RecordingDisk, APartEndsAndAnotherBeginsWhileTheDiskStandsStill) {
  make({.split_bytes = 1});
  disk.set_stuck(true);
  add_second();
  EXPECT_TRUE(fs::exists(path(2)));
  // One after the other: where a disk is so slow, a part is longer.
  add_second();
  EXPECT_FALSE(fs::exists(path(3)));
  EXPECT_TRUE(recorder_->waits_for_disk());
  disk.set_stuck(false);
  ASSERT_TRUE(wait_for([this] { return !recorder_->waits_for_disk(); }));
  add_second();
  EXPECT_TRUE(fs::exists(path(3)));
  recorder_->finish();
  EXPECT_FALSE(disk.is_given_up());
  EXPECT_EQ(recorder_->trouble(), "");
  for (const int part : {1, 2, 3}) EXPECT_TRUE(is_whole(path(part))) << part;
}

TEST_F(RecordingDisk, APauseBeginsWhileTheDiskStandsStill) {
  make({.reserve_bytes = 1e18});
  disk.set_stuck(true);
  add_second();  // there is no room for more
  ASSERT_EQ(recorder_->take_notes().size(), 1u);
  EXPECT_TRUE(recorder_->waits_for_disk());
  EXPECT_FALSE(disk.is_given_up());
  EXPECT_TRUE(is_whole(path(1)));
}

TEST_F(RecordingDisk, WhatFailsToReachItIsInDoubtFromTheLastTimeOnThatDidNot) {
  make({.keep_seconds = 1000});  // parts of 100 s
  add_second();
  time_ = 100;
  add_second();
  ASSERT_TRUE(fs::exists(path(2)));
  disk.break_after(name(2), 2);
  const std::vector<std::string> notes = add_until_told();
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_NE(notes[0].find("the recording pauses: cannot bring"), std::string::npos) << notes[0];
  const double paused = time_;
  add_second();
  add_second();
  recorder_->finish();
  double from = 0, to = 0;
  ASSERT_EQ(
      std::sscanf(recorder_->trouble().c_str(),
                  "it is not certain that anything was recorded from %lf s to %lf s", &from, &to),
      2)
      << recorder_->trouble();
  EXPECT_GT(from, 100);
  EXPECT_LE(from, disk.good_time() + 0.015);  // one tick may have been on its way
  EXPECT_LT(from, paused);
  EXPECT_GT(to, paused);
}

TEST_F(RecordingDisk, WhatFailsToReachItAfterItsPartHasEndedIsTold) {
  for (const bool is_paused : {false, true}) {
    SCOPED_TRACE(is_paused);
    disk.break_after(name(1), 0);
    disk.set_stuck(true);  // so that nothing is known before
    make({.split_bytes = 1, .reserve_bytes = is_paused ? 1e18 : 0});
    add_second();
    EXPECT_EQ(fs::exists(path(2)), !is_paused);
    disk.set_stuck(false);
    recorder_->finish();
    EXPECT_EQ(recorder_->trouble().find("nothing was recorded from 0.99 s on: only "),
              is_paused ? 0u : std::string::npos)
        << recorder_->trouble();
    EXPECT_NE(recorder_->trouble().find("it is not certain that anything was recorded from 0.00 s "
                                        "to 0.99 s: cannot bring "),
              std::string::npos)
        << recorder_->trouble();
    EXPECT_FALSE(disk.is_given_up());
    recorder_.reset();
    fs::remove(path(2));
    time_ = 0;
  }
}

TEST_F(RecordingDisk, TheLastOfAFileIsBroughtToItByAThreadThatNobodyInterrupts) {
  auto writer = McapWriter::create(path(1));
  ASSERT_TRUE(writer);
  const auto channel = writer->add_channel({"/a", "palpate.A", "string text\n"});
  ASSERT_TRUE(writer->write(channel, 1, "abcd"));
  disk.interrupt(3);
  const Status finished = writer->finish();
  EXPECT_TRUE(finished) << finished.error().message;
  EXPECT_EQ(disk.num_by_owner(), 0);
  EXPECT_TRUE(is_whole(path(1)));
}

TEST_F(RecordingDisk, TheEndOfARunThatWaitsForItSaysSo) {
  disk.set_stuck(true);
  SyntheticStream stream(5);
  auto device = test::path_device(test::pressing_pose, 100);
  RunOptions options;
  bool is_told = false;
  options.say = [&](double, std::string_view text) {
    if (text != "waits until the disk has the recording") return;
    is_told = true;
    disk.set_stuck(false);
  };
  const auto outcome = record_run(tool_, stream, **device, test::path_settings(100),
                                  folder_.path() / "run", options);
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_TRUE(is_told);
  EXPECT_EQ(outcome->not_kept, "");
  EXPECT_FALSE(disk.is_given_up());
}

TEST_F(RecordingDisk, OldPartsGoDuringAPauseToo) {
  make({.keep_seconds = 200});  // parts of 20 s
  for (int i = 0; i < 3; ++i) {
    time_ = 20 * i;
    add_second();
    ASSERT_TRUE(wait_for([&] { return !recorder_->waits_for_disk(); }));
  }
  ASSERT_TRUE(fs::exists(path(3)));
  block(4);
  disk.break_after(name(3), 0);
  ASSERT_EQ(add_until_told().size(), 1u);
  ASSERT_TRUE(fs::exists(path(1)));
  for (int i = 0; i < 30; ++i) {
    time_ += 10;
    add_tick();
  }
  EXPECT_FALSE(fs::exists(path(1)));
  EXPECT_FALSE(fs::exists(path(2)));
  EXPECT_TRUE(fs::exists(path(3)));
}

TEST_F(RecordingDisk, APartThatCannotBeginIsToldOnceAndTheOneThereIsGoesOn) {
  make({.split_bytes = 1});
  block(2);
  for (int i = 0; i < 3; ++i) add_second();
  const auto notes = recorder_->take_notes();
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_EQ(notes[0].find("the recording goes on in recording.mcap, because no other part can be "
                          "begun: cannot make " +
                          path(2).string()),
            0u)
      << notes[0];
  recorder_->finish();
  EXPECT_EQ(recorder_->trouble(), "");
  auto reader = RunReader::open(path(1));
  ASSERT_TRUE(reader) << reader.error().message;
  TickRecord tick;
  int num_ticks = 0;
  while (reader->next_tick(tick).value()) ++num_ticks;
  EXPECT_EQ(num_ticks, 300);
}

class RecordingStreamDisk : public RecordingDisk {
 protected:
  RecordingStreamDisk() { partial_ += ".partial"; }
  int num_images() const {
    auto reader = McapReader::open(partial_);
    int num = 0;
    while (reader) {
      const auto message = reader->next();
      if (!message || !*message) break;
      num += reader->channels().at((*message)->channel).schema_name == "sensor_msgs/msg/Image";
    }
    return num;
  }
  void expect_kept(SyntheticStream stream, int num_frames) {
    expect_kept(DepthSources(stream), num_frames);
  }
  void expect_kept(const DepthSources& sources, int num_frames) {
    const auto done = record_stream(sources, path(1));
    ASSERT_FALSE(done);
    EXPECT_NE(done.error().message.find("; what was recorded before is in " + partial_.string() +
                                        ": rename it to keep it"),
              std::string::npos)
        << done.error().message;
    EXPECT_FALSE(fs::exists(path(1)));
    EXPECT_EQ(num_images(), num_frames);
  }

  fs::path partial_ = path(1);
};

TEST_F(RecordingStreamDisk, KeepsWhatItHasOfAStreamWhenTheDiskFailsAtTheEnd) {
  disk.break_after(partial_.filename(), 0);
  expect_kept(SyntheticStream(5), 5);
}

TEST_F(RecordingStreamDisk, KeepsWhatOtherCamerasHaveSentWhereOneHasSentNothing) {
  SyntheticStream stream(5), silent(0);
  expect_kept(DepthSources({&stream, &silent}), 5);
}

TEST_F(RecordingStreamDisk, KeepsWhatItHasOfAStreamThatFailsLater) {
  SyntheticStream stream(5);
  stream.fail_at = 3;
  expect_kept(stream, 3);
  // A stream that fails at once leaves no file.
  SyntheticStream none(5);
  none.fail_at = 0;
  ASSERT_FALSE(record_stream(none, path(1)));
  EXPECT_FALSE(fs::exists(partial_));
}

// Also where a run is at its end already.
TEST(RecordingEnd, WhatFailsInTheLastRecordsIsAFailureOfTheRun) {
  disk.begin();
  const test::TemporaryFolder folder;
  RunMonitor monitor;
  bool has_thrown = false, has_ticked = false;
  monitor.observer.on_ticks = [&](std::span<const TickRecord> ticks) {
    has_ticked = true;
    // It fades: whoever ends the run has looked at its state before.
    if (!ticks.back().is_stopping || has_thrown) return;
    has_thrown = true;
    throw std::runtime_error("thrown by a test");
  };
  RunOptions options;
  options.monitor = &monitor;
  std::atomic<bool> is_over = false;
  monitor.on_loop = [&](RunLoop* loop) { is_over = loop == nullptr; };
  std::atomic<int> num_asked = 0;
  options.keep_going = [&] { return ++num_asked < 10; };
  SyntheticStream stream(100000);
  const auto device = test::pressing_device();
  const auto outcome = record_run(test::small_tool(), stream, *device, test::patient_settings(),
                                  folder.path() / "run", options);
  ASSERT_TRUE(outcome) << outcome.error().message;
  ASSERT_TRUE(has_ticked && has_thrown && is_over);
  EXPECT_NE(outcome->failure.find("thrown by a test"), std::string::npos) << outcome->failure;
}

}  // namespace
}  // namespace palpate
