// The field made on a GPU has the bits of the CPU's.
#include "src/field/depth_field_cuda.h"

#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "src/gpu/internal/team.cuh"
#include "tests/field/device_views.h"
#include "tests/test_util/gpu.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

/// A bumpy wall with a step and noise, and with holes of all sizes if wanted.
PointCloud rough_cloud(int width, int height, std::uint64_t seed, bool has_holes) {
  const Intrinsics k{0.9 * width, 0.93 * width, 0.5 * width, 0.51 * height};
  PointCloud cloud(width, height, k);
  test::Random random(seed);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const bool is_hole =
          random.uniform() < 0.02 || std::hypot(u - 0.3 * width, v - 0.7 * height) < 0.2 * width;
      const double wall = u > 0.6 * width && v > 0.3 * height ? 0.6 : 0.85;
      const double z =
          has_holes && is_hole ? NAN : wall + 0.01 * std::sin(u * 0.1) + 0.002 * random.normal();
      const Vec3d p{(u - k.cx) * z / k.fx, (v - k.cy) * z / k.fy, z};
      cloud.set(static_cast<std::size_t>(v * width + u), to_float(p),
                to_float(Vec3d{0, 0, -1} + 0.4 * random.direction()));
    }
  }
  return cloud;
}

/// A cloud on the GPU.
PointCloudView upload(const PointCloud& cloud, gpu::Memory& memory) {
  PointCloudView view = cloud.view();
  for (const float** channel : {&view.x, &view.y, &view.z, &view.nx, &view.ny, &view.nz}) {
    *channel = memory.copy_of(std::span(*channel, cloud.size()));
  }
  view.gpu = memory.gpu();
  return view;
}

DepthField made_on_cpu(const PointCloud& cloud, const DepthFieldOptions& options) {
  ThreadPool pool(1);
  DepthField field = std::move(DepthField::create(cloud.width(), cloud.height(), options)).value();
  field.update(cloud.view(), pool);
  return field;
}

void compare(const PointCloud& cloud, const DepthFieldOptions& options) {
  gpu::Memory memory(0);
  gpu::Stream stream(0, gpu::Priority::low);
  auto field = DepthFieldCuda::create(cloud.width(), cloud.height(), options, 0);
  ASSERT_TRUE(field) << field.error().message;
  EXPECT_EQ(field->view().num_levels, 0);
  field->enqueue(upload(cloud, memory), stream);
  ASSERT_TRUE(stream.wait()) << stream.status().error().message;
  EXPECT_EQ(field->view().gpu, 0);
  if (cloud.width() > 64 && options.fill_levels > 0 && options.unknown != UnknownSpace::blocked) {
    EXPECT_NE(field->view().filled_behind, nullptr);
  }
  test::expect_same_field(field->view(), made_on_cpu(cloud, options).view(), stream);
}

TEST(DepthFieldCuda, HasTheBitsOfTheCpuForAllSizes) {
  PALPATE_GPU_OR_SKIP();
  int seed = 0;
  for (const auto& [width, height] :
       {std::pair{8, 8}, {9, 31}, {32, 64}, {33, 65}, {97, 40}, {75, 161}}) {
    SCOPED_TRACE(width);
    for (const UnknownSpace unknown :
         {UnknownSpace::free, UnknownSpace::solid, UnknownSpace::blocked}) {
      compare(rough_cloud(width, height, ++seed, true), {.unknown = unknown});
      compare(rough_cloud(width, height, ++seed, false), {.unknown = unknown});
    }
  }
}

