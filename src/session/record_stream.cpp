#include "src/session/internal/record_stream.h"

#include <chrono>
#include <string_view>
#include <system_error>
#include <utility>

#include "src/io/cdr.h"
#include "src/io/internal/mcap_file.h"
#include "src/io/ros_messages.h"
#include "src/session/run_messages.h"

namespace palpate {
namespace {

constexpr const char* kCamera = "camera";

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

/// s to add to the time stamps of a live stream: from the monotonic clock to 1970.
double since_1970() {
  using std::chrono::duration;
  return duration<double>(std::chrono::system_clock::now().time_since_epoch()).count() -
         duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

class StreamFile {
 public:
  static Result<StreamFile> create(const std::filesystem::path& path, const DepthStreamInfo& info) {
    auto writer = McapWriter::create(path);
    if (!writer) return writer.error();
    return StreamFile(*std::move(writer), info);
  }

  Status add(const DepthFrame& frame) {
    const double seconds = frame.timestamp + offset_;
    const auto time = static_cast<std::uint64_t>(1e9 * (seconds > 0 ? seconds : 0));
    const RosHeader header{time, kCamera};
    if (frame.unit != unit_) {
      unit_ = frame.unit;
      if (const Status status = writer_.write(units_, time, unit_message(unit_)); !status)
        return status;
    }
    if (num_frames_ == 0 || info_.is_moving) {
      const RosTransform pose[] = {{"world", kCamera, frame.X_WC}};
      const auto channel = info_.is_moving ? transforms_ : statics_;
      if (const Status status = writer_.write(channel, time, transform_message(time, pose));
          !status)
        return status;
    }
    if (num_frames_++ == 0) {
      if (const Status status = writer_.write(sensors_, time, text_message(name_of(info_.sensor)));
          !status)
        return status;
    }
    if (const Status status = writer_.write(infos_, time, camera_info_message(header, info_));
        !status)
      return status;
    return writer_.write(images_, time, image_message(header, frame));
  }
  Status finish() { return writer_.finish(); }
  std::uint64_t num_bytes() const { return writer_.bytes_written(); }

 private:
  StreamFile(McapWriter writer, const DepthStreamInfo& info)
      : writer_(std::move(writer)), info_(info), offset_(info.is_live ? since_1970() : 0) {
    images_ = writer_.add_channel(ros_channel("/camera/depth/image_rect_raw", "sensor_msgs/Image"));
    infos_ =
        writer_.add_channel(ros_channel("/camera/depth/camera_info", "sensor_msgs/CameraInfo"));
    statics_ = writer_.add_channel(ros_channel("/tf_static", "tf2_msgs/TFMessage"));
    transforms_ = writer_.add_channel(ros_channel("/tf", "tf2_msgs/TFMessage"));
    units_ = writer_.add_channel(
        {"/camera/depth/unit", "palpate_msgs/msg/DepthUnit", "float64 metres_per_count\n"});
    sensors_ =
        writer_.add_channel({"/camera/depth/sensor", "std_msgs/msg/String", "string data\n"});
  }

  McapWriter writer_;
  DepthStreamInfo info_;
  double offset_ = 0, unit_ = 0;
  std::uint16_t images_ = 0, infos_ = 0, statics_ = 0, transforms_ = 0, units_ = 0, sensors_ = 0;
  std::uint64_t num_frames_ = 0;
};

Status copy_frames(DepthSource& source, const RecordStreamOptions& options, StreamFile& file,
                   StreamRecording& done) {
  DepthFrame frame;
  double first = 0;
  for (;;) {
    if (options.keep_going && !options.keep_going(done.seconds, done.num_frames)) return Done{};
    const auto got = source.next(frame);
    if (!got) return got.error();
    if (!*got) return Done{};
    if (done.num_frames == 0) first = frame.timestamp;
    if (frame.timestamp - first > options.duration) return Done{};
    if (const Status status = file.add(frame); !status) return status;
    ++done.num_frames;
    done.seconds = frame.timestamp - first;
  }
}

}  // namespace

Result<StreamRecording> record_stream(DepthSource& source, const std::filesystem::path& path,
                                      const RecordStreamOptions& options) {
  std::filesystem::path partial = path;
  partial += ".partial";
  StreamRecording done;
  const auto write = [&]() -> Status {
    auto file = StreamFile::create(partial, source.info());
    if (!file) return file.error();
    if (const Status status = copy_frames(source, options, *file, done); !status) return status;
    if (done.num_frames == 0) {
      return Error{Errc::bad_input, source.info().name + " has sent no frame: nothing is recorded"};
    }
    const Status finished = file->finish();
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
  source.cancel();
  done.notes = source.take_notes();
  if (status) return done;
  std::filesystem::remove(partial, error);
  return status.error();
}

}  // namespace palpate
