// The packing comparison as a page.
#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>

#include "bench/packing_comparison.h"
#include "src/session/report_style.h"
#include "src/session/svg_plot.h"

namespace palpate::bench {
namespace {

// The picture, in its own units; the page scales it.
constexpr double kWidth = 540, kHeight = 300;
constexpr double kLeft = 52, kRight = 14, kTop = 14, kBottom = 40;

constexpr const char* kStyle = R"css(
.pair{display:grid;grid-template-columns:repeat(auto-fit,minmax(400px,1fr));gap:4px 24px}
.pair figure{margin:0}.mark{fill:var(--bg);stroke-width:1.5}
.key{font-size:14px;color:var(--fg)}.key svg{width:34px;height:14px;margin-right:6px;vertical-align:-2px}
.finding{font-size:17px;max-width:80ch;margin:14px 0}.wide{overflow-x:auto}
th{text-align:right;font-weight:600;color:var(--soft);border-bottom:2px solid var(--line);
padding:4px 0 4px 16px;vertical-align:bottom}td{white-space:nowrap}th:nth-child(-n+2),td:nth-child(2){text-align:left}
th:first-child{padding-left:0}tr.ours td{border-top:2px solid var(--line);font-weight:600}
.note{color:var(--soft);font-size:13px;margin:2px 0 0}
)css";

__attribute__((format(printf, 2, 3))) void append(std::string& text, const char* pattern, ...) {
  char buffer[512];
  va_list arguments;
  va_start(arguments, pattern);
  std::vsnprintf(buffer, sizeof buffer, pattern, arguments);
  va_end(arguments);
  text += buffer;
}

// Circle, square, diamond: the methods differ without colour as well.
std::string mark(std::size_t method, double x, double y) {
  std::string svg;
  append(svg, "<path class='mark series%zu' d='", method + 1);
  switch (method) {
    case 0: append(svg, "M%.1f %.1fa3.4 3.4 0 1 0 6.8 0a3.4 3.4 0 1 0-6.8 0z", x - 3.4, y); break;
    case 1: append(svg, "M%.1f %.1fh6v6h-6z", x - 3, y - 3); break;
    default: append(svg, "M%.1f %.1fl4.2 4.2l-4.2 4.2l-4.2-4.2z", x, y - 4.2);
  }
  return svg + "'/>";
}

/// Fill over something positive on a logarithmic axis.
struct FillPlot {
  const char* x_label;
  double (*x_of)(const CurvePoint&);
};
constexpr FillPlot kOverSpheres{"spheres",
                                [](const CurvePoint& p) { return static_cast<double>(p.spheres); }};
constexpr FillPlot kOverTime{"processor time on one thread, s",
                             [](const CurvePoint& p) { return p.times.cpu; }};

// What is drawn of a curve: from the first reported count on, about 20 points per decade.
std::vector<CurvePoint> drawn(const PackingCurve& curve) {
  std::vector<CurvePoint> result;
  double next = kCounts[0];
  for (const CurvePoint& p : curve.points) {
    const bool last = p.spheres == curve.points.back().spheres;
    if (p.spheres < next && !last) continue;
    if (p.spheres < kCounts[0]) continue;
    result.push_back(p);
    next = p.spheres * 1.12;
  }
  return result;
}

std::string tick_text(double value) {
  return value >= 1000 ? short_number(value / 1000) + "k" : short_number(value);
}

std::string draw(const MeshComparison& mesh, const FillPlot& plot) {
  double x_low = HUGE_VAL, x_high = 0, y_low = 1, y_high = 0;
  std::array<std::vector<CurvePoint>, kMethods.size()> lines;
  for (std::size_t m = 0; m < kMethods.size(); ++m) {
    lines[m] = drawn(mesh.curves[m]);
    for (const CurvePoint& p : lines[m]) {
      x_low = std::min(x_low, plot.x_of(p)), x_high = std::max(x_high, plot.x_of(p));
      y_low = std::min(y_low, p.fill), y_high = std::max(y_high, p.fill);
    }
  }
  if (!(x_high > x_low)) return {};
  x_low /= 1.15, x_high *= 1.15;
  constexpr double kTick = 0.1;
  y_low = std::floor(y_low / kTick) * kTick;
  y_high = std::ceil(y_high / kTick) * kTick;
  const double right = kWidth - kRight, bottom = kHeight - kBottom;
  const auto x = [&](double value) {
    return kLeft + (right - kLeft) * std::log(value / x_low) / std::log(x_high / x_low);
  };
  const auto y = [&](double value) {
    return bottom - (bottom - kTop) * (value - y_low) / (y_high - y_low);
  };

  std::string svg;
  append(svg, "<svg viewBox='0 0 %.0f %.0f' role='img' aria-label='", kWidth, kHeight);
  svg += escape_html(mesh.mesh + ": fill over " + plot.x_label) + "'>";
  for (int e = -4; e <= 6; ++e) {
    for (const int lead : {1, 3}) {
      const double value = lead * std::pow(10.0, e);
      if (value < x_low || value > x_high) continue;
      append(svg, "<path class='grid' d='M%.1f %.1fV%.1f'/>", x(value), kTop, bottom);
      append(svg, "<text class='label' x='%.1f' y='%.1f' text-anchor='middle'>%s</text>", x(value),
             bottom + 16, tick_text(value).c_str());
    }
  }
  for (double value = y_low; value < y_high + kTick / 2; value += kTick) {
    append(svg, "<path class='grid' d='M%.1f %.1fH%.1f'/>", kLeft, y(value), right);
    append(svg, "<text class='label' x='%.1f' y='%.1f' text-anchor='end'>%.1f</text>", kLeft - 6,
           y(value) + 4, value);
  }
  append(svg, "<text class='label' x='%.1f' y='%.1f' text-anchor='middle'>%s</text>",
         (kLeft + right) / 2, kHeight - 6, plot.x_label);
  append(svg,
         "<text class='label' text-anchor='middle' transform='translate(12 %.1f) rotate(-90)'>"
         "fill</text>",
         (kTop + bottom) / 2);
  append(svg, "<rect class='axis' x='%.1f' y='%.1f' width='%.1f' height='%.1f'/>", kLeft, kTop,
         right - kLeft, bottom - kTop);
  // Ours last, on top.
  for (std::size_t m = kMethods.size(); m-- > 0;) {
    append(svg, "<path class='curve series%zu' d='", m + 1);
    for (std::size_t i = 0; i < lines[m].size(); ++i) {
      append(svg, "%c%.1f %.1f", i == 0 ? 'M' : 'L', x(plot.x_of(lines[m][i])),
             y(lines[m][i].fill));
    }
    svg += "'/>";
    for (const CurvePoint& p : mesh.curves[m].reported()) {
      if (p.spheres >= kCounts[0]) svg += mark(m, x(plot.x_of(p)), y(p.fill));
    }
  }
  return svg + "</svg>";
}

std::string key() {
  std::string html = "<div class='key'>";
  for (std::size_t m = 0; m < kMethods.size(); ++m) {
    append(html, "<span><svg viewBox='0 0 34 14'><path class='curve series%zu' d='M0 7h34'/>",
           m + 1);
    html += mark(m, 17, 7) + "</svg>" + kMethods[m].name + "</span>";
  }
  return html + "</div>\n";
}

std::string section(const MeshComparison& mesh) {
  std::string html = "<h2>" + escape_html(mesh.mesh) + "</h2>\n<div class='pair'>";
  for (const FillPlot& plot : {kOverSpheres, kOverTime}) {
    html += "<figure>" + draw(mesh, plot) + "</figure>";
  }
  html += "</div>\n";
  for (std::size_t m = 0; m < kMethods.size(); ++m) {
    if (mesh.curves[m].ending.empty()) continue;
    html += "<p class='note'>" + std::string(kMethods[m].name) + ": " +
            escape_html(mesh.curves[m].ending) + "</p>\n";
  }
  return html;
}

std::string table(const PackingComparison& comparison) {
  std::string html = "<div class='wide'><table><thead><tr>";
  for (const std::string& cell : summary_header()) html += "<th>" + cell + "</th>";
  html += "</tr></thead><tbody>\n";
  for (const auto& row : summary_rows(comparison)) {
    html += row[0].empty() ? "<tr>" : "<tr class='ours'>";
    for (const std::string& cell : row) html += "<td>" + escape_html(cell) + "</td>";
    html += "</tr>\n";
  }
  return html + "</tbody></table></div>\n";
}

}  // namespace

