#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numeric>

#include "src/mesh/internal/surface_points.h"
#include "src/session/internal/packing_report.h"

namespace palpate { inline namespace v0 {
namespace {

double distance(const Vec3d& p, const Sphere& sphere) {
  return norm(p - to_double(sphere.center)) - static_cast<double>(sphere.radius);
}

// The median standoff is 0.39 to 0.48 of its 95th percentile in all packings alike. It is less only
// where more than 5 % of the surface belong to a part thinner than the spheres: then this many
// times p50 is about the 95th percentile of the rest.
constexpr double kMaxOfHalf = 3;

/// Returns the nearest sphere to p, by branch and bound: no sphere is nearer than the node that
/// contains it. `guess` is any sphere; a near one saves work. The search ends at a sphere that is
/// not farther than `floor`.
int nearest_sphere(const Tool& tool, const Vec3d& p, int guess, double floor) {
  const auto nodes = tool.tree().nodes();
  struct Waiting {
    double bound;
    std::int32_t node;
  };
  std::array<Waiting, InnerSphereTree::kMaxWaiting> waiting;
  int num_waiting = 0;
  int best = guess;
  double least = distance(p, tool.spheres()[static_cast<std::size_t>(guess)]);
  waiting[static_cast<std::size_t>(num_waiting++)] = {distance(p, nodes[0].bound), 0};
  while (num_waiting > 0 && least > floor) {
    const Waiting next = waiting[static_cast<std::size_t>(--num_waiting)];
    if (next.bound >= least) continue;
    const IstNode& node = nodes[static_cast<std::size_t>(next.node)];
    if (node.num_children == 0) {
      const double found = distance(p, tool.spheres()[static_cast<std::size_t>(node.sphere_id)]);
      if (found < least) {
        least = found;
        best = node.sphere_id;
      }
      continue;
    }
    const int first = num_waiting;
    for (std::int32_t k = 0; k < node.num_children; ++k) {
      const std::int32_t child = node.first_child + k;
      const double bound = distance(p, nodes[static_cast<std::size_t>(child)].bound);
      if (bound < least) waiting[static_cast<std::size_t>(num_waiting++)] = {bound, child};
    }
    std::sort(waiting.begin() + first, waiting.begin() + num_waiting,
              [](const Waiting& a, const Waiting& b) { return a.bound > b.bound; });
  }
  return best;
}

}  // namespace

double PowerLaw::operator()(double n) const { return factor * std::pow(n, -exponent); }

std::optional<PowerLaw> fit_power_law(std::span<const double> void_fractions, int first) {
  const int last = static_cast<int>(void_fractions.size());
  if (first < 1 || last < 2 * first) return std::nullopt;
  // The same number of values from every decade.
  constexpr int kPerDecade = 100;
  std::vector<double> x, y;
  int previous = 0;
  for (int k = 0;; ++k) {
    const double desired = std::round(first * std::pow(10.0, static_cast<double>(k) / kPerDecade));
    const int n = static_cast<int>(std::min<double>(desired, last));
    if (n != previous) {
      const double share = void_fractions[static_cast<std::size_t>(n) - 1];
      if (!(share > 0)) return std::nullopt;
      x.push_back(std::log(n));
      y.push_back(std::log(share));
    }
    if (n == last) break;
    previous = n;
  }
  const auto count = static_cast<double>(x.size());
  const double mean_x = std::accumulate(x.begin(), x.end(), 0.0) / count;
  const double mean_y = std::accumulate(y.begin(), y.end(), 0.0) / count;
  double xx = 0, xy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    xx += (x[i] - mean_x) * (x[i] - mean_x);
    xy += (x[i] - mean_x) * (y[i] - mean_y);
  }
  PowerLaw law;
  law.exponent = -xy / xx;
  law.factor = std::exp(mean_y + law.exponent * mean_x);
  law.first = first;
  double squares = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double deviation = y[i] - (std::log(law.factor) - law.exponent * x[i]);
    squares += deviation * deviation;
  }
  law.rms = std::sqrt(squares / count);
  return law;
}

