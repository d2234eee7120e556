// palpate pack: from a mesh to a tool, from a folder of meshes to a folder of tools, or from a URDF
// to a packed robot.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/options.h"
#include "apps/output_files.h"
#include "apps/pack/pack_folder.h"
#include "apps/pack/pack_one.h"
#include "apps/pack/pack_robot.h"
#include "apps/terminal/terminal.h"
#include "apps/tool_info.h"
#include "apps/verbs.h"
#include "palpate/io/files.h"

namespace palpate::apps {
namespace {

struct Options {
  std::string input, output;
  PackRequest request;
  RobotJob robot;
  bool report = false;
  std::string page;  ///< empty for a folder: its pages are beside the tools
  bool json = false;
};

/// Points of a camera with focal length f (pixels) are z/f apart at depth z. A sphere that the
/// surface cuts is only sure to hold a point if the cut disc's radius is at least that spacing /
/// sqrt 2: half the diagonal of a square of four points.
double min_contact_radius(double depth, double focal_length) {
  return depth / focal_length / std::sqrt(2.0);
}

Status check_outputs(const Options& options) {
  if (const Status status = check_output_file(options.output, OutputKind::tool, options.input);
      !status) {
    return status;
  }
  if (!options.report) return Done{};
  if (is_same_file(options.page, options.output)) {
    return Error{Errc::io_failure, "--output and --report would write two things to " +
                                       options.output + "; give two names"};
  }
  return check_output_file(options.page, OutputKind::page, options.input);
}

void print_packing(const Options& options, const PackedTool& packed) {
  results() << describe(packed.tool, packed.standoff);
  const PackRequest& request = options.request;
  if (!request.camera_spacing.empty()) {
    const double depth = request.camera_spacing[0], focal_length = request.camera_spacing[1];
    char text[120];
    std::snprintf(text, sizeof text,
                  "camera        points %.4g mm apart at %.4g m: no sphere below %.4g mm\n",
                  1000 * depth / focal_length, depth, 1000 * request.pack.min_radius);
    results() << text;
  }
  if (packed.tool.packing().stop != PackStop::count) {
    results() << "stopped       " << packed.notes.stopped << '\n';
  }
  char text[64];
  std::snprintf(text, sizeof text, "%.2f s", packed.seconds);
  results() << "written       " << options.output << " after " << text << '\n';
  if (options.report) results() << "report        " << options.page << '\n';
}

Status run_one(const Options& options) {
  if (const Status status = check_outputs(options); !status) return status;
  const auto raw = load_mesh_for(options.request, options.input);
  if (!raw) return raw.error();
  catch_interrupts();
  const auto packed = pack_one(*raw, options.input, options.request, "packing");
  if (!packed) return packed.error();
  if (const Status status = save_tool(packed->tool, options.output); !status) return status;
  if (options.report) {
    if (const Status status = write_page(*packed, options.page); !status) return status;
  }
  if (options.json) {
    nlohmann::ordered_json json = tool_info(packed->tool, packed->standoff);
    json["output"] = options.output;
    json["seconds"] = packed->seconds;
    if (options.report) json["report"] = options.page;
    print_json(json);
  } else {
    print_packing(options, *packed);
  }
  return Done{};
}

bool is_folder(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::is_directory(path, ignored);
}

/// Checks combinations of options.
void check(Options& options) {
  PackOptions& limits = options.request.pack;
  if (const auto& spacing = options.request.camera_spacing; !spacing.empty()) {
    const double radius = min_contact_radius(spacing[0], spacing[1]);
    if (!(spacing[0] > 0 && spacing[1] > 0 && std::isfinite(radius))) {
      usage_error("--camera-spacing: Z and F must be finite and greater than 0");
    }
    limits.min_radius = std::max(limits.min_radius, radius);
  }
  if (limits.min_radius > limits.max_radius) {
    usage_error(
        "--min-radius (or the one from --camera-spacing) must not be greater than --max-radius");
  }
  if (!options.report) return;
  if (is_folder(options.input) && !options.page.empty()) {
    usage_error("--report: for a folder, each page is written beside its tool; leave out the name");
  }
  if (!is_folder(options.input) && options.page.empty()) {
    usage_error("--report: give the name of the page to write");
  }
}

void add_limits(CLI::App& app, PackRequest& request) {
  PackOptions& pack = request.pack;
  const SettingTable limits = settings_of(pack);
  const auto parse_spheres =
      [&request, spheres = *limits.find("packing.spheres")](const std::string& text) mutable {
        request.as_many_as_needed = text == "auto";
        if (request.as_many_as_needed) return;
        const Status status = spheres.set(parse_value(spheres, text), "--spheres:");
        if (!status) usage_error(status.error().message + "; or auto");
      };
  app.add_option_function<std::string>(
         "--spheres", parse_spheres,
         "maximum number of spheres; auto: from 1000 to 50000, until 95 % of the surface "
         "is within 0.5 % of the tool's longest side of a sphere")
      ->type_name("NUMBER|auto")
      ->default_str(std::to_string(pack.max_spheres));
  add_word(app, "--unit", request.unit, "unit of the mesh file");
  add_number(app, "--scale", request.scale, {1e-9, 1e9}, "additional scale factor");
  add_setting_options(app, "", limits, kPackLimits);
  app.add_option("--camera-spacing", request.camera_spacing,
                 "omit spheres too small to resolve for a camera at depth Z meters with focal "
                 "length F pixels: --min-radius of at least Z / F / sqrt 2")
      ->delimiter(',')
      ->expected(2)
      ->type_name("Z,F");
  add_seed_option(app, pack.seed, "jitters the starting grid; 0: the plain grid");
  add_word(app, "--gap-rule", request.gap_rule, "which spheres are neighbors");
  add_threads_option(app, pack.num_threads, "threads; 0: one per core");
}

}  // namespace

void add_pack(CLI::App& program, Action& action) {
  const auto options = std::make_shared<Options>();
  CLI::App& app =
      *program.add_subcommand("pack", "Fill a watertight mesh with spheres and write a tool file.");
  app.add_option("mesh", options->input,
                 "OBJ, STL, PLY, OFF, glTF or GLB, or a folder of such files")
      ->type_name("MESH");
  app.add_option("-o,--output", options->output,
                 "tool file to write; for a folder of meshes, the folder of tools")
      ->required()
      ->type_name("TOOL.palp");
  add_limits(app, options->request);
  add_robot_packing(app, options->robot);
  CLI::Option* report =
      app.add_option(
             "--report", options->page,
             "write an HTML page about the packing; for a folder, without a name: one beside "
             "each tool")
          ->expected(0, 1)
          ->type_name("PAGE.html");
  app.add_flag("--json", options->json, "print the result as JSON");
  app.footer(
      "Of a folder, every mesh is packed to NAME.palp in the output folder, in the order of names "
      "and without\nsubfolders, unless it is up to date: NAME.pack.json there holds checksums of "
      "the mesh as read and of the\ntool file, and the options; the dates of files do not matter. "
      "Bad meshes are passed over and listed at the end.\n"
      "Example: palpate pack drill.stl --unit mm --spheres 10000 -o drill.palp");
  app.callback([options, report, &app, &action] {
    options->report = report->count() > 0;
    check_robot_packing(app);
    if (!options->robot.robot.empty()) {
      options->robot.output = options->output;
      options->robot.json = options->json;
      action = [options] { return pack_robot(options->robot); };
      return;
    }
    check(*options);
    action = [options] {
      if (!is_folder(options->input)) return run_one(*options);
      return pack_folder(
          {options->input, options->output, options->request, options->report, options->json});
    };
  });
}

}  // namespace palpate::apps
