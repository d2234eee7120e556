// The same work by OpenCV (PALPATE_PEERS): rgbd::RgbdNormals and bilateralFilter.
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/rgbd.hpp>

#include "bench/latency.h"
#include "bench/wall_frame.h"
#include "palpate/cloud/surface_estimator.h"

namespace palpate::bench {
namespace {

// Normals from 3-D points, as the library wants them. Compare with our `normals`; `filtered` is by
// our filter.
void opencv_normals(benchmark::State& state) {
  const WallFrame wall(640, 480);
  const Intrinsics& k = wall.intrinsics;
  SurfaceOptions options;
  options.filter.enabled = state.range(0) != 0;
  ThreadPool pool(1);
  SurfaceEstimator estimator =
      SurfaceEstimator::create(wall.width, wall.height, k, options).value();
  estimator.update(wall.depth, pool);
  cv::setNumThreads(static_cast<int>(state.range(1)));
  cv::Mat points(wall.height, wall.width, CV_32FC3), normals;
  for (int v = 0; v < wall.height; ++v) {
    for (int u = 0; u < wall.width; ++u) {
      const double z = estimator.depth()[static_cast<std::size_t>(v * wall.width + u)];
      points.at<cv::Vec3f>(v, u) = {static_cast<float>((u - k.cx) * z / k.fx),
                                    static_cast<float>((v - k.cy) * z / k.fy),
                                    static_cast<float>(z)};
    }
  }
  const cv::Matx33f camera(static_cast<float>(k.fx), 0, static_cast<float>(k.cx), 0,
                           static_cast<float>(k.fy), static_cast<float>(k.cy), 0, 0, 1);
  const int window = 7;
  cv::rgbd::RgbdNormals peer(wall.height, wall.width, CV_32F, camera, window,
                             cv::rgbd::RgbdNormals::RGBD_NORMALS_METHOD_FALS);
  peer(points, normals);  // the first call fills tables
  {
    Latency latency(state);
    for (auto _ : state) latency.time([&] { peer(points, normals); });
  }
  MeanAngle error;
  for (int v = 0; v < wall.height; ++v) {
    for (int u = 0; u < wall.width; ++u) {
      const cv::Vec3f n = normals.at<cv::Vec3f>(v, u);
      error.add({n[0], n[1], n[2]});
    }
  }
  state.counters["mean_deg"] = error.degrees();
  state.counters["valid_percent"] = 100.0 * error.num() / (wall.width * wall.height);
}

BENCHMARK(opencv_normals)
    ->ArgNames({"filtered", "threads"})
    ->ArgsProduct({{0, 1}, {1, 2}})
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

// The same 5x5 window, but one similarity width for all depths and no notion of invalid pixels.
void opencv_bilateral(benchmark::State& state) {
  const WallFrame wall(640, 480);
  cv::setNumThreads(static_cast<int>(state.range(0)));
  cv::Mat depth(wall.height, wall.width, CV_32F), filtered;
  std::copy(wall.depth.begin(), wall.depth.end(), depth.begin<float>());
  Latency latency(state);
  for (auto _ : state) latency.time([&] { cv::bilateralFilter(depth, filtered, 5, 0.01, 1.5); });
}

BENCHMARK(opencv_bilateral)
    ->ArgName("threads")
    ->Arg(1)
    ->Arg(2)
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace palpate::bench
