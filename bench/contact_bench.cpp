// Contact queries: time of one call, by method, number of spheres and depth.
#include "palpate/contact/contact_query.h"

#include "bench/contact_setup.h"
#include "bench/latency.h"
#include "src/contact/image_window.h"
#include "src/contact/point_scan.h"
#include "src/contact/sphere_grid.h"

namespace palpate::bench {
namespace {

enum Method { kWeighted, kSimplified, kGraph, kGraphCap };

ContactOptions options_of(int method) {
  switch (method) {
    case kWeighted: return {InsideMethod::weighted, Priority::distance, InsideVolume::full};
    case kGraph: return {InsideMethod::graph, Priority::distance, InsideVolume::full};
    case kGraphCap: return {InsideMethod::graph, Priority::distance, InsideVolume::cap};
    default: return {InsideMethod::simplified, Priority::distance, InsideVolume::full};
  }
}

// The boundary stage alone: which points are in which sphere, with their sums per sphere.
void boundary(benchmark::State& state) {
  const Tool& tool = cube_tool(static_cast<int>(state.range(0)));
  const std::vector<Pose> poses = random_poses(static_cast<double>(state.range(1)) / 100);
  const SphereGrid grid(tool.spheres());
  std::vector<PointSums> sums(tool.spheres().size());
  std::vector<std::uint8_t> touched((sums.size() + 7) / 8 * 8);
  const double half = kToolSize / 2;
  PointScan scan;
  scan.cloud = bumpy_wall().view();
  scan.grid = grid.view();
  scan.spheres = tool.spheres().data();
  const ScanPoints scan_points = best_isa() == Isa::baseline ? isa_baseline::scan_points
#if defined(__x86_64__)
                                 : best_isa() == Isa::avx2 ? isa_avx2::scan_points
                                                           : isa_avx512::scan_points;
#else
                                                             : nullptr;
#endif
  std::size_t i = 0;
  double num_boundary = 0;
  {
    Latency latency(state);
    for (auto _ : state) {
      const Pose& X_WT = poses[i % poses.size()];
      int num_touched = 0;
      latency.time([&] {
        const ImageWindow window =
            image_window(scan.cloud, {{-half, -half, -half}, {half, half, half}}, X_WT);
        scan.R_TW = rotation_matrix(conjugate(X_WT.rotation));
        scan.translation_W = X_WT.translation;
        scan_points(scan, window.row_begin, window.row_end, window.column_begin, window.column_end,
                    sums.data(), touched.data());
        // Ready for the next pose.
        take_touched(touched, [&](std::size_t id) {
          sums[id] = PointSums{};
          ++num_touched;
        });
      });
      if (i < poses.size()) num_boundary += num_touched;
      ++i;
    }
  }
  state.counters["boundary"] = num_boundary / static_cast<double>(std::min(i, poses.size()));
  state.SetLabel(isa_name(best_isa()));
}

BENCHMARK(boundary)
    ->ArgNames({"spheres", "depth"})
    ->ArgsProduct({{1000, 5000, 17000}, {10, 50, 100}})
    ->UseManualTime()
    ->Unit(benchmark::kMicrosecond);

void query(benchmark::State& state) {
  const Tool& tool = cube_tool(static_cast<int>(state.range(1)));
  const std::vector<Pose> poses = random_poses(static_cast<double>(state.range(2)) / 100);
  ThreadPool pool(static_cast<int>(state.range(3)));
  const auto contact =
      std::move(make_contact_query(Backend::cpu, tool, {best_isa(), &pool})).value();
  contact->set_cloud(bumpy_wall().view());
  const ContactOptions options = options_of(static_cast<int>(state.range(0)));
  std::size_t i = 0;
  double num_boundary = 0, num_inside = 0;
  {
    Latency latency(state);
    for (auto _ : state) {
      Penetration result;
      latency.time([&] { result = contact->query(poses[i % poses.size()], options); });
      benchmark::DoNotOptimize(result);
      if (i < poses.size()) num_boundary += result.num_boundary_spheres;
      if (i < poses.size()) num_inside += result.num_inside_spheres;
      ++i;
    }
  }
  const double num_poses = static_cast<double>(std::min(i, poses.size()));
  state.counters["boundary"] = num_boundary / num_poses;
  state.counters["inside"] = num_inside / num_poses;
  state.SetLabel(isa_name(best_isa()));
}

BENCHMARK(query)
    ->ArgNames({"method", "spheres", "depth", "threads"})
    ->ArgsProduct({{kSimplified, kGraph}, {1000, 5000, 17000}, {10, 50, 100}, {1}})
    ->ArgsProduct({{kWeighted}, {1000, 5000}, {10, 50, 100}, {1}})
    ->ArgsProduct({{kSimplified, kGraph}, {17000}, {50}, {2}})
    ->UseManualTime()
    ->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace palpate::bench
