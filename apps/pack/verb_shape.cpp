// palpate shape: simple tools without a CAD program.

#include <algorithm>
#include <iostream>
#include <memory>

#include "apps/options.h"
#include "apps/output_files.h"
#include "apps/terminal/terminal.h"
#include "apps/verbs.h"
#include "palpate/io/formats.h"
#include "palpate/mesh/mesh.h"

namespace palpate::apps {
namespace {

struct Options {
  std::string name;
  double size = 0.1;
  std::string output;
};

Status run(const Options& options) {
  if (const Status status = check_output_file(options.output, OutputKind::mesh); !status)
    return status;
  const auto mesh = make_shape(options.name, options.size);
  if (!mesh) return mesh.error();
  if (const Status status = save_mesh(*mesh, options.output); !status) return status;
  results() << "written       " << options.output << ", " << mesh->triangles.size()
            << " triangles, in meters\n";
  return Done{};
}

}  // namespace

void add_shape(CLI::App& program, Action& action) {
  const auto options = std::make_shared<Options>();
  CLI::App& app = *program.add_subcommand("shape", "Write a generated closed mesh, in meters.");
  std::string names;
  for (const std::string& name : shape_names()) names += (names.empty() ? "" : ", ") + name;
  const auto parse_name = [options, names](const std::string& name) {
    const auto known = shape_names();
    if (std::find(known.begin(), known.end(), name) == known.end()) {
      usage_error("there is no shape '" + name + "'; choose one of " + names);
    }
    options->name = name;
  };
  app.add_option_function<std::string>("name", parse_name, "one of " + names)
      ->required()
      ->type_name("NAME");
  add_number(app, "--size", options->size, {1e-4, 2, "m"}, "longest side");
  app.add_option("-o,--output", options->output, "mesh file (.ply, .stl or .obj)")
      ->required()
      ->type_name("FILE");
  app.footer("Example: palpate shape stylus --size 0.15 -o stylus.ply");
  app.callback([options, &action] {
    check_mesh_name("--output", options->output);
    action = [options] { return run(*options); };
  });
}

}  // namespace palpate::apps
