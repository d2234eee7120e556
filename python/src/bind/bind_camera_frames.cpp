// palpate.CameraFrames: the images of a camera of any kind, by its URI.
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>

#include "palpate/cameras/cameras.h"
#include "python/src/arrays.h"
#include "python/src/bindings.h"
#include "python/src/interruptible.h"

namespace palpate::python {
namespace {

class CameraFrames {
 public:
  CameraFrames(const std::string& uri, bool in_real_time) : stream_(std::make_shared<Stream>()) {
    stream_->source = taken(interruptible(
        [=] { return open_camera(uri, CameraOpening{.in_real_time = in_real_time}); }));
  }
  ~CameraFrames() { close(); }

  PyCamera camera() const {
    const DepthStreamInfo& info = stream_->source->info();
    PyCamera camera;
    camera.camera = {info.width, info.height, info.intrinsics};
    camera.unit = info.unit;
    return camera;
  }

  nb::tuple next() {
    // The thread that waits may outlive this object, after Ctrl-C.
    std::optional<DepthFrame> frame =
        taken(interruptible([stream = stream_]() -> Result<std::optional<DepthFrame>> {
          const std::lock_guard lock(stream->mutex);
          DepthFrame read;
          const Result<bool> got = stream->is_closed ? false : stream->source->next(read);
          if (!got) return got.error();
          if (!*got || stream->is_closed) return std::optional<DepthFrame>();
          return std::optional(std::move(read));
        }));
    if (!frame) throw nb::stop_iteration();
    const auto rows = static_cast<std::size_t>(frame->height);
    const auto columns = static_cast<std::size_t>(frame->width);
    return nb::make_tuple(frame->timestamp, array_of(std::move(frame->pixels), {rows, columns}),
                          seven_of(frame->X_WC));
  }

  std::vector<std::string> notes() { return stream_->source->take_notes(); }
  void close() {
    stream_->is_closed = true;  // files have no other end
    stream_->source->cancel();
  }

 private:
  struct Stream {
    std::mutex mutex;  // of `next`
    std::unique_ptr<DepthSource> source;
    std::atomic<bool> is_closed = false;
  };
  std::shared_ptr<Stream> stream_;
};

}  // namespace

void bind_camera_frames(nb::module_& m) {
  nb::class_<CameraFrames>(
      m, "CameraFrames",
      R"(The images of a camera, live or from files, as `palpate touch --camera` takes it:

    for time, depth, pose in palpate.CameraFrames("realsense:"):
        surface = sensor.update(depth, time=time, pose=pose)

Yields the time, s on the camera's clock, (H, W) uint16 counts without distortion, and X_WC, (7,) tx ty tz
qx qy qz qw. uri: KIND[:TARGET][?NAME=VALUE&...], see `palpate cameras`. in_real_time: images that were not
taken in time are dropped, as a run does; False: every image of a file counts, as fast as it is taken.
Error: a kind, file or device that is not there, with what was tried; an image that cannot be read.)")
      .def(nb::init<const std::string&, bool>(), nb::arg("uri"), nb::kw_only(),
           nb::arg("in_real_time") = true)
      .def_prop_ro("camera", &CameraFrames::camera,
                   "Size, intrinsics and unit of the images; its pose is that of each image.")
      .def("notes", &CameraFrames::notes,
           "New messages about the stream, e.g. that the camera was unplugged.")
      .def("close", &CameraFrames::close, "Ends the stream: a waiting thread goes on at once.")
      .def(
          "__iter__", [](nb::handle self) { return nb::borrow(self); },
          nb::sig("def __iter__(self) -> CameraFrames"))
      .def("__next__", &CameraFrames::next,
           nb::sig("def __next__(self) -> tuple[float, numpy.typing.NDArray[numpy.uint16], "
                   "numpy.typing.NDArray[numpy.float64]]"));
}

}  // namespace palpate::python
