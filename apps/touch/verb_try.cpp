// palpate try: a first contact by one command. It is palpate touch with what that takes chosen: a
// pen, a simulated hand, and the page in the browser as the device.

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <memory>

#include "apps/pack/pack_one.h"
#include "apps/terminal/terminal.h"
#include "apps/touch/touch.h"
#include "apps/verbs.h"
#include "palpate/io/files.h"
#include "palpate/mesh/mesh.h"

namespace palpate::apps {
namespace {

namespace fs = std::filesystem;

constexpr double kPenLength = 0.12;  // m, as that of the scene hand
constexpr int kNumSpheres = 2000;    // packed in a second

struct TryOptions {
  std::string tool;  ///< tool file or mesh; empty: a pen
  LengthUnit unit = LengthUnit::m;
  std::string camera = "scene:hand";
  bool keeps_browser = false;
  TouchOptions touch;
};

/// Makes an empty folder for tool and run.
Result<fs::path> make_folder() {
  std::string name = (fs::temp_directory_path() / "palpate-try-XXXXXX").string();
  if (mkdtemp(name.data()) != nullptr) return fs::path(name);
  return Error{Errc::io_failure, "cannot make the folder " + name + ": " + std::strerror(errno) +
                                     "; set TMPDIR to a folder that can be written to"};
}

/// Packs the mesh, or the pen, into a tool file.
Status pack_tool(const TryOptions& options, const fs::path& file) {
  PackRequest request;
  request.unit = options.unit;
  request.pack.max_spheres = kNumSpheres;
  const auto mesh = options.tool.empty() ? make_shape("stylus", kPenLength)
                                         : load_mesh_for(request, options.tool);
  if (!mesh) return mesh.error();
  const auto packed =
      pack_one(*mesh, options.tool.empty() ? "pen" : options.tool, request, "packing");
  if (!packed) return packed.error();
  return save_tool(packed->tool, file);
}

Status run(const TryOptions& given) {
  catch_interrupts();
  const auto folder = make_folder();
  if (!folder) return folder.error();
  TryOptions options = given;
  TouchOptions& touch = options.touch;
  Status status = Done{};
  touch.tool = options.tool;
  if (fs::path(options.tool).extension() != ".palp") {
    touch.tool = (*folder / "tool.palp").string();
    print_note("packing the " + (options.tool.empty() ? "pen" : options.tool) + ", some seconds");
    status = pack_tool(options, touch.tool);
  }
  touch.output = (*folder / "run").string();
  touch.has_page = true;
  touch.device = "page";
  touch.page.opens_browser = !options.keeps_browser && has_screen();
  if (status) status = run_touch(touch);
  std::error_code ignored;
  if (!fs::exists(touch.output, ignored)) fs::remove_all(*folder, ignored);
  return status;
}

}  // namespace

void add_try(CLI::App& program, Action& action) {
  const auto options = std::make_shared<TryOptions>();
  CLI::App& app =
      *program.add_subcommand("try", "Feel a simulated hand with a pen, by mouse, in the browser.");
  app.add_option("tool", options->tool,
                 "tool file or mesh to use instead of the pen: OBJ, STL, PLY, OFF, glTF or GLB")
      ->type_name("TOOL");
  add_word(app, "--unit", options->unit, "unit of a mesh file");
  app.add_option("--camera", options->camera,
                 "depth camera instead of the hand; palpate cameras lists the kinds")
      ->type_name("URI")
      ->capture_default_str();
  app.add_flag("--no-open", options->keeps_browser, "do not open the browser");
  add_page_options(app, "--", options->touch.page);
  add_seconds_option(app, "--duration", options->touch.duration, "length; default: until Ctrl-C");
  app.footer(
      "Example: palpate try\n"
      "Example: palpate try drill.stl --unit mm --camera openni2");
  app.callback([options, &action] {
    const auto camera = parse_camera_uri(options->camera);
    if (!camera) usage_error("--" + camera.error().message);
    options->touch.cameras = {*camera};
    action = [options] { return run(*options); };
  });
}

}  // namespace palpate::apps
