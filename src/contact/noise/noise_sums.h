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
