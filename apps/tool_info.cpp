#include "apps/tool_info.h"

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>
#include <numeric>

#include "apps/terminal/terminal.h"

namespace palpate::apps {
namespace {

using Json = nlohmann::ordered_json;

Json to_json(const Vec3d& v) { return {v.x, v.y, v.z}; }

Json to_json(const Mat3d& m) {
  Json rows = Json::array();
  for (const auto& row : m.m) rows.push_back({row[0], row[1], row[2]});
  return rows;
}

struct RadiusRange {
  double smallest, largest;
};

RadiusRange radius_range(const Tool& tool) {
  const auto [low, high] =
      std::minmax_element(tool.spheres().begin(), tool.spheres().end(),
                          [](const Sphere& a, const Sphere& b) { return a.radius < b.radius; });
  return {low->radius, high->radius};
}

double represented_volume(const Tool& tool) {
  const auto volumes = tool.represented_volumes();
  return std::accumulate(volumes.begin(), volumes.end(), 0.0);
}

double fill(const Tool& tool) { return tool.sphere_mass().volume / tool.mesh_mass().volume; }

__attribute__((format(printf, 1, 2))) std::string text(const char* format, ...) {
  char buffer[256];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(buffer, sizeof buffer, format, arguments);
  va_end(arguments);
  return buffer;
}

}  // namespace

Json tool_info(const Tool& tool, const Standoff& standoff) {
  const MassProperties &spheres = tool.sphere_mass(), &mesh = tool.mesh_mass();
  const RadiusRange radius = radius_range(tool);
  const Bounds box = bounds(tool.mesh());
  const LeafGraph& graph = tool.graph();
  Json warnings = Json::array();
  if (const auto empty = empty_part(tool, standoff)) warnings.push_back(*empty);
  return {{"source", tool.source()},
          {"triangles", tool.mesh().triangles.size()},
          {"spheres", tool.spheres().size()},
          {"fill", fill(tool)},
          {"mesh_volume", mesh.volume},
          {"sphere_volume", spheres.volume},
          {"represented_volume", represented_volume(tool)},
          {"center_of_mass", to_json(spheres.center_of_mass)},
          {"inertia", to_json(spheres.inertia)},
          {"mesh_center_of_mass", to_json(mesh.center_of_mass)},
          {"mesh_inertia", to_json(mesh.inertia)},
          {"min_radius", radius.smallest},
          {"max_radius", radius.largest},
          {"standoff",
           {{"mean", standoff.mean},
            {"p95", standoff.p95},
            {"max", standoff.max},
            {"worst", to_json(standoff.worst)}}},
          {"bounds", {to_json(box.low), to_json(box.high)}},
          {"tree_nodes", tool.tree().nodes().size()},
          {"graph",
           {{"edges", graph.num_edges()},
            {"bridges", graph.num_bridges()},
            {"components_before_bridging", graph.num_components_before_bridging()}}},
          {"warnings", warnings}};
}

std::string describe(const Tool& tool, const Standoff& standoff) {
  const RadiusRange radius = radius_range(tool);
  const Bounds box = bounds(tool.mesh());
  const Vec3d size = (box.high - box.low) * 1000;
  const Vec3d center = tool.sphere_mass().center_of_mass * 1000;
  const LeafGraph& graph = tool.graph();
  const Vec3d worst = standoff.worst * 1000;
  return "source        " + tool.source() + "\n" +
         text("mesh          %zu triangles, %.4g x %.4g x %.4g mm, %.6g cm³\n",
              tool.mesh().triangles.size(), size.x, size.y, size.z, tool.mesh_mass().volume * 1e6) +
         text("bounds        %.4g %.4g %.4g ... %.4g %.4g %.4g mm\n", box.low.x * 1000,
              box.low.y * 1000, box.low.z * 1000, box.high.x * 1000, box.high.y * 1000,
              box.high.z * 1000) +
         text("spheres       %zu, radii %.4g ... %.4g mm, fill %.2f %%\n", tool.spheres().size(),
              radius.smallest * 1000, radius.largest * 1000, 100 * fill(tool)) +
         text(
             "standoff      mean %.4g mm, 95 %% %.4g mm, maximum %.4g mm from the surface to the "
             "nearest sphere\n",
             standoff.mean * 1000, standoff.p95 * 1000, standoff.max * 1000) +
         text("worst place   %.4g %.4g %.4g mm, %.4g mm from the nearest sphere\n", worst.x,
              worst.y, worst.z, standoff.max * 1000) +
         text("center        %.4g %.4g %.4g mm (of the spheres)\n", center.x, center.y, center.z) +
         text("tree          %zu nodes\n", tool.tree().nodes().size()) +
         text("graph         %d edges, %d of them bridges between %d components\n",
              graph.num_edges(), graph.num_bridges(), graph.num_components_before_bridging());
}

void warn_of_empty_part(const std::string& path, const Tool& tool, const Standoff& standoff) {
  if (const auto empty = empty_part(tool, standoff)) {
    print_warning(path + ": " + *empty);
  }
}

void print_json(const Json& json) {
  std::cout << json.dump(2, ' ', false, Json::error_handler_t::replace) << '\n';
}

}  // namespace palpate::apps
