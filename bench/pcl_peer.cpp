// The best off-the-shelf answer to "which points are in which sphere" without a structure built per
// frame: PCL's OrganizedNeighbor, one radius search per sphere.
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/search/organized.h>
#include <pcl/search/impl/organized.hpp>

#include "bench/contact_setup.h"
#include "bench/latency.h"

namespace palpate::bench {
namespace {

void pcl_organized_neighbor(benchmark::State& state) {
  const Tool& tool = cube_tool(static_cast<int>(state.range(0)));
  const std::vector<Pose> poses = random_poses(static_cast<double>(state.range(1)) / 100);
  const PointCloud& wall = bumpy_wall();
  pcl::PointCloud<pcl::PointXYZ>::Ptr cloud(new pcl::PointCloud<pcl::PointXYZ>(
      static_cast<std::uint32_t>(wall.width()), static_cast<std::uint32_t>(wall.height())));
  for (std::size_t i = 0; i < wall.size(); ++i) {
    const Vec3f p = wall.point(i);
    (*cloud)[i] = pcl::PointXYZ(p.x, p.y, p.z);
  }
  pcl::search::OrganizedNeighbor<pcl::PointXYZ> search;
  search.setInputCloud(cloud);
  std::vector<int> indices;
  std::vector<float> distances;
  std::size_t i = 0;
  double num_colliding = 0;
  {
    Latency latency(state);
    for (auto _ : state) {
      const Pose& X_WT = poses[i % poses.size()];
      int num = 0;
      latency.time([&] {
        const Mat3d R = rotation_matrix(X_WT.rotation);
        for (const Sphere& s : tool.spheres()) {
          const Vec3d c = R * to_double(s.centre) + X_WT.translation;
          const pcl::PointXYZ centre(static_cast<float>(c.x), static_cast<float>(c.y),
                                     static_cast<float>(c.z));
          num += search.radiusSearch(centre, static_cast<double>(s.radius), indices, distances) > 0;
        }
      });
      if (i < poses.size()) num_colliding += num;
      ++i;
    }
  }
  state.counters["boundary"] = num_colliding / static_cast<double>(std::min(i, poses.size()));
}

BENCHMARK(pcl_organized_neighbor)
    ->ArgNames({"spheres", "depth"})
    ->ArgsProduct({{1000, 5000, 17000}, {10, 50, 100}})
    ->UseManualTime()
    ->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace palpate::bench
