#include "src/field/memory/field_memory.h"

#include "src/core/internal/for_rows.h"

namespace palpate { inline namespace v0 {

FieldMemory::FieldMemory(int width, int height, const MemoryOptions& options, Isa isa)
    : width_(width), height_(height), rule_(memory_rule(options)), rows_(field_rows(isa)) {
  const auto num = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  pixels_.resize(num);
  behind_.resize(num);
  in_front_.resize(num);
}

void FieldMemory::update(const PointCloudView& cloud, double interval, ThreadPool& pool) {
  const auto seconds = static_cast<float>(interval);
  FieldImage seen;
  seen.planes = behind_.data();
  seen.width = width_;
  seen.height = height_;
  seen.stride = width_;
  for_rows(pool, 0, height_, [&](int v) {
    rows_.take_planes(cloud, seen, {0, 0, width_, height_}, v);
    const std::size_t begin = static_cast<std::size_t>(v) * static_cast<std::size_t>(width_);
    for (std::size_t i = begin; i < begin + static_cast<std::size_t>(width_); ++i) {
      const float depth = seen_depth(cloud, static_cast<std::ptrdiff_t>(i));
      const MemoryPlanes planes = remember(behind_[i], depth, rule_, seconds, pixels_[i]);
      behind_[i] = planes.behind;
      in_front_[i] = planes.in_front;
    }
  });
}

}}  // namespace palpate::v0
