// palpate.PushedCamera: images from Python for a run.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <cmath>
#include <mutex>
#include <span>

#include "python/src/pushed_camera.h"

namespace palpate::python {

PyPushedCamera::PyPushedCamera(const PyCamera& camera, double rate, bool has_time_stamps,
                               double latency, bool is_moving, bool has_flow)
    : camera_(camera), has_time_stamps_(has_time_stamps) {
  DepthStreamInfo info = camera.stream();
  info.rate = rate;
  info.is_live = true;
  info.is_moving = is_moving;
  info.has_flow = has_flow;
  info.name = "a camera in Python";
  source_ = taken(PushedSource::create(info, {has_time_stamps, latency}));
}

Pose PyPushedCamera::pose_at(std::optional<double> time, const nb::object& pose) const {
  if (time && !has_time_stamps_) {
    throw nb::value_error(
        "time: this camera has no clock of its own; create it with has_time_stamps=True");
  }
  if (!time && has_time_stamps_) {
    throw nb::value_error("time: this camera has timestamps; pass that of the image, s");
  }
  if (time && !std::isfinite(*time)) throw nb::value_error("time: not finite");
  if (!pose.is_none() && !source_->info().is_moving) {
    throw nb::value_error("pose: this camera is static; create it with moving=True");
  }
  const Pose X_WC = pose.is_none() ? camera_.X_WC : pose_of(pose, "pose");
  if (!is_finite(X_WC)) throw nb::value_error("pose: not finite");
  return X_WC;
}

void PyPushedCamera::push(nb::handle depth, std::optional<double> time, const nb::object& pose,
                          const nb::object& flow) {
  const Pose X_WC = pose_at(time, pose);
  const Counts counts = counts_of(depth);
  if (counts.ndim() != 2) refuse_shape("depth", shape_of(counts), "(H, W)");
  const Flow pixels_per_second = flow_of(flow, counts);
  const nb::gil_scoped_release no_gil;
  const std::lock_guard lock(mutex_);
  frame_.X_WC = X_WC;
  frame_.width = static_cast<int>(counts.shape(1));
  frame_.height = static_cast<int>(counts.shape(0));
  frame_.unit = camera_.unit;
  frame_.timestamp = time.value_or(0);
  frame_.pixels.assign(counts.data(), counts.data() + counts.size());
  frame_.flow.assign(pixels_per_second.data(), pixels_per_second.data() + pixels_per_second.size());
  source_->push(frame_);
}

void PyPushedCamera::push_points(nb::handle points, nb::handle normals, std::optional<double> time,
                                 const nb::object& pose) {
  using Numbers = nb::ndarray<const float, nb::c_contig, nb::device::cpu>;
  const Pose X_WC = pose_at(time, pose);
  const nb::module_ numpy = nb::module_::import_("numpy");
  const auto numbers_of = [&](nb::handle array) {
    return nb::cast<Numbers>(numpy.attr("ascontiguousarray")(array, "float32"));
  };
  const Numbers p_C = numbers_of(points);
  const bool is_image = p_C.ndim() == 3;
  if ((!is_image && p_C.ndim() != 2) || p_C.shape(p_C.ndim() - 1) != 3 || p_C.size() == 0) {
    refuse_shape("points", shape_of(p_C), "(N, 3) or (H, W, 3), with at least one point");
  }
  Numbers n_C;
  if (!normals.is_none()) {
    n_C = numbers_of(normals);
    if (shape_of(n_C) != shape_of(p_C))
      refuse_shape("normals", shape_of(n_C), "that of the points");
  }
  if (p_C.size() / 3 > std::size_t{kMaxImageWidth} * kMaxImageHeight) {
    throw nb::value_error("points: more than 4096 x 4096; thin them");
  }
  const nb::gil_scoped_release no_gil;
  const auto view_of = [](const Numbers& numbers) {
    return std::span(reinterpret_cast<const Vec3f*>(numbers.data()), numbers.size() / 3);
  };
  const int width = static_cast<int>(p_C.shape(is_image ? 1 : 0));
  const int height = is_image ? static_cast<int>(p_C.shape(0)) : 1;
  source_->push_points(
      {width, height, view_of(p_C), normals.is_none() ? std::span<const Vec3f>() : view_of(n_C)},
      X_WC, time.value_or(0));
}

PyPushedCamera::Flow PyPushedCamera::flow_of(const nb::object& flow, const Counts& counts) const {
  if (flow.is_none()) return {};
  if (!source_->info().has_flow) {
    throw nb::value_error("flow: this camera has none; make it with flow=True");
  }
  const nb::module_ numpy = nb::module_::import_("numpy");
  Flow given = nb::cast<Flow>(numpy.attr("ascontiguousarray")(flow, "float32"));
  if (given.ndim() != 3 || given.shape(0) != counts.shape(0) || given.shape(1) != counts.shape(1) ||
      given.shape(2) != 2) {
    refuse_shape("flow", shape_of(given), "(H, W, 2), H and W of the depth image");
  }
  return given;
}

PyPushedCamera::Counts PyPushedCamera::counts_of(nb::handle depth) const {
  Counts counts;
  const nb::object plain = plain_image(depth);
  depth = plain;
  if (nb::try_cast<Counts>(depth, counts, false)) return counts;
  const nb::module_ numpy = nb::module_::import_("numpy");
  nb::object array = numpy.attr("asarray")(depth);
  if (nb::cast<std::string>(array.attr("dtype").attr("kind")) == "f") {
    const nb::object rounded = numpy.attr("rint")(array / nb::float_(camera_.unit));
    const nb::object nearer = numpy.attr("minimum")(rounded, nb::float_(kFarCount));
    array = numpy.attr("where")(rounded.attr("__gt__")(0), nearer, 0);
  } else if (nb::cast<std::string>(array.attr("dtype").attr("name")) != "uint16") {
    throw nb::value_error("depth: uint16 counts or float32 meters are taken, no other type");
  }
  return nb::cast<Counts>(numpy.attr("ascontiguousarray")(array, "uint16"));
}

void bind_pushed_camera(nb::module_& m) {
  nb::class_<PyPushedCamera>(
      m, "PushedCamera",
      R"(A live camera that your own code reads: push its images during a run.

camera: size and intrinsics of the images. rate: nominal, frames per second. has_time_stamps: `push`
gets times of the camera's own clock, s; otherwise an image counts as captured when it is pushed.
latency: s, 0 to 1, from the exposure to the timestamp. moving: each push has the pose of the camera.
flow: pushes may have an optical flow. A PushedCamera is for one run.)")
      .def(nb::init<const PyCamera&, double, bool, double, bool, bool>(), nb::arg("camera"),
           nb::kw_only(), nb::arg("rate") = 30.0, nb::arg("has_time_stamps") = false,
           nb::arg("latency") = 0.0, nb::arg("moving") = false, nb::arg("flow") = false)
      .def(
          "push", &PyPushedCamera::push, nb::arg("depth"), nb::kw_only(),
          nb::arg("time") = nb::none(), nb::arg("pose") = nb::none(), nb::arg("flow") = nb::none(),
          nb::sig("def push(self, depth: palpate._types.Array, *, time: float | None = None, "
                  "pose: palpate._types.Array | None = None, "
                  "flow: palpate._types.Array | None = None) -> None"),
          R"(depth: (H, W) uint16 counts or float32 meters; negative ones are no measurement. time: s on the
camera's own clock, if created with has_time_stamps=True. pose: X_WC of this image, (4, 4) or (7,), if the
camera moves; None: that of the camera. flow: (H, W, 2), optical flow, u and v of each pixel in pixels per
second, NaN where unknown; None: unknown. Never waits for the run: the newest image wins. From any
thread.)")
      .def(
          "push_points", &PyPushedCamera::push_points, nb::arg("points"),
          nb::arg("normals") = nb::none(), nb::kw_only(), nb::arg("time") = nb::none(),
          nb::arg("pose") = nb::none(),
          nb::sig("def push_points(self, points: palpate._types.Array, "
                  "normals: palpate._types.Array | None = None, *, time: float | None = None, "
                  "pose: palpate._types.Array | None = None) -> None"),
          R"(Points instead of an image: they become the image of the camera, whose distortion does not matter.

points: (N, 3), or (H, W, 3) organized like the image, float32, m, in the camera's frame (x right, y down,
z forward); NaN or 0 0 0: no measurement. Organized points on the rays of the camera give their z, to the
bit; others are projected. normals: of the same shape, out of the environment; points whose normals point
away from the camera are left out. time, pose: as of `push`. Takes O(points + pixels) in the thread that
calls. ValueError: another shape, more than 4096 x 4096 points.)")
      .def(
          "end", [](PyPushedCamera& self) { self.source()->end(); }, "Ends the stream.");
}

}  // namespace palpate::python
