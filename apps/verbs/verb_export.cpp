// palpate export: a tool's parts as files that other programs read.

#include <array>
#include <cstdio>
#include <iostream>
#include <memory>

#include "apps/options.h"
#include "apps/output_files.h"
#include "apps/terminal/terminal.h"
#include "apps/verbs.h"
#include "palpate/io/files.h"
#include "palpate/io/formats.h"
#include "src/io/internal/atomic_file.h"

namespace palpate::apps {
namespace {

struct Options {
  std::string tool, spheres, edges, mesh;
};

/// Digits that distinguish every single-precision number from its neighbors.
std::string spheres_csv(const Tool& tool) {
  std::string text = "x,y,z,r\n";
  for (const Sphere& s : tool.spheres()) {
    char line[96];
    std::snprintf(line, sizeof line, "%.9g,%.9g,%.9g,%.9g\n", static_cast<double>(s.center.x),
                  static_cast<double>(s.center.y), static_cast<double>(s.center.z),
                  static_cast<double>(s.radius));
    text += line;
  }
  return text;
}

std::string edges_csv(const Tool& tool) {
  std::string text = "a,b\n";
  for (const auto& [a, b] : tool.graph().edges()) {
    text += std::to_string(a) + "," + std::to_string(b) + "\n";
  }
  return text;
}

Status run(const Options& options) {
  const auto tool = load_tool(options.tool);
  if (!tool) return tool.error();
  // All checks come before the first file is written.
  const std::array outputs{options.spheres, options.edges, options.mesh};
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    if (outputs[i].empty()) continue;
    const OutputKind kind = i < 2 ? OutputKind::table : OutputKind::mesh;
    if (const Status status = check_output_file(outputs[i], kind, options.tool); !status) {
      return status;
    }
    for (std::size_t k = 0; k < i; ++k) {
      if (outputs[k].empty() || !is_same_file(outputs[i], outputs[k])) continue;
      return Error{Errc::invalid_argument,
                   "cannot write two things to " + outputs[i] + "; give two names"};
    }
  }
  if (!options.spheres.empty()) {
    const Status status = write_file_atomically(options.spheres, spheres_csv(*tool));
    if (!status) return status;
    results() << "written       " << options.spheres << ", " << tool->spheres().size()
              << " spheres\n";
  }
  if (!options.edges.empty()) {
    const Status status = write_file_atomically(options.edges, edges_csv(*tool));
    if (!status) return status;
    results() << "written       " << options.edges << ", " << tool->graph().num_edges()
              << " edges\n";
  }
  if (!options.mesh.empty()) {
    const Status status = save_mesh(tool->mesh(), options.mesh);
    if (!status) return status;
    results() << "written       " << options.mesh << ", " << tool->mesh().triangles.size()
              << " triangles\n";
  }
  return Done{};
}

}  // namespace

void add_export(CLI::App& program, Action& action) {
  const auto options = std::make_shared<Options>();
  CLI::App& app = *program.add_subcommand("export", "Write a tool's spheres, graph or mesh.");
  app.add_option("tool", options->tool, "tool file")->required()->type_name("TOOL.palp");
  app.add_option("--spheres", options->spheres, "x,y,z,r of every sphere, in meters")
      ->type_name("FILE.csv");
  app.add_option("--edges", options->edges, "a,b: neighbors in the leaf graph")
      ->type_name("FILE.csv");
  app.add_option("--mesh", options->mesh, "the repaired mesh (.ply, .stl or .obj)")
      ->type_name("FILE.ply");
  app.footer("Example: palpate export drill.palp --spheres spheres.csv --edges edges.csv");
  app.callback([options, &action] {
    if (options->spheres.empty() && options->edges.empty() && options->mesh.empty()) {
      usage_error("export: nothing to do; give --spheres, --edges or --mesh");
    }
    if (!options->mesh.empty()) check_mesh_name("--mesh", options->mesh);
    action = [options] { return run(*options); };
  });
}

}  // namespace palpate::apps
