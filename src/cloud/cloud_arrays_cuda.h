// An organized cloud in the memory of a GPU.
#pragma once

#include <limits>
#include <vector>

#include "palpate/cloud/point_cloud.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {

/// The arrays of a cloud, as PointCloudView wants them, or of several one after the other. All lie
/// in one block: others (DLPack) take x, y, z for one array, and copy them at once.
struct CloudArrays {
  float* channels[6] = {};  ///< x, y, z, nx, ny, nz
  PointCloudView view;      ///< of these

  /// All points invalid. Failures are left in `memory`, which owns the arrays.
  static CloudArrays make(gpu::Memory& memory, int width, int height, const Intrinsics& k,
                          int num_clouds = 1) {
    CloudArrays cloud;
    PointCloudView& view = cloud.view;
    view.width = width;
    view.height = height;
    view.pinhole = true;
    view.intrinsics = k;
    view.gpu = memory.gpu();
    const std::size_t size = static_cast<std::size_t>(num_clouds) * padded_size(view);
    const std::vector<float> none(size, std::numeric_limits<float>::quiet_NaN());
    float* next = memory.take<float>(std::size(cloud.channels) * size);
    for (float*& channel : cloud.channels) {
      channel = next;
      if (next == nullptr) continue;
      memory.upload(channel, none.data(), size * sizeof(float));
      next += size;
    }
    view.x = cloud.channels[0];
    view.y = cloud.channels[1];
    view.z = cloud.channels[2];
    view.nx = cloud.channels[3];
    view.ny = cloud.channels[4];
    view.nz = cloud.channels[5];
    return cloud;
  }

  static std::size_t padded_size(const PointCloudView& view) {
    constexpr std::size_t kPadding = PointCloudView::kPadding;
    return (view.size() + kPadding - 1) / kPadding * kPadding;
  }
};

}}  // namespace palpate::v0
