#include "src/session/internal/record_stream.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <string_view>
#include <system_error>
#include <thread>
#include <utility>

#include "src/core/internal/guarded.h"
#include "src/io/internal/cdr.h"
#include "src/io/internal/mcap_file.h"
#include "src/io/internal/ros_messages.h"
#include "src/session/internal/run_messages.h"
#include "src/session/recording/run_recorder.h"

namespace palpate { inline namespace v0 {
namespace {

std::string text_message(std::string_view text) {
  CdrWriter to;
  to.text(text);
  return to.take();
}

std::string unit_message(double unit) {
  CdrWriter to;
  to.number(unit);
  return to.take();
}

/// Returns the offset from the monotonic clock to 1970, s: for the time stamps of a live stream.
double since_1970() {
  using std::chrono::duration;
  return duration<double>(std::chrono::system_clock::now().time_since_epoch()).count() -
         duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

class StreamFile {
 public:
  static Result<StreamFile> create(const std::filesystem::path& path, const DepthSources& sources) {
    auto writer = McapWriter::create(path);
    if (!writer) return writer.error();
    return StreamFile(*std::move(writer), sources.infos());
  }

  Status add(std::size_t number, const DepthFrame& frame) {
    Camera& camera = cameras_[number];
    const double seconds = frame.timestamp + camera.offset;
    const auto time = static_cast<std::uint64_t>(1e9 * (seconds > 0 ? seconds : 0));
    const RosHeader header{time, camera.name};
    if (frame.unit != camera.unit) {
      camera.unit = frame.unit;
      const std::string message = unit_message(camera.unit);
      if (const Status status = writer_.write(camera.units, time, message); !status) return status;
    }
    if (camera.is_first || camera.info.is_moving) {
      const RosTransform pose[] = {{"world", camera.name, frame.X_WC}};
      const auto channel = camera.info.is_moving ? transforms_ : statics_;
      const std::string message = transform_message(time, pose);
      if (const Status status = writer_.write(channel, time, message); !status) return status;
    }
    if (std::exchange(camera.is_first, false)) {
      const std::string message = text_message(name_of(camera.info.sensor));
      if (const Status status = writer_.write(camera.sensors, time, message); !status)
        return status;
    }
    const std::string info = camera_info_message(header, camera.info);
    if (const Status status = writer_.write(camera.infos, time, info); !status) return status;
    return writer_.write(camera.images, time, image_message(header, frame));
  }
  Status finish() { return writer_.finish(); }
  std::uint64_t num_bytes() const { return writer_.bytes_written(); }
  /// True if the file holds anything that was added.
  bool is_begun() const { return num_bytes() > num_first_bytes_; }

 private:
  struct Camera {
    DepthStreamInfo info;
    std::string name;
    double offset = 0, unit = 0;
    std::uint16_t images = 0, infos = 0, units = 0, sensors = 0;
    bool is_first = true;
  };

  StreamFile(McapWriter writer, std::vector<DepthStreamInfo> streams) : writer_(std::move(writer)) {
    const double now = since_1970();
    for (DepthStreamInfo& info : streams) {
      Camera& camera = cameras_.emplace_back();
      camera.name = camera_frame(cameras_.size() - 1);
      camera.offset = info.is_live ? now : 0;
      camera.info = std::move(info);
      const std::string depth = "/" + camera.name + "/depth/";
      camera.images =
          writer_.add_channel(ros_channel(depth + "image_rect_raw", "sensor_msgs/Image"));
      camera.infos =
          writer_.add_channel(ros_channel(depth + "camera_info", "sensor_msgs/CameraInfo"));
      camera.units = writer_.add_channel(
          {depth + "unit", "palpate_msgs/msg/DepthUnit", "float64 meters_per_count\n"});
      camera.sensors =
          writer_.add_channel({depth + "sensor", "std_msgs/msg/String", "string data\n"});
    }
    statics_ = writer_.add_channel(ros_channel("/tf_static", "tf2_msgs/TFMessage"));
    transforms_ = writer_.add_channel(ros_channel("/tf", "tf2_msgs/TFMessage"));
  }

  McapWriter writer_;
  const std::uint64_t num_first_bytes_ = writer_.bytes_written();
  std::vector<Camera> cameras_;
  std::uint16_t statics_ = 0, transforms_ = 0;
};

/// Copies streams, with a thread for each camera, as live ones may wait; one writes at a time.
class Copy {
 public:
  Copy(const DepthSources& sources, const RecordStreamOptions& options, StreamFile& file,
       StreamRecording& done)
      : sources_(sources), options_(options), file_(file), done_(done), turns_(sources.size()) {
    done_.frames_of.resize(sources.size());
    for (std::size_t i = 0; i < turns_.size(); ++i) turns_[i].is_live = sources[i].info().is_live;
  }

  Status run() {
    std::vector<std::thread> others;
    try {
      for (std::size_t i = 1; i < turns_.size(); ++i) others.emplace_back([this, i] { work(i); });
      work(0);
    } catch (const std::system_error& error) {
      const std::lock_guard lock(mutex_);
      end_all(Error{Errc::unavailable, std::string("cannot start the thread that reads frames: ") +
                                           error.what() + "; end other programs and try again"});
    }
    for (std::thread& other : others) other.join();
    return status_;
  }

 private:
  struct Turn {
    bool is_live = false, has_ended = false, has_frame = false;
    double time = 0;  // s, of that frame
  };

  void work(std::size_t camera) {
    guarded([&] { read(camera); },
            [&](const Error& error) {
              const std::lock_guard lock(mutex_);
              turns_[camera].has_ended = true;
              end_all(error);
            });
  }
  void read(std::size_t camera) {
    DepthFrame frame;
    double first = 0;
    for (bool is_first = true;; is_first = false) {
      const auto got = sources_[camera].next(frame);
      std::unique_lock lock(mutex_);
      Turn& turn = turns_[camera];
      turn.has_frame = got && *got;
      turn.time = frame.timestamp;
      if (is_first) first = frame.timestamp;
      changed_.notify_all();
      changed_.wait(lock, [&] { return has_ended_ || !turn.has_frame || is_next(camera); });
      const double seconds = frame.timestamp - first;
      if (!got && !has_ended_) end_all(got.error());
      const bool is_over = has_ended_ || !turn.has_frame || seconds > options_.duration;
      if (is_over) {
        turn.has_ended = true;
        if (turn.is_live && !has_ended_ && turn.has_frame) end_live();
      } else if (options_.keep_going && !options_.keep_going(done_.seconds, done_.num_frames)) {
        end_all(Done{});
      } else if (const Status written = file_.add(camera, frame); !written) {
        end_all(written.error());
      } else {
        ++done_.num_frames;
        ++done_.frames_of[camera];
        done_.seconds = std::max(done_.seconds, seconds);
      }
      turn.has_frame = false;
      changed_.notify_all();
      if (is_over || has_ended_) return;
    }
  }
  /// True if this camera may write: recorded ones write in the order of their time stamps.
  bool is_next(std::size_t camera) const {
    const Turn& mine = turns_[camera];
    if (mine.is_live) return true;
    for (std::size_t i = 0; i < turns_.size(); ++i) {
      const Turn& other = turns_[i];
      if (i == camera || other.is_live || other.has_ended) continue;
      if (!other.has_frame || other.time < mine.time || (other.time == mine.time && i < camera)) {
        return false;
      }
    }
    return true;
  }
  void end_all(Status how) {
    status_ = std::move(how);
    has_ended_ = true;
    for (DepthSource* source : sources_) source->cancel();
    changed_.notify_all();
  }
  void end_live() {
    for (DepthSource* source : sources_) {
      if (source->info().is_live) source->cancel();
    }
  }

  const DepthSources& sources_;
  const RecordStreamOptions& options_;
  std::mutex mutex_;  // guards the members below
  std::condition_variable changed_;
  StreamFile& file_;
  StreamRecording& done_;
  std::vector<Turn> turns_;
  Status status_ = Done{};
  bool has_ended_ = false;
};

/// Lock on the file being written: a second program would write into the same one.
class FileLock {
 public:
  explicit FileLock(const std::filesystem::path& path)
      : file_(::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | O_NONBLOCK, 0666)),
        is_taken_(file_ >= 0 && ::flock(file_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {}
  ~FileLock() {
    if (file_ >= 0) ::close(file_);
  }
  FileLock(const FileLock&) = delete;
  FileLock& operator=(const FileLock&) = delete;

  bool is_taken() const { return is_taken_; }

 private:
  const int file_;
  const bool is_taken_;
};

}  // namespace

Result<StreamRecording> record_stream(const DepthSources& sources,
                                      const std::filesystem::path& path,
                                      const RecordStreamOptions& options) {
  std::filesystem::path partial = path;
  partial += ".partial";
  const FileLock lock(partial);
  if (lock.is_taken()) {
    return Error{Errc::io_failure, "another program is recording to " + path.string() +
                                       "; give another name, or wait until that has ended"};
  }
  StreamRecording done;
  bool is_kept = false;  // though it failed
  const auto write = [&]() -> Status {
    auto file = StreamFile::create(partial, sources);
    if (!file) return file.error();
    Status copied = Copy(sources, options, *file, done).run();
    for (std::size_t i = 0; i < sources.size() && copied; ++i) {
      if (done.frames_of[i] > 0) continue;
      copied = Error{Errc::bad_input, sources[i].info().name + " has sent no frame"};
    }
    const Status finished = file->finish();
    is_kept = done.num_frames > 0 && file->is_begun();
    if (!copied) return copied;
    done.num_bytes = file->num_bytes();
    return finished;
  };
  std::error_code error;
  Status status = write();
  if (status) {
    std::filesystem::rename(partial, path, error);
    if (error) {
      status = Error{Errc::io_failure, "cannot write " + path.string() + ": " + error.message()};
    }
  }
  for (DepthSource* source : sources) {
    source->cancel();
    for (std::string& note : source->take_notes()) done.notes.push_back(std::move(note));
  }
  if (status) return done;
  if (!is_kept) {
    std::filesystem::remove(partial, error);
    return status.error();
  }
  return Error{status.error().code, status.error().message + "; what was recorded before is in " +
                                        partial.string() + ": rename it to keep it"};
}

}}  // namespace palpate::v0
