// Output of the packing comparison: summary, finding, CSV and Markdown.
#include "bench/packing_comparison.h"

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <limits>

namespace palpate::bench {
namespace {

__attribute__((format(printf, 1, 2))) std::string format(const char* text, ...) {
  char buffer[256];
  va_list arguments;
  va_start(arguments, text);
  std::vsnprintf(buffer, sizeof buffer, text, arguments);
  va_end(arguments);
  return buffer;
}

// Effort of a method for the fill that Palpate reaches with `spheres` spheres, as multiples of
// Palpate's effort.
struct EqualFill {
  bool reached = false;
  double spheres = 0, time = 0;  ///< if not reached: lower bounds
};

EqualFill equal_fill(const MeshComparison& mesh, std::size_t method, int spheres) {
  const auto ours = mesh.curves[0].at(spheres);
  const PackingCurve& curve = mesh.curves[method];
  if (!ours || curve.points.empty()) return {};
  const auto found = curve.reaching(ours->fill);
  const CurvePoint& end = found ? *found : curve.points.back();
  return {found.has_value(), static_cast<double>(end.spheres) / ours->spheres,
          end.times.cpu / ours->times.cpu};
}

std::string multiple(bool reached, double ratio) {
  if (!reached && ratio <= 1) return "–";
  return format(ratio < 10 ? "%s%.2f" : "%s%.0f", reached ? "" : "> ", ratio);
}

// Range over all meshes where the fill was reached, as "a to b".
struct Range {
  double low = std::numeric_limits<double>::infinity(), high = 0;
  void add(double x) { low = std::min(low, x), high = std::max(high, x); }
  std::string text() const {
    const char* pattern = high < 10 ? "%.1f to %.1f" : "%.0f to %.0f";
    return format(pattern, low, high);
  }
};

// Describes the effort: "prototype placement needs 1.4 to 2 times as many spheres and ..."
std::string effort(const PackingComparison& comparison, std::size_t method, int count) {
  Range spheres, time;
  std::size_t num_reached = 0;
  for (const MeshComparison& mesh : comparison.meshes) {
    const EqualFill fill = equal_fill(mesh, method, count);
    if (!fill.reached) continue;
    ++num_reached;
    spheres.add(fill.spheres);
    time.add(fill.time);
  }
  const std::string name = kMethods[method].name;
  if (num_reached == 0) return name + " reaches it on no mesh";
  const std::string needs = name + " needs " + spheres.text() + " times as many spheres and " +
                            time.text() + " times the processor time";
  if (num_reached == comparison.meshes.size()) return needs;
  return needs + format(" on %zu meshes and does not reach it on the others", num_reached);
}

std::string count_of(std::size_t some, std::size_t all) {
  return some == all ? format("all %zu", all) : format("%zu of %zu", some, all);
}

}  // namespace

std::optional<CurvePoint> PackingCurve::at(int spheres) const {
  const auto found = std::lower_bound(points.begin(), points.end(), spheres,
                                      [](const CurvePoint& p, int n) { return p.spheres < n; });
  if (found == points.end() || found->spheres != spheres) return std::nullopt;
  return *found;
}

std::optional<CurvePoint> PackingCurve::reaching(double fill) const {
  const auto found = std::lower_bound(points.begin(), points.end(), fill,
                                      [](const CurvePoint& p, double f) { return p.fill < f; });
  if (found == points.end()) return std::nullopt;
  return *found;
}

std::vector<CurvePoint> PackingCurve::reported() const {
  std::vector<CurvePoint> result;
  for (const int count : kCounts) {
    if (const auto point = at(count)) result.push_back(*point);
  }
  if (!points.empty() && (result.empty() || result.back().spheres != points.back().spheres)) {
    result.push_back(points.back());
  }
  return result;
}

std::vector<std::string> summary_header() {
  return {"mesh",
          "method",
          "fill at 1k",
          "fill at 10k",
          "s at 1k",
          "s at 10k",
          "spheres for fill A, ×",
          "spheres for fill B, ×",
          "time for fill A, ×",
          "time for fill B, ×"};
}

std::vector<std::vector<std::string>> summary_rows(const PackingComparison& comparison) {
  std::vector<std::vector<std::string>> rows;
  for (const MeshComparison& mesh : comparison.meshes) {
    for (std::size_t m = 0; m < kMethods.size(); ++m) {
      std::vector<std::string> row{m == 0 ? mesh.mesh : "", kMethods[m].name};
      const auto small = mesh.curves[m].at(kSmall), large = mesh.curves[m].at(kLarge);
      for (const auto& point : {small, large}) {
        row.push_back(point ? format("%.4f", point->fill) : "–");
      }
      for (const auto& point : {small, large}) {
        row.push_back(point ? format("%.2f", point->times.cpu) : "–");
      }
      const EqualFill a = equal_fill(mesh, m, kSmall), b = equal_fill(mesh, m, kLarge);
      for (const EqualFill& fill : {a, b}) row.push_back(multiple(fill.reached, fill.spheres));
      for (const EqualFill& fill : {a, b}) row.push_back(multiple(fill.reached, fill.time));
      rows.push_back(std::move(row));
    }
  }
  return rows;
}

std::string finding(const PackingComparison& comparison) {
  std::size_t num_pairs = 0, num_ahead = 0;
  for (const MeshComparison& mesh : comparison.meshes) {
    for (const CurvePoint& ours : mesh.curves[0].points) {
      for (std::size_t m = 1; m < kMethods.size(); ++m) {
        const auto theirs = mesh.curves[m].at(ours.spheres);
        if (!theirs) continue;
        ++num_pairs;
        if (ours.fill > theirs->fill) ++num_ahead;
      }
    }
  }
  std::string text = "With equally many spheres Palpate fills more in " +
                     count_of(num_ahead, num_pairs) + " comparisons.";
  for (const int count : {kSmall, kLarge}) {
    text += " For the fill that it has with " + std::to_string(count) + " spheres, ";
    for (std::size_t m = 1; m < kMethods.size(); ++m) {
      text += effort(comparison, m, count) + (m + 1 < kMethods.size() ? "; " : ".");
    }
  }
  return text;
}

std::string to_csv(const PackingComparison& comparison) {
  std::string csv;
  for (const auto& [name, value] : comparison.facts) csv += "# " + name + ": " + value + "\n";
  for (const std::string& line : comparison.skipped) csv += "# " + line + "\n";
  csv += "mesh,method,spheres,fill,seconds,cpu_seconds,last_radius_m\n";
  for (const MeshComparison& mesh : comparison.meshes) {
    for (std::size_t m = 0; m < kMethods.size(); ++m) {
      for (const CurvePoint& p : mesh.curves[m].reported()) {
        csv += mesh.mesh + "," + kMethods[m].id +
               format(",%d,%.6f,%.4f,%.4f,%.4g\n", p.spheres, p.fill, p.times.wall, p.times.cpu,
                      p.last_radius);
      }
    }
  }
  return csv;
}

std::string to_markdown(const PackingComparison& comparison) {
  const auto line = [](const std::vector<std::string>& cells) {
    std::string text = "|";
    for (const std::string& cell : cells) text += " " + cell + " |";
    return text + "\n";
  };
  const std::vector<std::string> header = summary_header();
  std::string text = line(header) + "|---|---|";
  for (std::size_t i = 2; i < header.size(); ++i) text += "--:|";
  text += "\n";
  for (const auto& row : summary_rows(comparison)) text += line(row);
  return text;
}

}  // namespace palpate::bench
