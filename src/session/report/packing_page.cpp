// The page of a packed tool.
#include <algorithm>
#include <map>

#include "palpate/version.h"
#include "src/pages/internal/pages.h"
#include "src/session/internal/compact_json.h"
#include "src/session/internal/packing_report.h"
#include "src/session/internal/page_models.h"

namespace palpate { inline namespace v0 {
namespace {

using Json = nlohmann::ordered_json;

// Largest number of values of a list on the page.
constexpr std::size_t kMaxValues = 4000;

Json list(const Vec3d& v, int digits = 6) {
  return {compact(v.x, digits), compact(v.y, digits), compact(v.z, digits)};
}

/// Returns ascending values, all or those at evenly spaced ranks from the smallest to the largest.
template <class Value>
Json ranks(const std::vector<Value>& sorted) {
  Json json = Json::array();
  const std::size_t num = std::min(sorted.size(), kMaxValues);
  for (std::size_t i = 0; i < num; ++i) {
    const std::size_t rank = num == 1 ? 0 : i * (sorted.size() - 1) / (num - 1);
    json.push_back(compact(static_cast<double>(sorted[rank])));
  }
  return json;
}

/// The fill at prefix sizes in even steps on a logarithmic axis, at all of them where they are few.
Json fill_json(const std::vector<double>& fill) {
  Json json = Json::array();
  for (std::size_t n = 1; n < fill.size(); n = std::max(n + 1, n * 81 / 80)) {
    json.push_back({n, compact(fill[n - 1])});
  }
  json.push_back({fill.size(), compact(fill.back())});
  return json;
}

Json mass_json(const MassProperties& mass) {
  const auto& i = mass.inertia.m;
  Json inertia = Json::array();
  for (const double value : {i[0][0], i[1][1], i[2][2], i[0][1], i[0][2], i[1][2]}) {
    inertia.push_back(compact(value));
  }
  return {{"volume_m3", compact(mass.volume, 8)},
          {"center_of_mass_m", list(mass.center_of_mass)},
          {"inertia_m5", inertia}};
}

Json standoff_json(const Standoff& standoff) {
  return {{"samples_m", ranks(standoff.samples)},
          {"num_samples", standoff.samples.size()},
          {"mean_m", standoff.mean},
          {"p95_m", standoff.p95},
          {"max_m", standoff.max},
          {"worst_m", list(standoff.worst)}};
}

Json law_json(const std::optional<PowerLaw>& law) {
  if (!law) return nullptr;
  return {{"factor", law->factor},
          {"exponent", law->exponent},
          {"rms", law->rms},
          {"first", law->first}};
}

Json degrees_json(const std::vector<int>& degrees) {
  std::map<int, int> counts;
  for (const int degree : degrees) ++counts[degree];
  Json json = Json::array();
  for (const auto& [degree, count] : counts) json.push_back({degree, count});
  return json;
}

template <class Value>
Json pairs(const std::vector<std::pair<std::string, Value>>& list) {
  Json json = Json::array();
  for (const auto& [name, value] : list) json.push_back({name, value});
  return json;
}

}  // namespace

Result<std::string> packing_page(const Tool& tool, const PackingStatistics& s,
                                 const PackingNotes& notes) {
  std::vector<float> radii;
  for (const Sphere& sphere : tool.spheres()) radii.push_back(sphere.radius);
  std::sort(radii.begin(), radii.end());
  const LeafGraph& graph = tool.graph();
  const Json json{
      {"kind", "packing"},
      {"program", PALPATE_VERSION},
      {"source", tool.source()},
      {"num_spheres", tool.spheres().size()},
      {"solid", solid_json(tool, tool.spheres())},
      {"num_triangles", tool.mesh().triangles.size()},
      {"warning", empty_part(tool, s.standoff).value_or("")},
      {"fill", fill_json(s.fill)},
      {"void_law", law_json(s.void_law)},
      {"apollonian_exponent", kApollonianExponent},
      {"radii_m", ranks(radii)},
      {"smallest_radius_m", s.smallest_radius},
      {"median_radius_m", s.median_radius},
      {"largest_radius_m", s.largest_radius},
      {"standoff", standoff_json(s.standoff)},
      {"degrees", degrees_json(s.degrees)},
      {"mean_degree", s.mean_degree},
      {"median_degree", s.median_degree},
      {"p90_degree", s.p90_degree},
      {"p99_degree", s.p99_degree},
      {"max_degree", s.max_degree},
      {"graph",
       {{"edges", graph.num_edges()},
        {"bridges", graph.num_bridges()},
        {"components", graph.num_components_before_bridging()},
        {"is_relative", tool.gap_rule() == GapRule::relative}}},
      {"tree_nodes", tool.tree().nodes().size()},
      {"represented_volume_m3", s.represented_volume},
      {"mass", {{"spheres", mass_json(tool.sphere_mass())}, {"mesh", mass_json(tool.mesh_mass())}}},
      {"stopped", notes.stopped},
      {"options", pairs(notes.options)},
      {"steps", pairs(notes.step_seconds)}};
  return report_page("Palpate: " + tool.source(), page_text(json));
}

}}  // namespace palpate::v0