TEST(DepthFieldCuda, FillsHolesAsTheCpuDoes) {
  PALPATE_GPU_OR_SKIP();
  for (int fill_levels = 0; fill_levels < DepthFieldView::kMaxLevels; ++fill_levels) {
    SCOPED_TRACE(fill_levels);
    compare(rough_cloud(131, 99, 7, true),
            {.fill_levels = fill_levels, .unseen = UnseenSpace::free, .thickness = 0.03});
  }
  compare(PointCloud(40, 50, Intrinsics{40, 40, 20, 25}), {.unknown = UnknownSpace::solid});
  // Shadows of all widths beside a block, to its left and below, and some at the border.
  PointCloud block = rough_cloud(170, 180, 9, false);
  for (int v = 0; v < 180; ++v) {
    for (int u = 0; u < 170; ++u) {
      const bool is_beside = v < 100 && u < 110 && u >= 110 - v % 83;
      const bool is_below = v >= 100 && v < 100 + u % 79 && u >= 60;
      const bool is_block = v < 100 && u >= 110;
      const double z = is_beside || is_below ? NAN : (is_block ? 0.4 : 0.9);
      block.set(static_cast<std::size_t>(v * 170 + u),
                to_float({(u - 85) * z / 153, (v - 91.8) * z / 158.1, z}), {0, 0, -1});
    }
  }
  for (const UnknownSpace unknown :
       {UnknownSpace::free, UnknownSpace::solid, UnknownSpace::blocked}) {
    compare(block, {.unknown = unknown});
  }
  // Squares with and without holes side by side.
  PointCloud corner = rough_cloud(100, 70, 8, false);
  for (std::size_t v = 20; v < 45; ++v) {
    for (std::size_t u = 0; u < 40; ++u) corner.set(v * 100 + u, {NAN, NAN, NAN}, {0, 0, -1});
  }
  compare(corner, {});
  PointCloud one(70, 50, Intrinsics{40, 40, 20, 25});
  one.set(20 * 70 + 67, {0, 0, 0.5f}, {0, 0, -1});
  compare(one, {.unknown = UnknownSpace::solid});
}

TEST(DepthFieldCuda, SameBitsInAnyOrderAndWhateverWasThereBefore) {
  PALPATE_GPU_OR_SKIP();
  const PointCloud cloud = rough_cloud(70, 45, 3, true), before = rough_cloud(70, 45, 4, true);
  gpu::Memory memory(0);
  gpu::Stream stream(0, gpu::Priority::low);
  const PointCloudView view = upload(cloud, memory), view_before = upload(before, memory);
  auto field = std::move(DepthFieldCuda::create(70, 45, {}, 0)).value();
  const DepthField want = made_on_cpu(cloud, {});
  std::uint64_t last_stamp = 0;
  test::in_all_orders([&] {
    field.enqueue(view_before, stream);
    field.enqueue(view, stream);
    EXPECT_NE(field.view().stamp, last_stamp);
    last_stamp = field.view().stamp;
    test::expect_same_field(field.view(), want.view(), stream);
  });
}

TEST(DepthFieldCuda, CanBeRecorded) {
  PALPATE_GPU_OR_SKIP();
  const PointCloud cloud = rough_cloud(70, 45, 5, true);
  gpu::Memory memory(0);
  gpu::Stream stream(0, gpu::Priority::low);
  auto field = std::move(DepthFieldCuda::create(70, 45, {}, 0)).value();
  const PointCloudView view = upload(cloud, memory);
  stream.begin_recording();
  field.enqueue(view, stream);
  const gpu::Graph graph = stream.end_recording();
  const DepthField want = made_on_cpu(cloud, {});
  for (int k = 0; k < 2; ++k) {
    stream.launch(graph);
    ASSERT_TRUE(stream.wait()) << stream.status().error().message;
    test::expect_same_field(field.view(), want.view(), stream);
  }
}

TEST(DepthFieldCuda, RefusesBadSizesAndOptions) {
  PALPATE_GPU_OR_SKIP();
  EXPECT_FALSE(DepthFieldCuda::create(7, 100, {}, 0));
  EXPECT_FALSE(DepthFieldCuda::create(100, 100, {.fill_levels = 6}, 0));
}

}  // namespace
}  // namespace palpate
