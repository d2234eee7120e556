// Contact queries: time of one call, by method, number of spheres and depth.
#include "palpate/contact/contact.h"

#include "bench/contact_setup.h"
#include "bench/latency.h"
#include "eval/studies/boundary_stage.h"

namespace palpate::bench {
namespace {

enum Method { kWeighted, kSimplified, kGraph, kGraphCap };

ContactOptions options_of(int method) {
  switch (method) {
    case kWeighted: return {MethodKind::weighted, Priority::distance, InsideVolume::full};
    case kGraph: return {MethodKind::graph, Priority::distance, InsideVolume::full};
    case kGraphCap: return {MethodKind::graph, Priority::distance, InsideVolume::cap};
    default: return {MethodKind::simplified, Priority::distance, InsideVolume::full};
  }
}

void boundary(benchmark::State& state) {
  const Tool& tool = cube_tool(static_cast<int>(state.range(0)));
  const std::vector<Pose> poses = random_poses(static_cast<double>(state.range(1)) / 100);
  eval::BoundaryStage stage(tool, bumpy_wall().view());
  std::size_t i = 0;
  double num_boundary = 0;
  {
    Latency latency(state);
    for (auto _ : state) {
      const Pose& X_WT = poses[i % poses.size()];
      int num_touched = 0;
      latency.time([&] { stage.run(X_WT, [&](std::size_t, const PointSums&) { ++num_touched; }); });
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
  const ContactMethod method = contact_method(options_of(static_cast<int>(state.range(0)))).value();
  const auto contact = make_contact_query(Place::cpu(), tool, method, {best_isa(), &pool}).value();
  const SurfaceView surface{bumpy_wall().view(), {}};
  std::size_t i = 0;
  double num_boundary = 0, num_inside = 0;
  {
    Latency latency(state);
    for (auto _ : state) {
      Penetration result;
      latency.time(
          [&] { result = contact->measure(surface, poses[i % poses.size()]).penetration; });
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
