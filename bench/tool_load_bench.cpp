// Loading a tool: delay between the start of a program and its first query.
//   bench_tool --benchmark_filter=load_tool
#include <benchmark/benchmark.h>

#include <filesystem>
#include <string>

#include "bench/contact_setup.h"
#include "palpate/io/files.h"

namespace palpate::bench {
namespace {

void load_tool(benchmark::State& state) {
  const auto num_spheres = static_cast<int>(state.range(0));
  const std::filesystem::path path = std::filesystem::temp_directory_path() /
                                     ("bench_tool_" + std::to_string(num_spheres) + ".palp");
  if (!save_tool(cube_tool(num_spheres), path)) {
    state.SkipWithError("cannot write to the folder for temporary files");
    return;
  }
  for (auto _ : state) benchmark::DoNotOptimize(palpate::load_tool(path));
  state.counters["bytes"] = static_cast<double>(std::filesystem::file_size(path));
  std::filesystem::remove(path);
}

BENCHMARK(load_tool)->ArgName("spheres")->Arg(1000)->Arg(17000)->Arg(100000)->Unit(
    benchmark::kMillisecond);

}  // namespace
}  // namespace palpate::bench
