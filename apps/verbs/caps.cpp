#include "apps/verbs/caps.h"

#include <vector>

#include "apps/options.h"
#include "palpate/io/formats.h"
#include "palpate/mesh/mesh.h"

namespace palpate::apps {
namespace {

/// Spheres and the planes that cut them.
struct Parts {
  std::vector<Sphere> spheres;
  std::vector<Plane<double>> planes;

  void add(const Sphere& sphere, const Plane<double>& plane) {
    spheres.push_back(sphere);
    planes.push_back(plane);
  }
};

/// Parts of the spheres that the measure counts, if one plane cuts each sphere.
struct InsideParts {
  Parts cut, whole;
};

InsideParts inside_parts(std::span<const Sphere> spheres, const ContactQuery& query,
                         std::span<const SurfaceBlend> cameras, const Pose& X_WT) {
  // The graph counts the whole spheres that it reaches, whatever plane they have taken.
  const auto* const graph = std::get_if<GraphMethod>(&query.method());
  const bool reached_are_whole = graph != nullptr && graph->inside == InsideVolume::full;
  std::vector<SphereState> states(spheres.size());
  std::vector<Plane<float>> planes(spheres.size());
  query.measure(cameras, X_WT, {.states = states, .planes = planes});
  InsideParts parts;
  for (std::size_t id = 0; id < spheres.size(); ++id) {
    const Plane<double> plane{to_double(planes[id].normal), planes[id].offset};
    const bool has_plane = !(plane.normal == Vec3d{});
    if (states[id] == SphereState::outside) continue;
    if (states[id] == SphereState::inside && (reached_are_whole || !has_plane)) {
      parts.whole.add(spheres[id], {});
    } else if (has_plane) {
      const double radius = spheres[id].radius;
      const double distance = dot(plane.normal, to_double(spheres[id].center)) - plane.offset;
      if (distance >= radius) continue;
      (distance > -radius ? parts.cut : parts.whole).add(spheres[id], plane);
    }
  }
  return parts;
}

}  // namespace

void add_caps_options(CLI::App& app, CapsOptions& options) {
  const std::string group = "Export of the penetrating part";
  app.add_option("--caps", options.file,
                 "write the part of every sphere inside the scene, in the camera frame, cut "
                 "spheres purple, whole ones blue (.ply or .glb); for one --pose, without objects")
      ->type_name("FILE.ply")
      ->group(group);
  add_number(app, "--caps-segments", options.segments, {3, 1000, "triangles"},
             "triangles around each sphere of --caps")
      ->group(group);
}

void check_caps_options(const CapsOptions& options) {
  const auto extension = std::filesystem::path(options.file).extension();
  if (extension != ".ply" && extension != ".glb") {
    usage_error("--caps: '" + options.file + "' must end in .ply or .glb");
  }
}

Result<std::size_t> write_caps(const CapsOptions& options, const Tool& tool,
                               const ContactQuery& query, std::span<const SurfaceBlend> cameras,
                               const Pose& X_WT) {
  const InsideParts parts = inside_parts(tool.spheres(), query, cameras, X_WT);
  const std::size_t num_parts = parts.cut.spheres.size() + parts.whole.spheres.size();
  if (num_parts == 0) {
    return Error{Errc::invalid_argument, "cannot write " + options.file +
                                             ": no part of the tool is inside; give a pose in "
                                             "contact"};
  }
  constexpr std::size_t kMaxTriangles = 10'000'000;
  if (num_parts > kMaxTriangles / max_cap_triangles(options.segments)) {
    return Error{Errc::invalid_argument,
                 "cannot write " + options.file + ": " + std::to_string(num_parts) +
                     " spheres of up to " + std::to_string(max_cap_triangles(options.segments)) +
                     " triangles are more than ten million; lower --caps-segments"};
  }
  const auto picture = [&](const char* name, std::array<std::uint8_t, 3> rgb, const Parts& of) {
    ColoredMesh result{name, rgb, inside_mesh(of.spheres, of.planes, options.segments)};
    const Pose X{X_WT.translation, normalized(X_WT.rotation)};
    for (Vec3d& p : result.mesh.vertices) p = X * p;
    return result;
  };
  const std::array pictures{picture("cut", {150, 50, 200}, parts.cut),
                            picture("whole", {40, 90, 230}, parts.whole)};
  if (const Status status = save_colored_meshes(pictures, options.file); !status) {
    return status.error();
  }
  return pictures[0].mesh.triangles.size() + pictures[1].mesh.triangles.size();
}

}  // namespace palpate::apps
