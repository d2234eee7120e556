// Class palpate.PushedCamera: a live camera whose images come from Python, and which a run reads as
// any other depth stream.
#pragma once

#include <nanobind/ndarray.h>

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>

#include "palpate/cameras/cameras.h"
#include "python/src/arrays.h"
#include "python/src/bindings.h"

namespace palpate::python {

class PyPushedCamera {
 public:
  PyPushedCamera(const PyCamera& camera, double rate, bool has_time_stamps, double latency,
                 bool is_moving, bool has_flow);

  const std::shared_ptr<PushedSource>& source() const { return source_; }
  const Pose& X_WC() const { return camera_.X_WC; }
  /// True if a run has used it: the run cancels its sources at the end.
  bool has_run() const { return has_run_; }
  void begin_run() { has_run_ = true; }

  /// Copies an image, and hands it to the run. Releases the GIL; from any thread.
  void push(nb::handle depth, std::optional<double> time, const nb::object& pose,
            const nb::object& flow);
  /// The same with points instead of an image.
  void push_points(nb::handle points, nb::handle normals, std::optional<double> time,
                   const nb::object& pose);

 private:
  using Counts = nb::ndarray<const std::uint16_t, nb::c_contig, nb::device::cpu>;
  using Flow = nb::ndarray<const float, nb::c_contig, nb::device::cpu>;

  /// Checks when and where an image was taken; returns X_WC.
  Pose pose_at(std::optional<double> time, const nb::object& pose) const;
  /// Reads the flow, (H, W, 2) like the counts; empty if there is none.
  Flow flow_of(const nb::object& flow, const Counts& counts) const;
  /// Returns uint16 counts as they are, and meters as counts.
  Counts counts_of(nb::handle depth) const;

  std::shared_ptr<PushedSource> source_;
  PyCamera camera_;
  bool has_time_stamps_ = false, has_run_ = false;
  std::mutex mutex_;  // of the frame: threads push without the GIL
  DepthFrame frame_;
};

}  // namespace palpate::python
