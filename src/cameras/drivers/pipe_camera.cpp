// Raw frames, 16 bits a pixel, little-endian, row by row, from a pipe, a file or a local socket:
//
//   ffmpeg ... -pix_fmt gray16le -f rawvideo - | palpate touch TOOL --camera
//   'pipe:-?size=640x480&...'
//
// Before each frame there may be a header of 32 bytes: "PALPDEP1", width and height (uint32), time
// stamp in s and meters per count (float64, NaN: none). It is recognized by its first eight bytes.
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstring>
#include <utility>

#include "src/cameras/camera_kinds.h"
#include "src/cameras/stream/raw_frames.h"
#include "src/cloud/internal/frame_limits.h"
#include "src/core/internal/message_text.h"
#include "src/core/internal/monotonic_clock.h"

namespace palpate { inline namespace v0 {
namespace {

static_assert(std::endian::native == std::endian::little, "pixels are little-endian");

constexpr char kMagic[] = "PALPDEP1";
constexpr std::size_t kMagicBytes = 8, kHeaderBytes = 32;
constexpr int kPollMilliseconds = 50;
constexpr double kFirstByteTimeout = 10;  // s

/// A file descriptor that is closed at the end, unless it is the standard input.
class Descriptor {
 public:
  explicit Descriptor(int number = -1) : number_(number) {}
  Descriptor(Descriptor&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }
  ~Descriptor() {
    if (number_ > STDIN_FILENO) close(number_);
  }
  int number() const { return number_; }

 private:
  int number_;
};

class PipeSource final : public MakersSource {
 public:
  PipeSource(Descriptor input, DepthStreamInfo info, bool is_fifo)
      : input_(std::move(input)), may_be_early_(is_fifo) {
    info_ = std::move(info);
  }

  /// Reads the first header, if there is one. A given unit overrules those of headers.
  Status begin(const CameraUri& given) {
    is_unit_given_ = given.unit.has_value();
    deadline_ = monotonic_now() + kFirstByteTimeout;
    const auto got = read_all(start_, kMagicBytes);
    if (!got) return got.error();
    if (!*got) {
      return Error{Errc::bad_input, info_.name + " has no frames; write raw 16-bit frames into it"};
    }
    has_header_ = std::memcmp(start_, kMagic, kMagicBytes) == 0;
    num_ahead_ = kMagicBytes;
    if (!has_header_) {
      deadline_ = 0;
      if (given.size) return Done{};
      return Error{Errc::invalid_argument,
                   info_.name + ": unknown size of raw frames; pass ?size=WIDTHxHEIGHT"};
    }
    const auto rest = read_all(start_ + kMagicBytes, kHeaderBytes - kMagicBytes);
    if (!rest && rest.error().code != Errc::bad_input) return rest.error();
    if (!rest || !*rest) return cut_off("in its first header");
    deadline_ = 0;
    num_ahead_ = kHeaderBytes;
    if (const Status status = take_header(); !status) return status;
    has_time_stamps_ = !std::isnan(stamp_);
    return Done{};
  }
  bool has_time_stamps() const { return has_time_stamps_; }

  Result<bool> next(DepthFrame& frame) override {
    if (has_header_ && num_ahead_ == 0) {
      const auto got = read_all(start_, kHeaderBytes);
      if (!got || !*got) return got;
      if (const Status status = take_header(); !status) return status.error();
    }
    frame.width = info_.width;
    frame.height = info_.height;
    frame.unit = info_.unit;
    frame.pixels.resize(static_cast<std::size_t>(info_.width) *
                        static_cast<std::size_t>(info_.height));
    char* const bytes = reinterpret_cast<char*>(frame.pixels.data());
    // Without a header, the first bytes of the first frame have been read to look for one.
    const std::size_t num_here = has_header_ ? 0 : num_ahead_;
    std::memcpy(bytes, start_, num_here);
    num_ahead_ = 0;
    const auto got = read_all(bytes + num_here, 2 * frame.pixels.size() - num_here);
    if (!got) return got;
    if (!*got) {
      if ((has_header_ || num_here > 0) && !is_cancelled_) return cut_off("within a frame");
      return false;
    }
    // A live frame without one counts as captured when it arrives.
    const bool has_stamp = has_header_ && (info_.is_live || !std::isnan(stamp_));
    frame.timestamp = has_stamp ? stamp_ : num_read_ / info_.rate;
    ++num_read_;
    return true;
  }

 private:
  Error cut_off(const char* where) const {
    return {Errc::bad_input,
            info_.name + " was cut off " + where + "; is the size of the frames right?"};
  }

  Status take_header() {
    std::uint32_t size[2];
    double numbers[2];
    std::memcpy(size, start_ + kMagicBytes, sizeof size);
    std::memcpy(numbers, start_ + kMagicBytes + sizeof size, sizeof numbers);
    const std::string where = " of frame " + std::to_string(num_read_);
    const bool is_sound = std::memcmp(start_, kMagic, kMagicBytes) == 0 && size[0] >= 8 &&
                          size[1] >= 8 && size[0] <= kMaxImageWidth && size[1] <= kMaxImageHeight &&
                          (is_unit_given_ || !(numbers[1] <= 0));
    if (!is_sound) {
      return Error{Errc::bad_input,
                   info_.name + ": the header" + where +
                       " is damaged; it must be PALPDEP1, width, height, time stamp, unit"};
    }
    const auto bad = [&](const char* what, double number, const char* advice) {
      return Error{Errc::bad_input, info_.name + ": the " + what + where + " is " +
                                        number_text(number) + " " + advice};
    };
    if (!std::isnan(numbers[0]) && !is_in_seconds(numbers[0])) {
      return bad("time stamp", numbers[0], "s; give seconds, or NaN for none");
    }
    if (!is_unit_given_ && numbers[1] > kLargestUnit) {
      return bad("unit", numbers[1],
                 "m per count; give at most 1 m, NaN for none, or pass ?unit=METERS");
    }
    info_.width = static_cast<int>(size[0]);
    info_.height = static_cast<int>(size[1]);
    stamp_ = numbers[0];
    if (!is_unit_given_ && numbers[1] > 0) info_.unit = numbers[1];
    return Done{};
  }

