// OpenCV: rgbd::RgbdNormals and bilateralFilter.
#include <algorithm>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/rgbd.hpp>

#include "bench/peers.h"

namespace palpate::bench {
namespace {

cv::Matx33f camera_matrix(const Intrinsics& k) {
  return {static_cast<float>(k.fx),
          0,
          static_cast<float>(k.cx),
          0,
          static_cast<float>(k.fy),
          static_cast<float>(k.cy),
          0,
          0,
          1};
}

class Fals : public NormalsPeer {
 public:
  Fals(const PointCloud& cloud, const Intrinsics& intrinsics)
      : points_(cloud.height(), cloud.width(), CV_32FC3),
        camera_(camera_matrix(intrinsics)),
        estimation_(cloud.height(), cloud.width(), CV_32F, camera_, 7,
                    cv::rgbd::RgbdNormals::RGBD_NORMALS_METHOD_FALS) {
    cv::setNumThreads(1);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Vec3f p = cloud.point(i);
      points_.at<cv::Vec3f>(static_cast<int>(i)) = {p.x, p.y, p.z};
    }
  }

  std::string name() const override { return "OpenCV FALS"; }
  void run() override { estimation_(points_, normals_); }
  Vec3d normal(std::size_t i) const override {
    const cv::Vec3f& n = normals_.at<cv::Vec3f>(static_cast<int>(i));
    return to_double(Vec3f{n[0], n[1], n[2]});
  }

 private:
  cv::Mat points_, normals_;
  cv::Matx33f camera_;  // the estimation reads it later, without a copy
  cv::rgbd::RgbdNormals estimation_;
};

class Bilateral : public FilterPeer {
 public:
  Bilateral(std::span<const float> depth, int width, int height) : depth_(height, width, CV_32F) {
    cv::setNumThreads(1);
    std::copy(depth.begin(), depth.end(), depth_.begin<float>());
  }

  std::string name() const override { return "OpenCV bilateral"; }
  void run() override { cv::bilateralFilter(depth_, filtered_, 5, 0.01, 1.5); }
  float depth(std::size_t i) const override { return filtered_.at<float>(static_cast<int>(i)); }

 private:
  cv::Mat depth_, filtered_;
};

}  // namespace

std::unique_ptr<NormalsPeer> opencv_normals(const PointCloud& cloud, const Intrinsics& intrinsics) {
  return std::make_unique<Fals>(cloud, intrinsics);
}

std::unique_ptr<FilterPeer> opencv_bilateral(std::span<const float> depth, int width, int height) {
  return std::make_unique<Bilateral>(depth, width, height);
}

}  // namespace palpate::bench
