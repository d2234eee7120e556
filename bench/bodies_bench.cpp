// Body against body: time of one measurement of two cubes, by method, number of spheres and
// penetration depth; and of a depth field at the same poses, for a comparison within
// one run.
#include "palpate/contact/body_contact.h"

#include "bench/contact_setup.h"
#include "bench/latency.h"
#include "palpate/field/depth_field.h"

namespace palpate::bench {
namespace {

double depth_of(const benchmark::State& state) { return static_cast<double>(state.range(1)) / 100; }

/// Times measure(pose), which returns a count, for one pose after the other.
template <class Measure>
void time_poses(benchmark::State& state, const std::vector<Pose>& poses, const char* counted,
                const Measure& measure) {
  std::size_t i = 0;
  double sum = 0;
  {
    Latency latency(state);
    for (auto _ : state) {
      double count = 0;
      latency.time([&] { count = measure(poses[i % poses.size()]); });
      if (i < poses.size()) sum += count;
      ++i;
    }
  }
  state.counters[counted] = sum / static_cast<double>(std::min(i, poses.size()));
  state.SetLabel(isa_name(best_isa()));
}

void pairs(benchmark::State& state, const Tool& other, BodyMethod method, bool wants_stiffness) {
  const auto contact =
      make_body_pair_query(Place::cpu(), cube_tool(static_cast<int>(state.range(0))), other,
                           {.method = method})
          .value();
  time_poses(state, overlapping_poses(depth_of(state)), "pairs", [&](const Pose& X_WA) {
    BodyPenetration result = contact->measure(X_WA, {}, wants_stiffness);
    benchmark::DoNotOptimize(result);
    return static_cast<double>(result.num_pairs);
  });
}

/// Two equal cubes: both are sampled.
void bodies(benchmark::State& state) {
  pairs(state, cube_tool(static_cast<int>(state.range(0))), BodyMethod::field, false);
}
void bodies_stiffness(benchmark::State& state) {
  pairs(state, cube_tool(static_cast<int>(state.range(0))), BodyMethod::field, true);
}
void bodies_spheres(benchmark::State& state) {
  pairs(state, cube_tool(static_cast<int>(state.range(0))), BodyMethod::spheres, false);
}
/// In a cube of a hundred spheres, too coarse to be sampled.
void bodies_coarse(benchmark::State& state) {
  pairs(state, cube_tool(100), BodyMethod::field, false);
}
/// In a depth field, as deep as in the face of the other cube.
void depth_field(benchmark::State& state) {
  const Tool& tool = cube_tool(static_cast<int>(state.range(0)));
  ThreadPool pool(1);
  DepthField field = std::move(DepthField::create(640, 480)).value();
  field.update(bumpy_wall().view(), pool);
  const auto contact = make_contact_query(Place::cpu(), tool, FieldMethod{}).value();
  const SurfaceView surface{{}, field.view()};
  // The other cube's face points along +z; here the wall's points along -z.
  std::vector<Pose> poses = overlapping_poses(depth_of(state));
  for (Pose& X_WT : poses) {
    X_WT.translation.z = kWallDepth + kToolSize / 2 - X_WT.translation.z;
  }
  time_poses(state, poses, "touching", [&](const Pose& X_WT) {
    Penetration result = contact->measure(surface, X_WT).penetration;
    benchmark::DoNotOptimize(result);
    return static_cast<double>(result.num_boundary_spheres + result.num_inside_spheres);
  });
}

void all_sizes(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgNames({"spheres", "depth"})
      ->ArgsProduct({{1000, 5000, 17000, 100000}, {1, 10, 50, 100}})
      ->UseManualTime()
      ->Unit(benchmark::kMicrosecond);
}
BENCHMARK(bodies)->Apply(all_sizes);
BENCHMARK(bodies_stiffness)->Apply(all_sizes);
BENCHMARK(bodies_coarse)->Apply(all_sizes);
BENCHMARK(depth_field)->Apply(all_sizes);
BENCHMARK(bodies_spheres)->Apply(all_sizes);

}  // namespace
}  // namespace palpate::bench
