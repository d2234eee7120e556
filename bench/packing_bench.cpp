// Time and fill of the sphere packer, and the extra time for represented volumes. The bunny is
// read from $PALPATE_DATA/meshes_good/bunny_3k.off.
//   bench_packing --benchmark_filter=bunny
#include <benchmark/benchmark.h>
#include <sys/resource.h>

#include <cstdlib>
#include <string>

#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"
#include "tests/test_util/off_mesh.h"

namespace palpate {
namespace {

TriangleMesh cube() { return make_box({0.1, 0.1, 0.1}); }

TriangleMesh bunny() {
  const char* folder = std::getenv("PALPATE_DATA");
  return folder ? test::read_off(std::string(folder) + "/meshes_good/bunny_3k.off")
                : TriangleMesh{};
}

bool is_missing(const TriangleMesh& mesh, benchmark::State& state) {
  if (mesh.triangles.empty()) state.SkipWithError("set PALPATE_DATA to the folder of real data");
  return mesh.triangles.empty();
}

void pack(benchmark::State& state, const TriangleMesh& mesh) {
  if (is_missing(mesh, state)) return;
  PackOptions options;
  options.max_spheres = static_cast<int>(state.range(0));
  options.num_threads = static_cast<int>(state.range(1));
  double fill = 0, radius = 0;
  for (auto _ : state) {
    const SpherePacking packing = pack_spheres(mesh, options).value();
    fill = 0;
    for (const Sphere& s : packing.spheres) {
      fill += sphere_volume(static_cast<double>(s.radius)) / packing.mesh_volume;
    }
    radius = static_cast<double>(packing.spheres.back().radius);
  }
  state.counters["fill"] = fill;
  state.counters["last_radius"] = radius;
}

void settings(benchmark::internal::Benchmark* bench) {
  bench->ArgsProduct({{1000, 10000, 17000, 100000}, {1, 0}})
      ->ArgNames({"spheres", "threads"})
      ->Unit(benchmark::kMillisecond)
      ->MeasureProcessCPUTime()
      ->UseRealTime();
}

void pack_cube(benchmark::State& state) { pack(state, cube()); }
BENCHMARK(pack_cube)->Apply(settings);

void pack_bunny(benchmark::State& state) { pack(state, bunny()); }
BENCHMARK(pack_bunny)->Apply(settings);

// A million spheres: a single run, with the peak memory of the process.
void pack_bunny_million(benchmark::State& state) {
  pack(state, bunny());
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  state.counters["peak_gib"] = static_cast<double>(usage.ru_maxrss) / (1 << 20);
}
BENCHMARK(pack_bunny_million)
    ->Args({1000000, 0})
    ->ArgNames({"spheres", "threads"})
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

void volumes(benchmark::State& state, const TriangleMesh& mesh) {
  if (is_missing(mesh, state)) return;
  PackOptions options;
  options.max_spheres = static_cast<int>(state.range(0));
  const SpherePacking packing = pack_spheres(mesh, options).value();
  ThreadPool pool(static_cast<int>(state.range(1)));
  for (auto _ : state)
    benchmark::DoNotOptimize(represented_parts(mesh, packing.spheres, pool).value().volumes.data());
}

void volumes_cube(benchmark::State& state) { volumes(state, cube()); }
BENCHMARK(volumes_cube)->Apply(settings);

void volumes_bunny(benchmark::State& state) { volumes(state, bunny()); }
BENCHMARK(volumes_bunny)->Apply(settings);

// All facets are about equally far from the axis.
void pack_round_cylinder(benchmark::State& state) { pack(state, make_cylinder(0.02, 0.1, 8192)); }
BENCHMARK(pack_round_cylinder)->Args({5000, 0})->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace palpate
