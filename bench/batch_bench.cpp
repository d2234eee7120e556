// Many poses in one call on the CPU: rate of evaluated spheres.
//   bench_batch --benchmark_filter=batch
#include <benchmark/benchmark.h>

#include "bench/batch_setup.h"
#include "palpate/field/depth_field.h"

namespace palpate::bench {
namespace {

/// Evaluations count only the spheres of the tool, independent of the scene.
void batch(benchmark::State& state) {
  const int num_spheres = static_cast<int>(state.range(0)), num = static_cast<int>(state.range(1));
  const auto where = static_cast<Where>(state.range(2));
  const bool with_stiffness = state.range(3) != 0;
  ThreadPool pool(static_cast<int>(state.range(4)));
  const Tool& tool = finger_tool(num_spheres);
  DepthField field = std::move(DepthField::create(640, 480)).value();
  field.update(bumpy_wall().view(), pool);
  const SurfaceView surface{{}, field.view()};
  const auto batches =
      make_batch_query(Place::cpu(), ToolIndex::create(tool), FieldMethod{}, {best_isa(), &pool})
          .value();
  const std::vector<Pose> poses = finger_poses(num, where);
  const auto size = static_cast<std::size_t>(num);
  std::vector<double> volume(size), potential(size), force(3 * size), torque(3 * size),
      stiffness(with_stiffness ? 36 * size : 0);
  const BatchAnswers answers{volume.data(), potential.data(), force.data(), torque.data(),
                             with_stiffness ? stiffness.data() : nullptr};
  for (auto _ : state) {
    if (!batches->measure(surface, {poses, {}, {}}, answers)) state.SkipWithError("no answer");
  }
  double num_touching = 0;
  for (const double v : volume) num_touching += v > 0;
  state.counters["touching"] = num_touching / num;
  state.counters["evaluations"] = benchmark::Counter(static_cast<double>(num) * num_spheres,
                                                     benchmark::Counter::kIsIterationInvariantRate);
  state.SetLabel(isa_name(best_isa()));
}

constexpr int kView = static_cast<int>(Where::view), kSurface = static_cast<int>(Where::surface);

BENCHMARK(batch)
    ->ArgNames({"spheres", "poses", "where", "stiffness", "threads"})
    ->ArgsProduct({{100}, {1000000}, {kView, kSurface}, {0}, {1, 0}})
    ->ArgsProduct({{100}, {100000}, {kView, kSurface}, {1}, {0}})
    ->ArgsProduct({{1000, 5000}, {16384}, {kView, kSurface}, {0, 1}, {0}})
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace palpate::bench
