// palpate pack: from a mesh to a tool.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
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
  std::vector<double> camera_spacing;  ///< depth in metres and focal length in pixels, or empty
  GapRule gap_rule = GapRule::absolute;
  bool json = false;
};

const char* reason(PackStop stop) {
  switch (stop) {
    case PackStop::count: return "as many as asked for";
    case PackStop::fill: return "the fill limit was reached";
    case PackStop::radius: return "the next one would be smaller than the smallest radius allowed";
    case PackStop::time: return "the time was up";
    case PackStop::exhausted: return "no further one fits at single precision";
  }
  return "";
}

/// Points of a camera with focal length f (pixels) are z/f apart at depth z. A sphere that the
/// surface cuts is only sure to hold a point if the cut disc's radius is at least that spacing /
/// sqrt 2: half the diagonal of a square of four points.
double least_felt_radius(double depth, double focal_length) {
  return depth / focal_length / std::sqrt(2.0);
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
  const auto tool = Tool::build(std::move(solid->mesh), *std::move(packing), options.gap_rule,
                                source, pack.num_threads);
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
  if (!options.camera_spacing.empty()) {
    const double depth = options.camera_spacing[0], focal_length = options.camera_spacing[1];
    std::printf("camera        points %.4g mm apart at %.4g m: no sphere below %.4g mm\n",
                1000 * depth / focal_length, depth, 1000 * options.pack.min_radius);
    std::fflush(stdout);
  }
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
  app.add_option(
         "--camera-spacing", options->camera_spacing,
         "no sphere too small to be sure to hold a point of a camera at depth Z metres with "
         "focal length F pixels: --min-radius Z / F / sqrt 2 at least")
      ->delimiter(',')
      ->expected(2)
      ->type_name("Z,F");
  app.add_option("--max-fill", pack.max_fill, "stop at this fraction of the mesh volume")
      ->capture_default_str();
  app.add_option("--max-seconds", pack.max_seconds, "stop after so many seconds")
      ->check(CLI::PositiveNumber);
  app.add_option("--seed", pack.seed, "jitters the starting grid; 0: the plain grid")
      ->capture_default_str();
  add_named(app, "--gap-rule", options->gap_rule, kGapRules, "which spheres are neighbours");
  app.add_option("--threads", pack.num_threads, "threads; 0: one per core")
      ->check(CLI::Range(0, 256))
      ->capture_default_str();
  app.add_flag("--json", options->json, "print the result as JSON");
  app.footer("Example: palpate pack drill.stl --unit mm --spheres 10000 -o drill.palp");
  app.callback([options, &action] {
    PackOptions& limits = options->pack;
    for (const double limit :
         {limits.max_radius, limits.min_radius, limits.max_fill, limits.max_seconds}) {
      if (std::isnan(limit)) {
        usage_error("--max-radius, --min-radius, --max-fill and --max-seconds must be numbers");
      }
    }
    if (!(limits.max_fill > 0 && limits.max_fill <= 1)) {
      usage_error("--max-fill must be greater than 0 and at most 1");
    }
    if (!options->camera_spacing.empty()) {
      const double depth = options->camera_spacing[0], focal_length = options->camera_spacing[1];
      const double radius = least_felt_radius(depth, focal_length);
      if (!(depth > 0 && focal_length > 0 && std::isfinite(radius))) {
        usage_error("--camera-spacing: Z and F must be finite and greater than 0");
      }
      limits.min_radius = std::max(limits.min_radius, radius);
    }
    if (limits.min_radius > limits.max_radius) {
      usage_error(
          "--min-radius (or what --camera-spacing asks for) must not be greater than --max-radius");
    }
    action = [options] { return run(*options); };
  });
}

}  // namespace palpate::apps