  /// False at the end before the first of these bytes, or when cancelled.
  Result<bool> read_all(char* to, std::size_t num) {
    std::size_t num_here = 0;
    while (num_here < num) {
      if (is_cancelled_) return false;
      pollfd wait{input_.number(), POLLIN, 0};
      const int ready = poll(&wait, 1, kPollMilliseconds);
      if (deadline_ > 0 && monotonic_now() > deadline_) {
        return Error{Errc::unavailable, info_.name + " has sent " +
                                            (num_ahead_ > 0 ? "no whole header" : "nothing") +
                                            " within 10 s; start what writes into it"};
      }
      if (ready == 0 || (ready < 0 && errno == EINTR)) continue;
      const ssize_t got = read(input_.number(), to + num_here, num - num_here);
      if (got < 0 && (errno == EINTR || errno == EAGAIN)) continue;
      if (got < 0) {
        return Error{Errc::io_failure, "cannot read " + info_.name + ": " + std::strerror(errno)};
      }
      if (got == 0) {
        // No program has opened the named pipe for writing yet.
        if (may_be_early_) {
          sleep_until(monotonic_now() + 1e-3 * kPollMilliseconds);
          continue;
        }
        if (num_here > 0) return cut_off("within a frame");
        return false;
      }
      may_be_early_ = false;
      num_here += static_cast<std::size_t>(got);
    }
    return true;
  }

  const Descriptor input_;
  bool has_header_ = false, has_time_stamps_ = false, may_be_early_ = false;
  bool is_unit_given_ = false;
  char start_[kHeaderBytes] = {};
  std::size_t num_ahead_ = 0;  // bytes of start_ that belong to the next frame
  double stamp_ = 0, deadline_ = 0;
  std::uint64_t num_read_ = 0;
};

struct Input {
  Descriptor descriptor;
  bool is_file = false, is_fifo = false;
};

Result<Input> open_input(const std::string& path) {
  if (path.empty() || path == "-") {
    if (isatty(STDIN_FILENO) != 0) {
      return Error{Errc::bad_input,
                   "pipe:- reads raw frames from the standard input, which is a terminal; write "
                   "'ffmpeg ... -pix_fmt gray16le -f rawvideo - | palpate ...'"};
    }
    struct stat kind {};
    const bool is_file = fstat(STDIN_FILENO, &kind) == 0 && S_ISREG(kind.st_mode);
    return Input{Descriptor(STDIN_FILENO), is_file, false};
  }
  const auto failed = [&] {
    return Error{errno == ENOENT ? Errc::not_found : Errc::io_failure,
                 "cannot open " + path + ": " + std::strerror(errno) + "; check its name"};
  };
  struct stat kind {};
  if (stat(path.c_str(), &kind) != 0) return failed();
  if (S_ISDIR(kind.st_mode)) {
    return Error{Errc::bad_input,
                 path + " is a folder; give folder:" + path + " or a file of raw frames"};
  }
  if (S_ISSOCK(kind.st_mode)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    if (path.size() >= sizeof address.sun_path) {
      return Error{Errc::invalid_argument, path + " is too long a name for a socket"};
    }
    std::copy(path.begin(), path.end(), address.sun_path);
    Descriptor socket_(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
    if (connect(socket_.number(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
      return failed();
    return Input{std::move(socket_), false, false};
  }
  Descriptor file(open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  if (file.number() < 0) return failed();
  return Input{std::move(file), S_ISREG(kind.st_mode), S_ISFIFO(kind.st_mode)};
}

}  // namespace

Result<RawStream> open_pipe_camera(const CameraUri& uri, const CameraOpening& opening) {
  if (const Status status = uri.check_extras(); !status) return status.error();
  auto input = open_input(uri.target);
  if (!input) return input.error();
  DepthStreamInfo info;
  info.width = uri.size.value_or(ImageSize{}).width;
  info.height = uri.size.value_or(ImageSize{}).height;
  info.unit = uri.unit.value_or(info.unit);
  info.rate = uri.rate.value_or(info.rate);
  info.name = "pipe:" + (uri.target.empty() ? "-" : uri.target);
  info.is_live = opening.in_real_time && !input->is_file;
  auto source = std::make_unique<PipeSource>(std::move(input->descriptor), info, input->is_fifo);
  if (const Status begun = source->begin(uri); !begun) return begun.error();
  const bool has_time_stamps = source->has_time_stamps();
  return RawStream{std::move(source), has_time_stamps ? StampClock::cameras : StampClock::none,
                   false};
}

FoundCameras find_pipe_cameras() {
  return always_there(
      "raw 16-bit frames from the standard input, a named pipe, a file or a socket; with "
      "?size=WIDTHxHEIGHT&intrinsics=");
}

}}  // namespace palpate::v0
