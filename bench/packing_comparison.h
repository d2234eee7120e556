// Results of the packing comparison, and their output.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "bench/stopwatch.h"
#include "palpate/core/core.h"

namespace palpate::bench {

/// State of a packing after its newest sphere.
struct CurvePoint {
  int spheres = 0;
  double fill = 0;         ///< sphere volume / mesh volume
  Times times;             ///< since the call
  double last_radius = 0;  ///< meters
};

/// One packer on one mesh, by ascending number of spheres: every number, or separate runs.
struct PackingCurve {
  std::vector<CurvePoint> points;
  std::string ending;  ///< reason for fewer spheres than requested; empty if none

  std::optional<CurvePoint> at(int spheres) const;
  /// Returns the first point with at least this fill.
  std::optional<CurvePoint> reaching(double fill) const;
  /// Returns the points at the counts of the report, and the last.
  std::vector<CurvePoint> reported() const;
};

struct PackingMethod {
  const char* id;    ///< in the CSV file
  const char* name;  ///< for humans
};
inline constexpr std::array<PackingMethod, 3> kMethods{
    {{"palpate", "Palpate"}, {"prototypes", "prototype placement"}, {"fixed-grid", "fixed grid"}}};
inline constexpr std::array kCounts{100, 300, 1000, 3000, 10000, 17000, 30000, 100000};

struct MeshComparison {
  std::string mesh;
  std::array<PackingCurve, kMethods.size()> curves;  ///< as kMethods
};

struct PackingComparison {
  std::vector<MeshComparison> meshes;
  std::vector<std::string> skipped;  ///< a sentence each
  double prototype_share = 0;        ///< of the largest, from which on a round inserts
  int grid_cells = 0;                ///< of the fixed grid, along the longest side
  /// Provenance of the numbers: date, machine, commit, command, ...
  std::vector<std::array<std::string, 2>> facts;
};

/// The summary table: per mesh and method the state at two counts, and the effort to reach the
/// fills A and B, which are those of Palpate at the two counts, as multiples of Palpate's effort.
inline constexpr int kSmall = 1000, kLarge = 10000;
std::vector<std::string> summary_header();
std::vector<std::vector<std::string>> summary_rows(const PackingComparison& comparison);

/// Summarizes the numbers in a few sentences.
std::string finding(const PackingComparison& comparison);
/// Formats one line per mesh, method and count, after comment lines with the facts.
std::string to_csv(const PackingComparison& comparison);
/// Formats the summary table as Markdown.
std::string to_markdown(const PackingComparison& comparison);
/// Makes the report, one self-contained HTML page. Error: this build has no pages.
Result<std::string> to_html(const PackingComparison& comparison);

}  // namespace palpate::bench
