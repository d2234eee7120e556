// Surface estimation: time of each stage and of a whole update, by image size and threads.
#include "palpate/cloud/surface_estimator.h"

#include <string>

#include "bench/latency.h"
#include "bench/wall_frame.h"
#include "src/cloud/surface/surface_stages.h"

namespace palpate::bench {
namespace {

enum Stage { kRead, kFilter, kNormals, kDepthChange };

constexpr const char* kStageNames[] = {"read", "filter", "normals", "depth change"};

void stage(benchmark::State& state) {
  const WallFrame wall(static_cast<int>(state.range(1)), static_cast<int>(state.range(2)));
  ThreadPool pool(static_cast<int>(state.range(3)));
  SurfaceStages stages(wall.width, wall.height, wall.intrinsics, {}, best_isa());
  stages.read(wall.image(), pool);
  stages.filter(pool);
  stages.estimate_normals(pool);
  Latency latency(state);
  for (auto _ : state) {
    latency.time([&] {
      switch (state.range(0)) {
        case kRead: stages.read(wall.image(), pool); break;
        case kFilter: stages.filter(pool); break;
        case kNormals: stages.estimate_normals(pool); break;
        default: stages.find_depth_change(pool); break;
      }
    });
  }
  state.SetLabel(std::string(kStageNames[state.range(0)]) + ", " + isa_name(best_isa()));
}

BENCHMARK(stage)
    ->ArgNames({"stage", "width", "height", "threads"})
    ->ArgsProduct({{kRead, kFilter, kNormals, kDepthChange}, {640}, {480}, {1, 2}})
    ->ArgsProduct({{kRead, kFilter, kNormals, kDepthChange}, {1920}, {1080}, {1, 2}})
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

// Normals alone with their error, by fit, of raw noise and of filtered depth: comparable with other
// libraries.
void normals(benchmark::State& state) {
  const WallFrame wall(640, 480);
  SurfaceOptions options;
  options.normals.fit = state.range(0) == 0 ? PlaneFit::along_ray : PlaneFit::principal;
  options.filter.enabled = state.range(1) != 0;
  ThreadPool pool(static_cast<int>(state.range(2)));
  SurfaceStages stages(wall.width, wall.height, wall.intrinsics, options, best_isa());
  stages.read(wall.image(), pool);
  stages.filter(pool);
  {
    Latency latency(state);
    for (auto _ : state) latency.time([&] { stages.estimate_normals(pool); });
  }
  MeanAngle error;
  for (std::size_t i = 0; i < stages.cloud().size(); ++i) {
    error.add(to_double(stages.cloud().normal(i)));
  }
  state.counters["mean_deg"] = error.degrees();
  state.counters["valid_percent"] = 100.0 * error.num() / static_cast<double>(stages.num_pixels());
  state.SetLabel(state.range(0) == 0 ? "along ray" : "principal");
}

BENCHMARK(normals)
    ->ArgNames({"fit", "filtered", "threads"})
    ->ArgsProduct({{0, 1}, {0, 1}, {1, 2}})
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

// A whole update. A wall is the easy case; with edges there are pillars and holes everywhere.
void update(benchmark::State& state) {
  WallFrame wall(static_cast<int>(state.range(0)), static_cast<int>(state.range(1)));
  if (state.range(3) != 0) wall.add_edges_and_holes();
  ThreadPool pool(static_cast<int>(state.range(2)));
  SurfaceEstimator estimator =
      SurfaceEstimator::create(wall.width, wall.height, wall.intrinsics).value();
  Latency latency(state);
  for (auto _ : state) {
    latency.time([&] { benchmark::DoNotOptimize(estimator.update(wall.depth, pool)); });
  }
  state.SetLabel(isa_name(best_isa()));
}

BENCHMARK(update)
    ->ArgNames({"width", "height", "threads", "edges"})
    ->ArgsProduct({{640}, {480}, {1, 2}, {0, 1}})
    ->ArgsProduct({{1920}, {1080}, {1, 2}, {0, 1}})
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace palpate::bench
