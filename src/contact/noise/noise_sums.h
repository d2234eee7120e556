// The memory in which a query keeps the patches that it touches, and the noise of its measure.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "palpate/contact/contact_options.h"
#include "palpate/core/core.h"
#include "src/contact/field/field_bound.h"
#include "src/contact/noise/noise_grid.h"

namespace palpate { inline namespace v0 {

/// Adds the variance of one scale: `squares` of the numbers of a node, and `products` of each with
/// the next axis.
inline void add_variances(const float* squares, const float* products, float variance,
                          MeasureNoise& to) {
  const auto times = [&](float sum) {
    return static_cast<double>(variance) * static_cast<double>(sum);
  };
  to.volume += times(squares[3]);
  for (int axis = 0; axis < 3; ++axis) {
    const int next = (axis + 1) % 3;
    to.force.m[axis][axis] += times(squares[axis]);
    to.torque.m[axis][axis] += times(squares[4 + axis]);
    to.force.m[axis][next] = to.force.m[next][axis] += times(products[axis]);
    to.torque.m[axis][next] = to.torque.m[next][axis] += times(products[4 + axis]);
  }
}

/// Adds the noise that one camera causes by the patches that it decides.
using AddMeasureNoise = void (*)(const NoisePatches& patches, int camera, const NoiseCamera& view,
                                 const DepthFieldView& field, MeasureNoise& to);

/// Owns the patches of a tool. What nobody asks for stays untouched.
class NoiseMemory {
 public:
  /// Has room for the patches of up to `max_cameras` cameras, or fields.
  NoiseMemory(int num_groups, Isa isa, int max_cameras = 1);

  /// No allocation.
  NoisePatches patches(int num_cameras = 1) {
    return {patches_.get(), num_.data(), static_cast<int>(num_.size()), num_cameras};
  }
  /// Adds the noise of one of several cameras.
  void add(int camera, int num_cameras, const NoiseCamera& view, const DepthFieldView& field,
           MeasureNoise& to) {
    add_(patches(num_cameras), camera, view, field, to);
  }
  /// Returns the noise against one of the fields of one camera, in its frame. None: its noise is
  /// unknown.
  std::optional<MeasureNoise> of_field(const DepthFieldView& field, const FieldFrame& frame,
                                       int number = 0, int num_fields = 1);

 private:
  std::unique_ptr<NoisePatch[]> patches_;
  std::vector<int> num_;
  AddMeasureNoise add_;
};

/// Returns a camera whose axes are those of W.
inline NoiseCamera noise_camera(const FieldFrame& frame) {
  return {.fx = frame.fx,
          .fy = frame.fy,
          .cx = frame.cx,
          .cy = frame.cy,
          .p_WC = {frame.p_WC[0], frame.p_WC[1], frame.p_WC[2]}};
}

}}  // namespace palpate::v0
