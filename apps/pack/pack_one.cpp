#include "apps/pack/pack_one.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>

#include "apps/terminal/terminal.h"
#include "apps/tool_info.h"
#include "palpate/io/formats.h"
#include "palpate/mesh/mesh.h"
#include "src/core/internal/message_text.h"
#include "src/io/internal/atomic_file.h"

namespace palpate::apps {
namespace {

/// Times the steps of a job one after the other.
class StopWatch {
 public:
  double lap() {
    const auto now = Clock::now();
    const double seconds = std::chrono::duration<double>(now - last_).count();
    last_ = now;
    return seconds;
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point last_ = Clock::now();
};

const char* reason(PackStop stop) {
  switch (stop) {
    case PackStop::count: return "the requested number was reached";
    case PackStop::fill: return "the fill limit was reached";
    case PackStop::radius: return "the next one would be smaller than the smallest radius allowed";
    case PackStop::time: return "the time was up";
    case PackStop::exhausted: return "no further one fits at single precision";
    case PackStop::standoff: return "95 % of the surface is within the requested standoff";
  }
  return "";
}

/// Returns the longest side of the box around all faces; NaN if a corner is missing or not finite.
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

std::string length_text(double meters) {
  return meters < 0.1 ? number_text(meters * 1000, 4) + " mm" : number_text(meters, 4) + " m";
}

/// Checks the mesh; warnings about its size name the options.
Result<SolidMesh> check_tool_mesh(const PackRequest& request, const TriangleMesh& raw,
                                  const std::string& path) {
  constexpr double kSmallTool = 0.005;
  const MeshCheckOptions limits;
  const double length = longest_side(raw);
  const std::string how_long = path + ": the tool is " + length_text(length) + " long, read in " +
                               name_of(request.unit) + (request.scale == 1 ? "" : " and scaled");
  if (length > limits.max_extent || length < limits.min_extent) {
    return Error{Errc::bad_input, how_long + ", and may have " + length_text(limits.min_extent) +
                                      " to " + length_text(limits.max_extent) +
                                      "; give the right --unit (m, mm, cm, in) or --scale"};
  }
  auto solid = check_solid(raw, limits);
  if (!solid) return Error{solid.error().code, path + ": " + solid.error().message};
  for (std::string& warning : solid->warnings) warning = path + ": " + warning;
  if (length < kSmallTool) solid->warnings.push_back(how_long + "; check --unit");
  return solid;
}

const Error kInterrupted{Errc::cancelled, "interrupted; nothing was written"};

/// Explains why there are no spheres, in terms of the options.
Error no_sphere(const PackRequest& request, const std::string& path, const Error& error) {
  if (error.code == Errc::cancelled) return kInterrupted;
  if (error.code != Errc::bad_input) return error;
  std::string advice;
  if (request.pack.min_radius > 0) advice += "lower --min-radius or --camera-spacing, ";
  if (request.pack.max_radius < PackOptions{}.max_radius) advice += "raise --max-radius, ";
  return {error.code, path + ": no sphere fits into the mesh; " + advice +
                          "move it to its origin, or make it thicker than a few millionths of its "
                          "size"};
}

Result<SpherePacking> pack(const TriangleMesh& solid, const PackRequest& request,
                           const std::string& title) {
  Progress bar(title);
  PackOptions options = request.pack;
  if (request.as_many_as_needed) {
    options.max_spheres = kMaxSpheresNeeded;
    options.standoff = kFeltShare * longest_side(solid);
  }
  options.progress = [&](const PackProgress& progress) {
    if (bar.due()) {
      char words[96];
      std::snprintf(words, sizeof words, "%d spheres, fill %.1f %%, radius %.3g mm",
                    progress.num_spheres, 100 * progress.fill, progress.last_radius * 1000);
      bar.update(static_cast<double>(progress.num_spheres) / options.max_spheres, words);
    }
    return !interrupted();
  };
  return pack_spheres(solid, options);
}

/// Returns the options that affected the packing, as rows for display.
std::vector<std::pair<std::string, std::string>> option_rows(const PackRequest& request) {
  const PackOptions& pack = request.pack;
  const PackOptions defaults;
  std::vector<std::pair<std::string, std::string>> rows{
      {"--spheres", request.as_many_as_needed ? "auto" : std::to_string(pack.max_spheres)},
      {"--unit", name_of(request.unit)}};
  if (request.scale != 1) rows.emplace_back("--scale", number_text(request.scale, 6));
  if (pack.max_radius < defaults.max_radius) {
    rows.emplace_back("--max-radius", length_text(pack.max_radius));
  }
  if (!request.camera_spacing.empty()) {
    rows.emplace_back("--camera-spacing", number_text(request.camera_spacing[0], 6) + " m, " +
                                              number_text(request.camera_spacing[1], 6) +
                                              " pixels");
  }
  if (pack.min_radius > 0) rows.emplace_back("smallest radius", length_text(pack.min_radius));
  if (pack.max_fill < defaults.max_fill) {
    rows.emplace_back("--max-fill", number_text(pack.max_fill, 6));
  }
  if (pack.max_seconds < defaults.max_seconds) {
    rows.emplace_back("--max-seconds", number_text(pack.max_seconds, 6));
  }
  if (pack.seed != 0) rows.emplace_back("--seed", std::to_string(pack.seed));
  return rows;
}

}  // namespace

Result<TriangleMesh> load_mesh_for(const PackRequest& request, const std::string& path) {
  return load_mesh(path, meters(request.unit) * request.scale);
}

Result<PackedTool> pack_one(const TriangleMesh& raw, const std::string& path,
                            const PackRequest& request, const std::string& title) {
  StopWatch watch;
  PackingNotes notes;
  double seconds = 0;
  const auto end_step = [&](const char* name) {
    notes.step_seconds.emplace_back(name, watch.lap());
    seconds += notes.step_seconds.back().second;
  };
  auto solid = check_tool_mesh(request, raw, path);
  if (!solid) return solid.error();
  for (const std::string& warning : solid->warnings) {
    print_warning(warning);
  }
  end_step("checking the mesh");
  auto packing = pack(solid->mesh, request, title);
  if (!packing) return no_sphere(request, path, packing.error());
  if (interrupted()) return kInterrupted;
  end_step("packing");
  notes.stopped = reason(packing->stop);
  notes.options = option_rows(request);
  const std::string source = std::filesystem::path(path).filename().string();
  auto tool = Tool::build(std::move(solid->mesh), *std::move(packing),
                          {request.gap_rule, source, request.pack.num_threads});
  if (!tool) return tool.error();
  if (interrupted()) return kInterrupted;
  end_step("volumes, graph and tree");
  tool = std::move(*tool).with_solid_field(request.pack.num_threads);
  if (interrupted()) return kInterrupted;
  end_step("distance field");
  Standoff gap = standoff(*tool);
  warn_of_empty_part(path, *tool, gap);
  return PackedTool{*std::move(tool), std::move(gap), std::move(notes), seconds};
}

Status write_page(const PackedTool& packed, const std::string& path) {
  const auto page = packing_page(packed.tool, packing_statistics(packed.tool), packed.notes);
  if (!page) return page.error();
  return write_file_atomically(path, *page);
}

}  // namespace palpate::apps
