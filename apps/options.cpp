#include "apps/options.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <iostream>
#include <thread>
#include <vector>

#include "palpate/io/tool_file.h"

namespace palpate::apps {
namespace {

const NumberRange kGpus{0, 63, "the number of a GPU, 0 or more"};

/// The absolute path that a name leads to, links followed, whether or not it is there.
std::filesystem::path resolved(const std::filesystem::path& path) {
  std::error_code ignored;
  return std::filesystem::weakly_canonical(std::filesystem::absolute(path, ignored), ignored);
}

}  // namespace

void add_threads_option(CLI::App& app, int& num_threads, const std::string& help) {
  const NumberRange range{0, 1 << 20, "a whole number of threads, 0 or more"};
  const auto parse = [&num_threads, range](const std::string& text) {
    constexpr int kPerCore = 4;
    const int most = kPerCore * static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
    num_threads = parse_number_in<int>("--threads", range, text);
    if (num_threads <= most) return;
    num_threads = most;
    std::cerr << "palpate: note: --threads " << text << " is more than " << kPerCore
              << " per core; " << most << " are used\n";
  };
  app.add_option_function<std::string>("--threads", parse, help)
      ->type_name("NUMBER")
      ->default_str("0");
}

void add_contact_options(CLI::App& app, RunSettings& settings) {
  ContactOptions& contact = settings.contact;
  add_named(app, "--method", contact.method, kMethodNames,
            "how a sphere is measured: by the depth field, or by the points in the spheres");
  add_named(app, "--priority", contact.priority, kPriorityNames,
            "what makes a boundary sphere good");
  add_named(app, "--inside", contact.inside, kInsideNames, "volume of a sphere the graph reaches");
  add_named(app, "--volumes", contact.volumes, kVolumesNames,
            "what a sphere counts: itself or the part of the tool it stands for, which is auto for "
            "the field");
  add_named(app, "--edges", contact.edges, kEdgesNames,
            "what happens where the surface ends in front of something farther away");
  add_named(app, "--continuity", contact.continuity, kContinuityNames,
            "how weighted, simplified and graph smooth over points that enter and leave spheres");
  add_named(app, "--unknown", settings.field.unknown, kUnknownNames,
            "field: what lies where nothing was measured");
  add_number(app, "--fill-levels", settings.field.fill_levels, {0, 5, "a whole number from 0 to 5"},
             "field: close holes up to about 2^this pixels wide");
  add_number(app, "--thickness", settings.field.thickness,
             {1e-3, kSolidBehind, "a number of metres from 0.001 to 1000000"},
             "field: how far behind a surface a tool is pushed out of its front, in metres");
  add_named(app, "--backend", settings.backend, kBackendNames,
            "where surfaces and queries are computed; auto: on a GPU if there is one");
  add_number(app, "--contact-gpu", settings.contact_gpu, kGpus, "cuda: which GPU computes queries");
  add_threads_option(app, settings.num_threads,
                     "threads; 0: one per core for surfaces, one for queries");
}

void add_sensing_gpu_option(CLI::App& app, int& gpu) {
  add_number(app, "--sensing-gpu", gpu, kGpus, "cuda: which GPU makes the surfaces");
}

void note_backend(const std::string& why_not_cuda) {
  if (why_not_cuda.empty()) return;
  std::cerr << "palpate: note: backend cpu is used: " << why_not_cuda << '\n';
}

void add_surface_options(CLI::App& app, SurfaceOptions& options) {
  const std::string group = "From depth to surface";
  app.add_flag_callback(
         "--no-filter", [&options] { options.filter.enabled = false; },
         "leave out the bilateral filter")
      ->group(group);
  const NumberRange depths{1e-3, 1e3, "a number of metres from 0.001 to 1000"};
  add_number(app, "--min-depth", options.min_depth, depths, "nearer pixels are no measurement")
      ->group(group);
  add_number(app, "--max-depth", options.max_depth, depths, "farther pixels are no measurement")
      ->group(group);
  add_number(app, "--normal-radius", options.normals.radius,
             {1, 7, "a whole number of pixels from 1 to 7"}, "pixels around a point for its normal")
      ->group(group);
  add_named(app, "--plane-fit", options.normals.fit, kPlaneFitNames,
            "which coordinates of a pixel are noisy: its depth or all")
      ->group(group);
  app.add_flag("--weighting", options.normals.weighting, "near neighbours count more")
      ->group(group);
  app.add_flag("--anchoring", options.normals.anchoring, "planes through the point itself")
      ->group(group);
  app.add_flag("--normalization", options.normals.normalization, "all neighbours count the same")
      ->group(group);
}

void add_time_options(CLI::App& app, TimeOptions& options) {
  const std::string group = "Between depth images";
  add_named(app, "--time", options.mode, kTimeModeNames,
            "what is felt until the next depth image comes")
      ->group(group);
  add_named(app, "--average", options.average.kind, kDepthAverageNames,
            "average of each pixel's depth over time")
      ->group(group);
  add_number(app, "--average-frames", options.average.frames,
             {1, 64, "a whole number of frames from 1 to 64"},
             "moving: measurements in the average")
      ->group(group);
  add_number(app, "--average-weight", options.average.weight,
             {kLeastPositive, 1, "a number above 0, up to 1"},
             "exponential: weight of the newest measurement")
      ->group(group);
}

void add_camera_options(CLI::App& app, CameraOptions& options) {
  const auto parse = [&options](const std::vector<double>& k) {
    constexpr double kMost = 1e6;
    for (const double value : k) {
      if (!(std::abs(value) <= kMost)) {
        usage_error("--intrinsics: must be fx,fy,cx,cy, numbers of pixels up to a million");
      }
    }
    if (!(k[0] >= 1 && k[1] >= 1))
      usage_error("--intrinsics: must be fx,fy,cx,cy with fx and fy of at least 1 pixel");
    options.intrinsics = Intrinsics{k[0], k[1], k[2], k[3]};
  };
  app.add_option_function<std::vector<double>>("--intrinsics", parse,
                                               "of the depth camera, in pixels")
      ->delimiter(',')
      ->expected(4)
      ->type_name("fx,fy,cx,cy");
  add_number(app, "--depth-unit", options.unit, {1e-6, 1, "a number of metres from 0.000001 to 1"},
             "metres per count of the depth images");
}

void add_prefix_option(CLI::App& app, int& num_spheres) {
  add_number(app, "--spheres", num_spheres, {1, 1 << 30, "a whole number, 1 or more"},
             "only the first so many spheres of the tool file")
      ->default_str("all");
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

bool is_same_file(const std::filesystem::path& a, const std::filesystem::path& b) {
  std::error_code ignored;
  return std::filesystem::equivalent(a, b, ignored) || resolved(a) == resolved(b);
}

Status check_output_file(const std::filesystem::path& path, const std::filesystem::path& input) {
  const auto refuse = [&path](const std::string& why) {
    return Error{Errc::io_failure, "cannot write " + path.string() + ": " + why};
  };
  std::error_code ignored;
  const std::filesystem::path target = resolved(path);
  const auto folder = target.parent_path();
  if (!std::filesystem::is_directory(folder, ignored)) {
    return refuse("there is no folder " + folder.string() + "; make it first");
  }
  if (std::filesystem::is_directory(target, ignored)) {
    return refuse("it is a folder; give the name of a file");
  }
  if (std::filesystem::exists(target, ignored) &&
      !std::filesystem::is_regular_file(target, ignored)) {
    return refuse("it is not a regular file; give the name of a new file");
  }
  if (::access(folder.c_str(), W_OK | X_OK) != 0) {
    return refuse(std::string("its folder: ") + std::strerror(errno) + "; choose another one");
  }
  if (!input.empty() && is_same_file(path, input)) {
    return refuse("it is the input " + input.string() + "; give another name");
  }
  return Done{};
}

void check_mesh_name(const std::string& flag, const std::filesystem::path& path) {
  const auto extension = path.extension();
  if (extension != ".ply" && extension != ".stl" && extension != ".obj") {
    usage_error(flag + ": '" + path.string() + "' must end in .ply, .stl or .obj");
  }
}

}  // namespace palpate::apps