std::string to_html(const PackingComparison& comparison) {
  std::string html =
      "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
      "<meta name='viewport' content='width=device-width,initial-scale=1'>"
      "<title>Sphere packing, side by side</title><style>";
  html += kReportStyle;
  html += kStyle;
  html +=
      "</style></head><body><main>\n<h1>Sphere packing, side by side</h1>\n"
      "<p class='sub'>Three ways to fill a solid with disjoint spheres, on the same meshes, in one "
      "run</p>\n";
  html += "<p class='finding'>" + escape_html(finding(comparison)) + "</p>\n";
  for (const std::string& line : comparison.skipped) {
    html += "<p class='warn'>" + escape_html(line) + "</p>\n";
  }
  html += key();
  for (const MeshComparison& mesh : comparison.meshes) html += section(mesh);
  html += "<h2>Summary</h2>\n" + table(comparison);
  html +=
      "<p class='note'>Fill A and fill B are what Palpate fills with 1000 and 10 000 spheres; the "
      "last four columns are multiples of what Palpate needs for them. Times are processor times; "
      "everything runs on one thread. &gt;: so many were not "
      "enough, and the method ended there. –: it ended earlier.</p>\n";
  html +=
      "<h2>What is compared</h2>\n"
      "<p><b>Palpate</b>: <code>pack_spheres</code>, one run for each number of spheres.</p>\n"
      "<p><b>Prototype placement</b>: one random prototype per grid cell and round flees from its "
      "closest obstacle in 50 cooled steps, those of at least " +
      short_number(comparison.prototype_share) +
      " times the largest are inserted, the grid is split as rounds "
      "go by (after Weller and Zachmann 2010; Teuber, Weller and Zachmann 2013).</p>\n"
      "<p><b>Fixed grid</b>: a distance field of " +
      std::to_string(comparison.grid_cells) +
      " cells along the longest side, always the largest sphere that fits around a cell "
      "centre.</p>\n"
      "<p>Both peers are this project's implementations of published descriptions, not their "
      "authors' code, on the CPU, with Palpate's own distance queries. They run once per mesh and "
      "are timed sphere by sphere. Every packing was checked in double precision: all spheres "
      "inside the solid, no two overlap.</p>\n<footer>";
  for (const auto& [name, value] : comparison.facts) {
    html += escape_html(name) + ": " + escape_html(value) + "<br>";
  }
  return html + "</footer>\n</main></body></html>\n";
}

}  // namespace palpate::bench
