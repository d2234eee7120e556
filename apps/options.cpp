#include "apps/options.h"

#include <cmath>
#include <vector>

#include "palpate/io/tool_file.h"

namespace palpate::apps {

void add_contact_options(CLI::App& app, RunSettings& settings) {
  ContactOptions& contact = settings.contact;
  add_named(app, "--method", contact.method, kMethodNames,
            "plane of spheres that no point touches");
  add_named(app, "--priority", contact.priority, kPriorityNames,
            "what makes a boundary sphere good");
  add_named(app, "--inside", contact.inside, kInsideNames, "volume of a sphere the graph reaches");
  add_named(app, "--backend", settings.backend, kBackendNames, "where queries run");
  app.add_option("--threads", settings.num_threads,
                 "threads; 0: one per core for surfaces, one for queries")
      ->check(CLI::Range(0, 256))
      ->capture_default_str();
}

void add_surface_options(CLI::App& app, SurfaceOptions& options) {
  const std::string group = "From depth to surface";
  app.add_flag_callback(
         "--no-filter", [&options] { options.filter.enabled = false; },
         "leave out the bilateral filter")
      ->group(group);
  app.add_option("--normal-radius", options.normals.radius, "pixels around a point for its normal")
      ->check(CLI::Range(1, 7))
      ->capture_default_str()
      ->group(group);
  app.add_flag("--weighting", options.normals.weighting, "near neighbours count more")
      ->group(group);
  app.add_flag("--anchoring", options.normals.anchoring, "planes through the point itself")
      ->group(group);
  app.add_flag("--normalization", options.normals.normalization, "all neighbours count the same")
      ->group(group);
}

void add_camera_options(CLI::App& app, CameraOptions& options) {
  const auto parse = [&options](const std::vector<double>& k) {
    for (const double value : k) {
      if (!std::isfinite(value)) usage_error("--intrinsics: the four numbers must be finite");
    }
    if (!(k[0] > 0 && k[1] > 0)) usage_error("--intrinsics: fx and fy must be greater than 0");
    options.intrinsics = Intrinsics{k[0], k[1], k[2], k[3]};
  };
  app.add_option_function<std::vector<double>>("--intrinsics", parse,
                                               "of the depth camera, in pixels")
      ->delimiter(',')
      ->expected(4)
      ->type_name("fx,fy,cx,cy");
  app.add_option("--depth-unit", options.unit, "metres per count of the depth images")
      ->check(CLI::Range(1e-6, 1.0))
      ->capture_default_str();
}

void add_prefix_option(CLI::App& app, int& num_spheres) {
  app.add_option("--spheres", num_spheres, "only the first so many spheres of the tool file")
      ->check(CLI::Range(1, 1 << 30));
}

Result<Tool> load_tool_prefix(const std::filesystem::path& path, int num_spheres, int num_threads) {
  auto tool = load_tool(path);
  if (!tool || num_spheres == 0) return tool;
  auto prefix = tool->prefix(num_spheres, num_threads);
  if (!prefix) {
    return Error{prefix.error().code, path.string() + ": --spheres: " + prefix.error().message};
  }
  return prefix;
}

Status check_output_file(const std::filesystem::path& path) {
  std::error_code ignored;
  const auto folder = path.has_parent_path() ? path.parent_path() : std::filesystem::path(".");
  if (!std::filesystem::is_directory(folder, ignored)) {
    return Error{Errc::not_found, "cannot write " + path.string() + ": there is no folder " +
                                      folder.string() + "; make it first"};
  }
  if (std::filesystem::is_directory(path, ignored)) {
    return Error{Errc::io_failure,
                 "cannot write " + path.string() + ": it is a folder; give the name of a file"};
  }
  return Done{};
}

}  // namespace palpate::apps
