// The memory in which a query keeps the elements that touch, and the noise of its measure.
#pragma once

#include <optional>
#include <vector>

#include "palpate/contact/contact_options.h"
#include "palpate/core/core.h"
#include "src/contact/field/field_bound.h"
#include "src/contact/noise/noise_grid.h"

namespace palpate { inline namespace v0 {

/// Elements of all groups.
struct NoiseSums {
  NoiseRows rows;
  int num_groups = 0;
};

/// Adds the variance of one scale: `squares` of the numbers of a node, and `products` of each with
/// the next axis.
inline void add_variances(const float* squares, const float* products, float variance,
                          MeasureNoise& to) {
  const auto times = [&](float sum) {
    return static_cast<double>(variance) * static_cast<double>(sum);
  };
  to.volume += times(squares[0]);
  for (int axis = 0; axis < 3; ++axis) {
    const int next = (axis + 1) % 3;
    to.force.m[axis][axis] += times(squares[1 + axis]);
    to.torque.m[axis][axis] += times(squares[4 + axis]);
    to.force.m[axis][next] = to.force.m[next][axis] += times(products[1 + axis]);
    to.torque.m[axis][next] = to.torque.m[next][axis] += times(products[4 + axis]);
  }
}

/// Adds the noise that one camera causes by the elements that it decides.
using AddMeasureNoise = void (*)(const NoiseSums& sums, int camera, const NoiseCamera& view,
                                 const DepthFieldView& field, MeasureNoise& to);

/// Owns the rows of a tool's elements, from the first call of `rows` on: they take five times the
/// memory of all else.
class NoiseMemory {
 public:
  NoiseMemory(int num_groups, Isa isa);

  NoiseRows rows() {
    const std::ptrdiff_t num_elements = first_noise_row(static_cast<int>(num_.size()));
    if (numbers_.empty()) numbers_.resize(kNumNoiseRows * static_cast<std::size_t>(num_elements));
    return {numbers_.data(), num_elements, num_.data()};
  }
  /// Adds the noise of one of several cameras.
  void add(int camera, const NoiseCamera& view, const DepthFieldView& field, MeasureNoise& to) {
    add_({rows(), static_cast<int>(num_.size())}, camera, view, field, to);
  }
  /// Returns the noise against one field, in its frame. None: its noise is unknown.
  std::optional<MeasureNoise> of_field(const DepthFieldView& field, const FieldFrame& frame);

 private:
  std::vector<float> numbers_;
  std::vector<int> num_;
  AddMeasureNoise add_;
};

}}  // namespace palpate::v0
