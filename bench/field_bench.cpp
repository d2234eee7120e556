// The field method: computing the field of a frame, and querying it.
//   bench_field --benchmark_filter=field_query
#include "palpate/field/depth_field.h"

#include "bench/contact_setup.h"
#include "bench/latency.h"
#include "palpate/contact/contact.h"

namespace palpate::bench {
namespace {

void field_update(benchmark::State& state) {
  ThreadPool pool(static_cast<int>(state.range(0)));
  DepthField field = std::move(DepthField::create(640, 480)).value();
  Latency latency(state);
  for (auto _ : state) {
    latency.time([&] { field.update(bumpy_wall().view(), pool); });
  }
}

BENCHMARK(field_update)
    ->ArgName("threads")
    ->Arg(1)
    ->Arg(2)
    ->UseManualTime()
    ->Unit(benchmark::kMicrosecond);

void field_query(benchmark::State& state) {
  const Tool& tool = cube_tool(static_cast<int>(state.range(0)));
  const std::vector<Pose> poses = random_poses(static_cast<double>(state.range(1)) / 100);
  ThreadPool pool(static_cast<int>(state.range(2)));
  DepthField field = std::move(DepthField::create(640, 480)).value();
  field.update(bumpy_wall().view(), pool);
  const auto contact =
      make_contact_query(Place::cpu(), tool, FieldMethod{}, {best_isa(), &pool}).value();
  const SurfaceView surface{{}, field.view()};
  std::size_t i = 0;
  double num_inside = 0;
  {
    Latency latency(state);
    for (auto _ : state) {
      Penetration result;
      latency.time(
          [&] { result = contact->measure(surface, poses[i % poses.size()]).penetration; });
      benchmark::DoNotOptimize(result);
      if (i < poses.size()) num_inside += result.num_inside_spheres;
      ++i;
    }
  }
  state.counters["inside"] = num_inside / static_cast<double>(std::min(i, poses.size()));
  state.SetLabel(isa_name(best_isa()));
}

BENCHMARK(field_query)
    ->ArgNames({"spheres", "depth", "threads"})
    ->ArgsProduct({{1000, 5000, 17000, 100000}, {10, 50, 100}, {1}})
    ->ArgsProduct({{17000, 100000}, {50}, {2}})
    ->UseManualTime()
    ->Unit(benchmark::kMicrosecond);

/// The query of the haptic loop: blended between two frames, and with stiffness.
void field_live(benchmark::State& state) {
  const Tool& tool = cube_tool(static_cast<int>(state.range(0)));
  const std::vector<Pose> poses = random_poses(static_cast<double>(state.range(1)) / 100);
  const double alpha = state.range(2) == 2 ? 0.5 : 1;
  const ContactWants wants{.stiffness = state.range(3) != 0};
  ThreadPool pool(static_cast<int>(state.range(4)));
  DepthField from = std::move(DepthField::create(640, 480)).value();
  DepthField to = std::move(DepthField::create(640, 480)).value();
  from.update(bumpy_wall().view(), pool);
  to.update(bumpy_wall().view(), pool);
  const auto contact =
      make_contact_query(Place::cpu(), tool, FieldMethod{}, {best_isa(), &pool}).value();
  const SurfaceView old_surface{{}, from.view()}, new_surface{{}, to.view()};
  std::size_t i = 0;
  Latency latency(state);
  for (auto _ : state) {
    ContactResult result;
    latency.time([&] {
      result = contact->measure(old_surface, new_surface, alpha, poses[i++ % poses.size()], wants);
    });
    benchmark::DoNotOptimize(result);
  }
  state.SetLabel(isa_name(best_isa()));
}

BENCHMARK(field_live)
    ->ArgNames({"spheres", "depth", "frames", "stiffness", "threads"})
    ->ArgsProduct({{1000, 5000, 17000, 100000}, {10, 50, 100}, {1}, {1}, {1}})
    ->ArgsProduct({{1000, 5000, 17000, 100000}, {10, 50, 100}, {2}, {0, 1}, {1}})
    ->ArgsProduct({{17000, 100000}, {10}, {2}, {1}, {2}})
    ->UseManualTime()
    ->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace palpate::bench
