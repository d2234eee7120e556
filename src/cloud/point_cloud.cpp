#include "palpate/cloud/point_cloud.h"

#include <cmath>
#include <limits>

#include "src/core/internal/assert.h"

namespace palpate { inline namespace v0 {

PointCloud::PointCloud(int width, int height, std::optional<Intrinsics> pinhole, bool has_edges)
    : width_(width), height_(height), pinhole_(pinhole), has_edges_(has_edges) {
  PALPATE_ASSERT(width >= 0 && height >= 0);
  constexpr std::size_t kPadding = PointCloudView::kPadding;
  stride_ = (size() + kPadding - 1) / kPadding * kPadding;
  data_.assign((has_edges ? 9 : 6) * stride_, std::numeric_limits<float>::quiet_NaN());
}

void PointCloud::set(std::size_t i, const Vec3f& p, const Vec3f& n) {
  PALPATE_ASSERT(i < size());
  // In double the square of any finite float normal neither overflows nor vanishes.
  const Vec3d long_n = to_double(n);
  const double length = norm(long_n);
  const bool valid = std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z) &&
                     std::isfinite(length) && length > 0;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const Vec3f unit_n = valid ? to_float(long_n / length) : Vec3f{nan, nan, nan};
  for (int axis = 0; axis < 3; ++axis) {
    channel(axis)[i] = valid ? p[axis] : nan;
    channel(3 + axis)[i] = unit_n[axis];
  }
}

PointCloudView PointCloud::view() const {
  PointCloudView view;
  view.x = channel(0);
  view.y = channel(1);
  view.z = channel(2);
  view.nx = channel(3);
  view.ny = channel(4);
  view.nz = channel(5);
  view.width = width_;
  view.height = height_;
  view.pinhole = pinhole_.has_value();
  if (pinhole_) view.intrinsics = *pinhole_;
  if (has_edges_) {
    view.edge_x = channel(6);
    view.edge_y = channel(7);
    view.edge_z = channel(8);
  }
  return view;
}

}}  // namespace palpate::v0
