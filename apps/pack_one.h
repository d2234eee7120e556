// One mesh becomes one tool.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "palpate/core/result.h"
#include "palpate/mesh/triangle_mesh.h"
#include "palpate/packing/packer.h"
#include "palpate/session/names.h"
#include "palpate/session/packing_report.h"
#include "palpate/tool/tool.h"

namespace palpate::apps {

inline constexpr std::array<Named<double>, 4> kUnits{
    {{"m", 1}, {"mm", 0.001}, {"cm", 0.01}, {"in", 0.0254}}};
inline constexpr std::array<Named<GapRule>, 2> kGapRules{
    {{"absolute", GapRule::absolute}, {"relative", GapRule::relative}}};

/// How meshes are to be packed.
struct PackRequest {
  double unit = 1, scale = 1;
  PackOptions pack;                    ///< its least radius is that of the camera, if that is more
  bool as_many_as_needed = false;      ///< spheres, for a standoff of kFeltShare of the tool's size
  std::vector<double> camera_spacing;  ///< depth in metres and focal length in pixels, or empty
  GapRule gap_rule = GapRule::relative;
};

/// --spheres auto: a standoff of 95 % of the surface, as share of the tool's longest side, and the
/// most spheres it may take. It takes kReachingSpheres at least.
inline constexpr double kFeltShare = 0.005;
inline constexpr int kMostNeeded = 50000;

struct PackedTool {
  Tool tool;
  Standoff standoff;
  PackingNotes notes;
  double seconds = 0;  ///< since the mesh was read
};

/// Reads a mesh in its unit and scale.
Result<TriangleMesh> load_mesh_for(const PackRequest& request, const std::string& path);
/// Checks, packs and builds. Warnings go to stderr, progress under `title`. Error: the mesh is no
/// solid or has no sane size; no sphere fits; interrupted.
Result<PackedTool> pack_one(const TriangleMesh& raw, const std::string& path,
                            const PackRequest& request, const std::string& title);
/// Writes the page that shows the packing.
Status write_page(const PackedTool& packed, const std::string& path);

}  // namespace palpate::apps
