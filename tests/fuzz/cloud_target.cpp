// Point clouds from others: PointCloud2 messages, PCD and PLY files, and the images made of them.
// The first byte says which.
#include <cmath>

#include "src/cloud/internal/cloud_camera.h"
#include "src/io/internal/cloud_folder.h"
#include "src/io/internal/ros_image.h"
#include "tests/fuzz/target.h"
#include "tests/io/made_cloud.h"

namespace palpate::fuzz {
namespace {

constexpr char kMessage = 'm', kFile = 'f';

void see(const CloudPoints& cloud) {
  const PointsView view = cloud.view();
  require(view.points.size() ==
              static_cast<std::size_t>(view.width) * static_cast<std::size_t>(view.height),
          "a cloud has the points of its size");
  require(view.normals.empty() || view.normals.size() == view.points.size(),
          "each point has a normal, or none");
  for (const CloudCameraOptions& options :
       {CloudCameraOptions{}, CloudCameraOptions{.viewpoint = Vec3d{0.1, 0, -1}},
        CloudCameraOptions{.look = Vec3d{1, 0, 0}, .width = 12, .height = 8}}) {
    auto camera = CloudCamera::create(view, options);
    if (!camera) {
      require(camera.error().message.size() > 10, "an error has a message");
      continue;
    }
    const auto& [width, height, k, none] = camera->model();
    require(width >= 8 && height >= 8 && width <= kMaxImageWidth && height <= kMaxImageHeight,
            "an image has a size");
    require(k.fx > 0 && k.fy > 0 && std::isfinite(k.fx + k.fy + k.cx + k.cy), "a camera has rays");
    require(camera->unit() > 0, "an image has a unit");
    DepthFrame frame;
    const CloudShares shares = camera->take(view, frame);
    require(
        frame.pixels.size() == static_cast<std::size_t>(width) * static_cast<std::size_t>(height),
        "an image has the pixels of its size");
    require(shares.outside + shares.hidden + shares.merged <= shares.points,
            "no point counts twice");
  }
}

void read_file(std::string_view bytes) {
  static ScratchFile file(".cloud");
  const auto points = load_points(file.write(bytes));
  if (points) see(points->cloud);
  if (!points) require(points.error().message.size() > 10, "an error has a message");
}

CloudPoints small_cloud(bool is_image) {
  CloudPoints cloud{12, 8, {}, {}};
  for (int i = 0; i < 12 * 8; ++i) {
    const float z = 1 + 0.001f * static_cast<float>(i);
    cloud.points.push_back({z * (static_cast<float>(i % 12) - 5.5f) / 10,
                            z * (static_cast<float>(i / 12) - 3.5f) / (is_image ? 10 : z * z), z});
  }
  cloud.points[17] = {std::nanf(""), 0, 0};
  return cloud;
}

}  // namespace

std::vector<std::string> seeds() {
  std::vector<std::string> all;
  for (const bool is_image : {true, false}) {
    for (const test::CloudLayout& layout : test::CloudLayout::three()) {
      all.push_back(kMessage + test::cloud_message(small_cloud(is_image).view(), layout));
    }
  }
  const test::CloudLayout with_normals{
      {{"x", 0}, {"y", 4}, {"z", 8}, {"normal_x", 0}, {"normal_y", 4}, {"normal_z", 8}}, 12};
  all.push_back(kMessage + test::cloud_message(small_cloud(false).view(), with_normals));
  const test::CloudLayout counts{{{"x", 0, 3}, {"y", 2, 3}, {"z", 4, 3}}, 6, 0, false, 0.001};
  all.push_back(kMessage + test::cloud_message(small_cloud(true).view(), counts));
  all.push_back(kFile +
                std::string("VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
                            "WIDTH 2\nHEIGHT 2\nVIEWPOINT 0 0 1 1 0 0 0\nPOINTS 4\n"
                            "DATA ascii\n0 0 1\n0 1 1\n1 0 1\nnan nan nan\n"));
  all.push_back(kFile + std::string("ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\n"
                                    "property double y\nproperty float z\nend_header\n"
                                    "0 0 1\n0.1 0 1\n"));
  return all;
}

}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  using namespace palpate::fuzz;
  if (size == 0) return 0;
  const std::string_view bytes = text_of(data + 1, size - 1);
  CloudPoints points;
  if (data[0] == kMessage && read_point_cloud(bytes, 1, {0, 0, 1}, points)) see(points);
  if (data[0] == kFile) read_file(bytes);
  return 0;
}
