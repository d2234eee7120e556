// Packs one mesh into a tool.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "palpate/core/core.h"
#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"
#include "palpate/settings/setting_table.h"
#include "palpate/tool/tool.h"
#include "src/session/internal/packing_report.h"

namespace palpate::apps {

/// Length unit of mesh files.
enum class LengthUnit { m, mm, cm, in };
constexpr auto names_of(LengthUnit) { return std::array{"m", "mm", "cm", "in"}; }
constexpr double meters(LengthUnit unit) {
  constexpr double kMeters[] = {1, 0.001, 0.01, 0.0254};
  return kMeters[static_cast<int>(unit)];
}

/// Options of packing a mesh.
struct PackRequest {
  LengthUnit unit = LengthUnit::m;
  double scale = 1;
  PackOptions pack;                    ///< its least radius is that of the camera, if that is more
  bool as_many_as_needed = false;      ///< spheres, for a standoff of kFeltShare of the tool's size
  std::vector<double> camera_spacing;  ///< depth in meters and focal length in pixels, or empty
  GapRule gap_rule = GapRule::relative;
};

/// Limits of --spheres auto: standoff of 95 % of the surface, as share of the tool's longest side,
/// and maximum number of spheres. It uses at least kReachingSpheres.
inline constexpr double kFeltShare = 0.005;
inline constexpr int kMaxSpheresNeeded = 50000;

struct PackedTool {
  Tool tool;
  Standoff standoff;
  PackingNotes notes;
  double seconds = 0;  ///< since the mesh was read
};

/// Reads a mesh in its unit and scale.
Result<TriangleMesh> load_mesh_for(const PackRequest& request, const std::string& path);
/// Checks and packs a mesh, and builds the tool. Warnings go to stderr, progress under `title`.
/// Error: the mesh is no solid or of implausible size; no sphere fits; interrupted.
Result<PackedTool> pack_one(const TriangleMesh& raw, const std::string& path,
                            const PackRequest& request, const std::string& title);
/// Writes the page that shows the packing.
Status write_page(const PackedTool& packed, const std::string& path);

}  // namespace palpate::apps
