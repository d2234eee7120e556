// Quality of a packed tool: the numbers, and the page that shows them.
#pragma once

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "palpate/core/core.h"
#include "palpate/tool/tool.h"

namespace palpate { inline namespace v0 {

/// The smallest value that at least this share of the values, which are ascending and at least one,
/// do not exceed.
template <class Value>
Value nearest_rank(const std::vector<Value>& sorted, double share) {
  const double rank = std::ceil(share * static_cast<double>(sorted.size()));
  return sorted[static_cast<std::size_t>(std::max(rank, 1.0)) - 1];
}

/// void(N) = factor * N^-exponent. Greedy packings approach it, with an exponent a little below
/// that of the Apollonian packing, the best that spheres can do; the shape of the solid decides the
/// factor, and how soon.
struct PowerLaw {
  double factor = 0, exponent = 0;
  double rms = 0;  ///< deviation of ln void from the law
  int first = 0;   ///< the smallest N that was fitted; the largest is all
  double operator()(double n) const;
};
/// (3 - D) / D with the dimension D = 2.4739465 of the Apollonian sphere packing.
inline constexpr double kApollonianExponent = 0.2126;

/// Least squares through ln void over ln N from `first` on, every decade with the same weight;
/// values[n - 1] is the void fraction of the first n spheres. Nothing if there are fewer than
/// twice `first` values, or one of those fitted is not positive.
std::optional<PowerLaw> fit_power_law(std::span<const double> void_fractions, int first = 100);

/// Distance of the surface of the solid from the nearest sphere: the delay of a contact.
struct Standoff {
  std::vector<double> samples;  ///< m, ascending
  double mean = 0, p95 = 0;     ///< m, of the samples
  double max = 0;               ///< m, of the samples and the corners of the mesh
  Vec3d worst;                  ///< point of the surface with the largest
};
/// At surface_points, exact in double for each of them, and at all corners, because thin ends are
/// corners. O(num_samples log num_spheres).
Standoff standoff(const Tool& tool, int num_samples = kStandoffSamples);

/// Warns where a part of the tool has no sphere near it although the rest has: where `max`
/// is beyond standoff_bound, of the rest if that part is large. Nothing if there is no such part.
std::optional<std::string> empty_part(const Tool& tool, const Standoff& standoff);

struct PackingStatistics {
  std::vector<double> fill;  ///< [n - 1]: volume of the first n spheres / mesh volume
  std::optional<PowerLaw> void_law;
  double smallest_radius = 0, median_radius = 0, largest_radius = 0;  ///< m
  Standoff standoff;
  std::vector<int> degrees;  ///< of sphere i in the leaf graph
  double mean_degree = 0;
  int median_degree = 0, p90_degree = 0, p99_degree = 0, max_degree = 0;
  double represented_volume = 0;  ///< m3, of all spheres together
};
PackingStatistics packing_statistics(const Tool& tool);

/// Notes that a page shows beside the tool itself; empty parts are left out.
struct PackingNotes {
  std::string stopped;                                       ///< why there are no more spheres
  std::vector<std::pair<std::string, std::string>> options;  ///< name and value, for humans
  std::vector<std::pair<std::string, double>> step_seconds;  ///< name and time taken
};

/// One self-contained HTML page: the tool cut open in 3-D, fill, radii, standoff, graph and mass.
/// Of the spheres the first 200000, and the mesh only if it has as few triangles. Error: this build
/// has no pages.
Result<std::string> packing_page(const Tool& tool, const PackingStatistics& statistics,
                                 const PackingNotes& notes = {});

}}  // namespace palpate::v0
