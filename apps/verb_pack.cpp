// palpate pack: from a mesh to a tool.

#include <chrono>
#include <cmath>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/options.h"
#include "apps/terminal.h"
#include "apps/tool_info.h"
#include "apps/verbs.h"
#include "palpate/io/mesh_file.h"
#include "palpate/io/tool_file.h"
#include "palpate/mesh/mesh_check.h"

namespace palpate::apps {
namespace {

constexpr std::array<Named<double>, 4> kUnits{
    {{"m", 1}, {"mm", 0.001}, {"cm", 0.01}, {"in", 0.0254}}};
constexpr std::array<Named<GapRule>, 2> kGapRules{
    {{"absolute", GapRule::absolute}, {"relative", GapRule::relative}}};

struct Options {
  std::string mesh, output;
  double unit = 1, scale = 1;
  PackOptions pack;
  GapRule gap_rule = GapRule::absolute;
  bool json = false;
};

const char* reason(PackStop stop) {
  switch (stop) {
    case PackStop::count: return "as many as asked for";
    case PackStop::fill: return "the fill limit was reached";
    case PackStop::radius: return "the next one would be smaller than --min-radius";
    case PackStop::time: return "the time was up";
    case PackStop::exhausted: return "no further one fits at single precision";
  }
  return "";
}

Status run(const Options& options) {
  const auto start = std::chrono::steady_clock::now();
  if (const Status status = check_output_file(options.output); !status) return status;
  const auto raw = load_mesh(options.mesh, options.unit * options.scale);
  if (!raw) return raw.error();
  auto solid = check_solid(*raw);
  if (!solid) {
    return Error{solid.error().code, options.mesh + ": " + solid.error().message};
  }
  for (const std::string& warning : solid->warnings) {
    std::cerr << "palpate: warning: " << options.mesh << ": " << warning << '\n';
  }

  catch_interrupts();
  Progress bar("packing");
  PackOptions pack = options.pack;
  pack.progress = [&](const PackProgress& progress) {
    if (bar.due()) {
      char words[96];
      std::snprintf(words, sizeof words, "%d spheres, fill %.1f %%, radius %.3g mm",
                    progress.num_spheres, 100 * progress.fill, progress.last_radius * 1000);
      bar.update(static_cast<double>(progress.num_spheres) / pack.max_spheres, words);
    }
    return !interrupted();
  };
  auto packing = pack_spheres(solid->mesh, pack);
  if (!packing) return packing.error();
  const PackStop stop = packing->stop;
  const std::string source = std::filesystem::path(options.mesh).filename().string();
  const auto tool =
      Tool::build(std::move(solid->mesh), *std::move(packing), options.gap_rule, source);
  if (!tool) return tool.error();
  if (interrupted()) return Error{Errc::cancelled, "interrupted; nothing was written"};
  if (const Status status = save_tool(*tool, options.output); !status) return status;

  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (options.json) {
    nlohmann::ordered_json json = tool_info(*tool);
    json["output"] = options.output;
    json["seconds"] = seconds;
    print_json(json);
    return Done{};
  }
  std::cout << describe(*tool);
  if (stop != PackStop::count) std::cout << "stopped       " << reason(stop) << '\n';
  char text[64];
  std::snprintf(text, sizeof text, "%.2f s", seconds);
  std::cout << "written       " << options.output << " after " << text << '\n';
  return Done{};
}

}  // namespace

void add_pack(CLI::App& program, Action& action) {
  const auto options = std::make_shared<Options>();
  CLI::App& app =
      *program.add_subcommand("pack", "Fill a watertight mesh with spheres and write a tool file.");
  app.add_option("mesh", options->mesh, "OBJ, STL, PLY, OFF, glTF or GLB")
      ->required()
      ->type_name("MESH");
  app.add_option("-o,--output", options->output, "tool file to write")
      ->required()
      ->type_name("TOOL.palp");
  PackOptions& pack = options->pack;
  app.add_option("--spheres", pack.max_spheres, "at most so many spheres")
      ->check(CLI::Range(1, 1 << 24))
      ->capture_default_str();
  add_named(app, "--unit", options->unit, kUnits, "unit of the mesh file");
  app.add_option("--scale", options->scale, "factor on top of the unit")
      ->check(CLI::Range(1e-9, 1e9))
      ->capture_default_str();
  app.add_option("--max-radius", pack.max_radius, "no larger sphere, in metres")
      ->check(CLI::PositiveNumber);
  app.add_option("--min-radius", pack.min_radius, "stop at smaller spheres, in metres")
      ->check(CLI::NonNegativeNumber);
  app.add_option("--seed", pack.seed, "jitters the starting grid; 0: the plain grid")
      ->capture_default_str();
  add_named(app, "--gap-rule", options->gap_rule, kGapRules, "which spheres are neighbours");
  app.add_option("--threads", pack.num_threads, "threads; 0: one per core")
      ->check(CLI::Range(0, 256))
      ->capture_default_str();
  app.add_flag("--json", options->json, "print the result as JSON");
  app.footer("Example: palpate pack drill.stl --unit mm --spheres 10000 -o drill.palp");
  app.callback([options, &action] {
    if (std::isnan(options->pack.max_radius) || std::isnan(options->pack.min_radius)) {
      usage_error("--max-radius and --min-radius must be numbers");
    }
    if (options->pack.min_radius > options->pack.max_radius) {
      usage_error("--min-radius must not be greater than --max-radius");
    }
    action = [options] { return run(*options); };
  });
}

}  // namespace palpate::apps
