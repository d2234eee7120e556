// Time and fill of the sphere packer. The bunny is read from
// $PALPATE_DATA/meshes_good/bunny_3k.off.
//   bench_packing --benchmark_filter=bunny
#include <benchmark/benchmark.h>

#include <cstdlib>
#include <fstream>
#include <string>

#include "palpate/mesh/shapes.h"
#include "palpate/packing/packer.h"

namespace palpate {
namespace {

TriangleMesh read_off(const std::string& path) {
  std::ifstream file(path);
  std::string magic;
  std::size_t num_vertices = 0, num_faces = 0, ignored = 0;
  file >> magic >> num_vertices >> num_faces >> ignored;
  TriangleMesh mesh;
  mesh.vertices.resize(num_vertices);
  mesh.triangles.resize(num_faces);
  for (Vec3d& v : mesh.vertices) file >> v.x >> v.y >> v.z;
  for (auto& t : mesh.triangles) file >> ignored >> t[0] >> t[1] >> t[2];
  return mesh;
}

void pack(benchmark::State& state, const TriangleMesh& mesh) {
  if (mesh.triangles.empty()) {
    state.SkipWithError("set PALPATE_DATA to the folder of real data");
    return;
  }
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

void pack_cube(benchmark::State& state) { pack(state, make_box({0.1, 0.1, 0.1})); }
BENCHMARK(pack_cube)->Apply(settings);

void pack_bunny(benchmark::State& state) {
  const char* folder = std::getenv("PALPATE_DATA");
  pack(state,
       folder ? read_off(std::string(folder) + "/meshes_good/bunny_3k.off") : TriangleMesh{});
}
BENCHMARK(pack_bunny)->Apply(settings);

// Where every facet is about equally far from the axis.
void pack_round_cylinder(benchmark::State& state) { pack(state, make_cylinder(0.02, 0.1, 8192)); }
BENCHMARK(pack_round_cylinder)->Args({5000, 0})->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace palpate
