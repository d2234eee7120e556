// Memory of a static camera for occluded space, on a CPU.
#pragma once

#include <vector>

#include "palpate/cloud/point_cloud.h"
#include "palpate/core/core.h"
#include "src/field/memory/memory_pixel.h"
#include "src/field/pyramid/field_rows.h"

namespace palpate { inline namespace v0 {

class FieldMemory {
 public:
  FieldMemory(int width, int height, const MemoryOptions& options, Isa isa = best_isa());

  /// Takes the points of a frame, `interval` s after the one before. The same bits for any number
  /// of threads. No allocation.
  void update(const PointCloudView& cloud, double interval, ThreadPool& pool);

  /// The planes of the last frame's pixels, row by row: what is behind, remembered or seen, and
  /// what has come before it.
  const TangentPlane* behind() const { return behind_.data(); }
  const TangentPlane* in_front() const { return in_front_.data(); }

 private:
  int width_, height_;
  MemoryRule rule_;
  FieldRows rows_;
  std::vector<PixelMemory> pixels_;
  std::vector<TangentPlane> behind_, in_front_;
};

}}  // namespace palpate::v0
