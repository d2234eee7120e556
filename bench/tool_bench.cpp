// Preparation time of a tool: its graph, its tree, its coarser versions.
//   bench_tool --benchmark_filter=leaf_graph
#include "palpate/tool/tool.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <iterator>
#include <span>
#include <utility>
#include <vector>

#include "bench/contact_setup.h"

namespace palpate::bench {
namespace {

bool touches(const Sphere& ball, const Vec3d& p, const Vec3d& q) {
  const Vec3d center = to_double(ball.center), along = q - p;
  const double t = std::clamp(dot(center - p, along) / dot(along, along), 0.0, 1.0);
  return norm(p + along * t - center) <= static_cast<double>(ball.radius);
}

/// True if the edge between the centers of a and b runs through a third sphere.
bool is_pierced(std::span<const IstNode> nodes, std::span<const Sphere> spheres, int a, int b,
                std::int32_t node = 0) {
  const IstNode& n = nodes[static_cast<std::size_t>(node)];
  if (n.sphere_id == a || n.sphere_id == b) return false;
  if (!touches(n.bound, to_double(spheres[static_cast<std::size_t>(a)].center),
               to_double(spheres[static_cast<std::size_t>(b)].center)))
    return false;
  bool pierced = n.num_children == 0;
  for (int c = 0; c < n.num_children && !pierced; ++c)
    pierced = is_pierced(nodes, spheres, a, b, n.first_child + c);
  return pierced;
}

void leaf_graph(benchmark::State& state) {
  const Tool& tool = cube_tool(static_cast<int>(state.range(0)));
  const std::span<const Sphere> spheres = tool.spheres();
  const auto rule = static_cast<GapRule>(state.range(1));
  LeafGraph graph;
  for (auto _ : state) graph = LeafGraph(spheres, rule);

  const std::vector<std::pair<int, int>> edges = graph.edges();
  const auto num_pierced = std::count_if(edges.begin(), edges.end(), [&](const auto& edge) {
    return is_pierced(tool.tree().nodes(), spheres, edge.first, edge.second);
  });
  // Edges of the graph of the first half of the spheres that the graph of all lacks.
  const auto half_edges = LeafGraph(spheres.first(spheres.size() / 2), rule).edges();
  std::vector<std::pair<int, int>> lost;
  std::set_difference(half_edges.begin(), half_edges.end(), edges.begin(), edges.end(),
                      std::back_inserter(lost));
  const auto percent = [](auto part, std::size_t whole) {
    return 100 * static_cast<double>(part) / static_cast<double>(whole);
  };
  state.counters["edges"] = graph.num_edges();
  state.counters["bridges"] = graph.num_bridges();
  state.counters["pierced_percent"] = percent(num_pierced, edges.size());
  state.counters["lost_percent"] = percent(lost.size(), half_edges.size());
  state.SetLabel(rule == GapRule::absolute ? "absolute" : "relative");
}

BENCHMARK(leaf_graph)
    ->ArgNames({"spheres", "rule"})
    ->ArgsProduct({{1000, 17000, 100000},
                   {static_cast<int>(GapRule::absolute), static_cast<int>(GapRule::relative)}})
    ->Unit(benchmark::kMillisecond);

void inner_sphere_tree(benchmark::State& state) {
  const std::span<const Sphere> spheres = cube_tool(static_cast<int>(state.range(0))).spheres();
  for (auto _ : state) benchmark::DoNotOptimize(InnerSphereTree(spheres));
}

BENCHMARK(inner_sphere_tree)
    ->ArgName("spheres")
    ->Arg(17000)
    ->Arg(100000)
    ->Unit(benchmark::kMillisecond);

void prefix(benchmark::State& state) {
  const Tool& tool = cube_tool(100000);
  const auto num_spheres = static_cast<int>(state.range(0));
  for (auto _ : state) benchmark::DoNotOptimize(tool.prefix(num_spheres));
}

BENCHMARK(prefix)
    ->ArgName("spheres")
    ->Arg(1000)
    ->Arg(17000)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

}  // namespace
}  // namespace palpate::bench