Standoff standoff(const Tool& tool, int num_samples) {
  Standoff result;
  result.max = -INFINITY;
  int near = 0;  // points follow each other along the surface
  const auto measure = [&](const Vec3d& p, double floor) {
    near = nearest_sphere(tool, p, near, floor);
    const double found = distance(p, tool.spheres()[static_cast<std::size_t>(near)]);
    if (found > result.max) {
      result.max = found;
      result.worst = p;
    }
    return found;
  };
  for (const Vec3d& p : surface_points(tool.mesh(), num_samples)) {
    result.samples.push_back(measure(p, -INFINITY));
  }
  // Ends are corners. Only a corner that is farther off than all before needs its exact distance.
  for (const auto& triangle : tool.mesh().triangles) {
    for (const std::uint32_t corner : triangle) measure(tool.mesh().vertices[corner], result.max);
  }
  std::sort(result.samples.begin(), result.samples.end());
  result.mean = std::accumulate(result.samples.begin(), result.samples.end(), 0.0) / num_samples;
  result.p95 = nearest_rank(result.samples, 0.95);
  return result;
}

std::optional<std::string> empty_part(const Tool& tool, const Standoff& standoff) {
  const Bounds box = bounds(tool.mesh());
  const Vec3d size = box.high - box.low;
  const double longest = std::max({size.x, size.y, size.z});
  const double usual = std::min(standoff.p95, kMaxOfHalf * nearest_rank(standoff.samples, 0.5));
  if (standoff.max <= standoff_bound(usual, longest)) return std::nullopt;
  const char* advice = "pack more spheres, or allow smaller ones (--min-radius, --camera-spacing)";
  if (tool.packing().stop == PackStop::exhausted) {
    advice = "no sphere fits there at single precision; make the tool thicker there";
  } else if (tool.spheres().size() < static_cast<std::size_t>(kReachingSpheres)) {
    advice = "pack 1000 spheres or more: from there on thin ends get spheres of their own";
  }
  char text[400];
  const Vec3d p = standoff.worst * 1000;
  std::snprintf(
      text, sizeof text,
      "a part of the tool that is thinner than the spheres stays empty and feels nothing: "
      "at %.4g %.4g %.4g mm the nearest sphere is %.4g mm off, elsewhere at most about "
      "%.4g mm; %s",
      p.x, p.y, p.z, standoff.max * 1000, usual * 1000, advice);
  return text;
}

PackingStatistics packing_statistics(const Tool& tool) {
  PackingStatistics s;
  std::vector<double> voids, radii;
  double volume = 0;
  for (const Sphere& sphere : tool.spheres()) {
    radii.push_back(static_cast<double>(sphere.radius));
    volume += sphere_volume(radii.back());
    s.fill.push_back(volume / tool.mesh_mass().volume);
    voids.push_back(1 - s.fill.back());
  }
  s.void_law = fit_power_law(voids);
  std::sort(radii.begin(), radii.end());
  s.smallest_radius = radii.front();
  s.median_radius = nearest_rank(radii, 0.5);
  s.largest_radius = radii.back();
  s.standoff = standoff(tool);

  const auto row_starts = tool.graph().row_starts();
  for (std::size_t i = 0; i + 1 < row_starts.size(); ++i) {
    s.degrees.push_back(row_starts[i + 1] - row_starts[i]);
  }
  std::vector<int> sorted = s.degrees;
  std::sort(sorted.begin(), sorted.end());
  s.mean_degree = 2.0 * tool.graph().num_edges() / static_cast<double>(sorted.size());
  s.median_degree = nearest_rank(sorted, 0.5);
  s.p90_degree = nearest_rank(sorted, 0.9);
  s.p99_degree = nearest_rank(sorted, 0.99);
  s.max_degree = sorted.back();

  const auto represented = tool.represented_volumes();
  s.represented_volume = std::accumulate(represented.begin(), represented.end(), 0.0);
  return s;
}

}}  // namespace palpate::v0
