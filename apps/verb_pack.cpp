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

/// Longest side of the box around all faces; NaN if a corner is not finite or not there.
double longest_side(const TriangleMesh& mesh) {
  TriangleMesh corners;
  for (const auto& triangle : mesh.triangles) {
    for (const std::uint32_t vertex : triangle) {
      if (vertex >= mesh.vertices.size()) return NAN;
      const Vec3d& p = mesh.vertices[vertex];
      if (!std::isfinite(p.x + p.y + p.z)) return NAN;
      corners.vertices.push_back(p);
    }
  }
  const Bounds box = bounds(corners);
  const Vec3d sides = box.high - box.low;
  return std::max({sides.x, sides.y, sides.z});
}

std::string length_text(double metres) {
  char text[48];
  const bool is_short = metres < 0.1;
  std::snprintf(text, sizeof text, is_short ? "%.4g mm" : "%.4g m",
                is_short ? metres * 1000 : metres);
  return text;
}

/// Checks the mesh; what is odd about its size is told in terms of the options.
Result<SolidMesh> check_tool_mesh(const Options& options, const TriangleMesh& raw) {
  constexpr double kSmallTool = 0.005;
  const MeshCheckOptions limits;
  const double length = longest_side(raw);
  const std::string how_long = options.mesh + ": the tool is " + length_text(length) +
                               " long, read in " + name_of(kUnits, options.unit) +
                               (options.scale == 1 ? "" : " and scaled");
  if (length > limits.max_extent || length < limits.min_extent) {
    return Error{Errc::bad_input, how_long + ", and may have " + length_text(limits.min_extent) +
                                      " to " + length_text(limits.max_extent) +
                                      "; give the right --unit (m, mm, cm, in) or --scale"};
  }
  auto solid = check_solid(raw, limits);
  if (!solid) return Error{solid.error().code, options.mesh + ": " + solid.error().message};
  for (std::string& warning : solid->warnings) warning = options.mesh + ": " + warning;
  if (length < kSmallTool) solid->warnings.push_back(how_long + "; check --unit");
  return solid;
}

/// Why no sphere fits, in terms of the options.
Error no_sphere(const Options& options, const Error& error) {
  if (error.code != Errc::bad_input) return error;
  std::string advice;
  if (options.pack.min_radius > 0) advice += "lower --min-radius or --camera-spacing, ";
  if (std::isfinite(options.pack.max_radius)) advice += "raise --max-radius, ";
  return {error.code, options.mesh + ": no sphere fits into the mesh; " + advice +
                          "move it to its origin, or make it thicker than a few millionths of its "
                          "size"};
}

Status run(const Options& options) {
  const auto start = std::chrono::steady_clock::now();
  if (const Status status = check_output_file(options.output, options.mesh); !status) return status;
  const auto raw = load_mesh(options.mesh, options.unit * options.scale);
  if (!raw) return raw.error();
  auto solid = check_tool_mesh(options, *raw);
  if (!solid) return solid.error();
  for (const std::string& warning : solid->warnings) {
    std::cerr << "palpate: warning: " << warning << '\n';
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
  if (!packing) return no_sphere(options, packing.error());
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
  // Two million spheres need 2.5 GB while they are packed.
  add_number(app, "--spheres", pack.max_spheres, {1, 2e6, "a whole number from 1 to 2000000"},
             "at most so many spheres");
  add_named(app, "--unit", options->unit, kUnits, "unit of the mesh file");
  add_number(app, "--scale", options->scale, {1e-9, 1e9, "a number from 1e-9 to 1e9"},
             "factor on top of the unit");
  add_number(app, "--max-radius", pack.max_radius,
             {kLeastPositive, kGreatest, "a number of metres greater than 0"},
             "no larger sphere, in metres");
  add_number(app, "--min-radius", pack.min_radius, {0, kGreatest, "a number of metres, 0 or more"},
             "stop at smaller spheres, in metres");
  app.add_option(
         "--camera-spacing", options->camera_spacing,
         "no sphere too small to be sure to hold a point of a camera at depth Z metres with "
         "focal length F pixels: --min-radius Z / F / sqrt 2 at least")
      ->delimiter(',')
      ->expected(2)
      ->type_name("Z,F");
  add_number(app, "--max-fill", pack.max_fill,
             {kLeastPositive, 1, "a number greater than 0, at most 1"},
             "stop at this fraction of the mesh volume");
  add_number(app, "--max-seconds", pack.max_seconds,
             {kLeastPositive, kGreatest, "a number of seconds greater than 0"},
             "stop after so many seconds");
  add_number(app, "--seed", pack.seed, {0, kGreatest, "a whole number, 0 or more, below 2^64"},
             "jitters the starting grid; 0: the plain grid");
  add_named(app, "--gap-rule", options->gap_rule, kGapRules, "which spheres are neighbours");
  add_threads_option(app, pack.num_threads, "threads; 0: one per core");
  app.add_flag("--json", options->json, "print the result as JSON");
  app.footer("Example: palpate pack drill.stl --unit mm --spheres 10000 -o drill.palp");
  app.callback([options, &action] {
    PackOptions& limits = options->pack;
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
