// palpate shape: simple tools without a CAD program.

#include <memory>

#include "apps/options.h"
#include "apps/verbs.h"
#include "palpate/io/mesh_file.h"
#include "palpate/mesh/shapes.h"

namespace palpate::apps {
namespace {

struct Options {
  std::string name;
  double size = 0.1;
  std::string output;
};

Status run(const Options& options) {
  const auto mesh = make_shape(options.name, options.size);
  if (!mesh) return mesh.error();
  return save_mesh(*mesh, options.output);
}

}  // namespace

void add_shape(CLI::App& program, Action& action) {
  const auto options = std::make_shared<Options>();
  CLI::App& app = *program.add_subcommand("shape", "Write a simple closed mesh, in metres.");
  std::string names;
  for (const std::string& name : shape_names()) names += (names.empty() ? "" : ", ") + name;
  app.add_option("name", options->name, "one of " + names)->required()->type_name("NAME");
  app.add_option("--size", options->size, "longest side in metres")
      ->check(CLI::Range(1e-4, 2.0))
      ->capture_default_str();
  app.add_option("-o,--output", options->output, "mesh file (.ply, .stl or .obj)")
      ->required()
      ->type_name("FILE");
  app.footer("Example: palpate shape stylus --size 0.15 -o stylus.ply");
  app.callback([options, names, &action] {
    const auto known = shape_names();
    if (std::find(known.begin(), known.end(), options->name) == known.end()) {
      usage_error("there is no shape '" + options->name + "'; choose one of " + names);
    }
    action = [options] { return run(*options); };
  });
}

}  // namespace palpate::apps
