// HTML page of the packing comparison.
#include <algorithm>

#include "bench/packing_comparison.h"
#include "src/pages/internal/pages.h"
#include "src/session/internal/compact_json.h"

namespace palpate::bench {
namespace {

using Json = nlohmann::ordered_json;

/// Makes the columns of a curve from the first reported count on, about 20 points per decade;
/// `is_reported`: false for points that only connect the others.
Json curve_json(const PackingCurve& curve) {
  Json json{{"spheres", Json::array()},
            {"fill", Json::array()},
            {"seconds", Json::array()},
            {"ending", curve.ending},
            {"is_reported", Json::array()}};
  const auto reported = curve.reported();
  double next = kCounts[0];
  for (const CurvePoint& p : curve.points) {
    const bool is_reported = std::any_of(reported.begin(), reported.end(), [&](const auto& other) {
      return other.spheres == p.spheres;
    });
    if (p.spheres < kCounts[0] || (p.spheres < next && !is_reported)) continue;
    json["spheres"].push_back(p.spheres);
    json["fill"].push_back(compact(p.fill));
    json["seconds"].push_back(compact(p.times.cpu));
    json["is_reported"].push_back(is_reported);
    if (p.spheres >= next) next = p.spheres * 1.12;
  }
  return json;
}

}  // namespace

Result<std::string> to_html(const PackingComparison& comparison) {
  Json methods = Json::array(), meshes = Json::array();
  for (const PackingMethod& method : kMethods) methods.push_back(method.name);
  for (const MeshComparison& mesh : comparison.meshes) {
    Json curves = Json::array();
    for (const PackingCurve& curve : mesh.curves) curves.push_back(curve_json(curve));
    meshes.push_back({{"mesh", mesh.mesh}, {"curves", curves}});
  }
  const Json json{{"kind", "comparison"},
                  {"finding", finding(comparison)},
                  {"skipped", comparison.skipped},
                  {"methods", methods},
                  {"meshes", meshes},
                  {"summary_header", summary_header()},
                  {"summary_rows", summary_rows(comparison)},
                  {"prototype_share", comparison.prototype_share},
                  {"grid_cells", comparison.grid_cells},
                  {"facts", comparison.facts}};
  return report_page("Sphere packing, side by side", page_text(json));
}

}  // namespace palpate::bench
