#include <algorithm>
#include <cmath>

#include "palpate/session/packing_report.h"
#include "src/session/cut_picture.h"
#include "src/session/html_page.h"
#include "src/session/picture_overlay.h"
#include "src/session/svg_plot.h"

namespace palpate {
namespace {

std::string percent(double share, int digits = 3) {
  return short_number(100 * share, digits) + "\u00a0%";
}

std::string length(double metres) { return with_unit(metres, kLengthUnits); }

std::string vector_text(const Vec3d& v) {
  return short_number(v.x * 1000) + ", " + short_number(v.y * 1000) + ", " +
         short_number(v.z * 1000) + "\u00a0mm";
}

/// What people must know before they use the tool.
std::string warning(const Tool& tool, const PackingStatistics& s) {
  const auto empty = empty_part(tool, s.standoff);
  return empty ? "<p><b>Warning:</b> " + escape_html(*empty) + "</p>\n" : "";
}

std::string headline(const Tool& tool, const PackingStatistics& s) {
  const auto graph = tool.graph();
  return "<div class='cards'>" +
         card(std::to_string(tool.spheres().size()),
              "spheres of " + length(s.smallest_radius) + " to " + length(s.largest_radius)) +
         card(percent(s.fill.back()), "of the mesh is filled") +
         card(length(s.standoff.mean),
              "from the surface to the nearest sphere on average; 95 %: " + length(s.standoff.p95) +
                  ", at most " + length(s.standoff.max) + ", at " + vector_text(s.standoff.worst)) +
         card(std::to_string(graph.num_edges()),
              "edges between neighbours, " + short_number(s.mean_degree, 3) + " per sphere") +
         card(std::to_string(graph.num_components_before_bridging()),
              "connected parts, joined by " + std::to_string(graph.num_bridges()) + " bridges") +
         "</div>";
}

/// The axes of the tool frame, as a small cross in the lower right corner.
std::string axes(const View& view) {
  const double x = view.width - 92, y = view.height - 92, arrow = 46;
  const char* const names[] = {"x", "y", "z"};
  std::string svg;
  for (int axis = 0; axis < 3; ++axis) {
    const double ex = view.right[axis], ey = view.down[axis];
    if (std::hypot(ex, ey) < 0.3) continue;
    svg += svg_arrow(x, y, x + arrow * ex, y + arrow * ey) +
           svg_text(x + (arrow + 16) * ex, y + (arrow + 16) * ey + 6, "middle", names[axis]);
  }
  return svg;
}

std::string pictures(const Tool& tool) {
  const Bounds box = bounds(tool.mesh());
  const Vec3d size = box.high - box.low;
  int shortest = 0, longest = 2;
  for (int axis = 0; axis < 3; ++axis) {
    if (size[axis] < size[shortest]) shortest = axis;
    if (size[axis] > size[longest]) longest = axis;
  }
  const char* const names[] = {"x", "y", "z"};
  std::string html = "<h2>Cut open</h2><div class='pictures'>\n";
  for (const int axis : {shortest, longest}) {
    constexpr int kWidth = 760;
    const Cut cut = cut_across(tool.mesh(), axis, kWidth);
    html += picture(cut.view, draw_cut_png(cut, tool.mesh(), tool.spheres()),
                    scale_bar(cut.view, cut.view.scale) + axes(cut.view),
                    std::string("Cut through the middle, across ") + names[axis] +
                        "; the half towards you is taken away.");
  }
  return html +
         "</div><div class='key'><span><i style='background:#fccc5c'></i>cut spheres</span>"
         "<span><i style='background:#3373e6'></i>whole spheres behind the cut</span>"
         "<span><i style='background:#db333d'></i>wall of the mesh in the cut</span>"
         "<span><i style='background:#8b92a3'></i>wall behind it</span></div>\n";
}

/// Prefix sizes at even steps on a logarithmic axis, all of them where they are few.
std::vector<double> plotted_sizes(std::size_t num_spheres) {
  std::vector<double> sizes;
  for (std::size_t n = 1; n < num_spheres; n = std::max(n + 1, n * 81 / 80)) {
    sizes.push_back(static_cast<double>(n));
  }
  sizes.push_back(static_cast<double>(num_spheres));
  return sizes;
}

std::string law_text(const PowerLaw& law) {
  return short_number(law.factor, 3) + " N^-" + short_number(law.exponent, 3);
}

std::string fill_plots(const PackingStatistics& s) {
  LinePlot fill;
  fill.x_label = "number of spheres";
  fill.y_label = "filled in %";
  fill.log_x = true;
  fill.x = plotted_sizes(s.fill.size());
  LinePlot empty = fill;
  empty.y_label = "empty in %";
  empty.log_y = true;
  PlotLine filled{"filled", "series1", {}}, rest{"empty", "series1", {}}, fitted{"", "series2", {}};
  for (const double n : fill.x) {
    const double share = s.fill[static_cast<std::size_t>(n) - 1];
    filled.y.push_back(100 * share);
    rest.y.push_back(100 * (1 - share));
    const bool is_fitted = s.void_law && n >= s.void_law->first;
    fitted.y.push_back(is_fitted ? 100 * (*s.void_law)(n) : NAN);
  }
  fill.lines.push_back(filled);
  empty.lines.push_back(rest);
  std::string html = "<h2>How full it is</h2>\n";
  html += figure(draw(fill),
                 "Filled share of the mesh over the number of spheres. Spheres are stored in the "
                 "order in which they were packed: the first N of this tool are what packing N "
                 "would have given, and the option --spheres of query and touch takes them.");
  std::string caption = "The empty share on logarithmic axes.";
  if (s.void_law) {
    const PowerLaw& law = *s.void_law;
    fitted.label = law_text(law);
    empty.lines.push_back(fitted);
    caption += " From " + std::to_string(law.first) + " spheres on it follows " + law_text(law) +
               " within " + percent(law.rms, 2) +
               ". The exponent says how fast more spheres help: the Apollonian packing, the best "
               "that spheres can do, has " +
               short_number(kApollonianExponent) + ".";
    if (law.exponent > 0) {
      caption += " Half as much empty space takes " +
                 short_number(std::pow(2, 1 / law.exponent), 2) + " times as many spheres.";
    }
  } else {
    caption += " There are too few spheres to fit a law.";
  }
  return html + figure(draw(empty), caption);
}

std::string radius_plot(const PackingStatistics& s, const Tool& tool) {
  const Unit unit = unit_for(s.median_radius, kLengthUnits);
  Histogram radii;
  radii.x_label = std::string("radius in ") + unit.name;
  radii.y_label = "spheres in bin";
  for (const Sphere& sphere : tool.spheres()) {
    radii.values.push_back(static_cast<double>(sphere.radius) * unit.factor);
  }
  const auto marker = [&](const char* name, double radius) {
    radii.markers.push_back({radius * unit.factor, std::string(name) + " " + length(radius)});
  };
  marker("smallest", s.smallest_radius);
  marker("median", s.median_radius);
  marker("largest", s.largest_radius);
  return "<h2>How large the spheres are</h2>\n" +
         figure(draw(radii), "Radii, counted. Both axes are logarithmic.");
}

std::string standoff_plot(const PackingStatistics& s) {
  const Unit unit = unit_for(s.standoff.mean, kLengthUnits);
  Histogram distances;
  distances.bins = Bins::even;
  distances.x_label = std::string("from the surface to the nearest sphere in ") + unit.name;
  distances.y_label = "points in bin";
  for (const double distance : s.standoff.samples) {
    distances.values.push_back(std::max(0.0, distance) * unit.factor);
  }
  const auto marker = [&](const char* name, double metres) {
    distances.markers.push_back({metres * unit.factor, std::string(name) + " " + length(metres)});
  };
  marker("mean", s.standoff.mean);
  marker("95 %", s.standoff.p95);
  marker("largest", s.standoff.max);
  return "<h2>How late a contact is felt</h2>\n" +
         figure(draw(distances),
                "Spheres fill the inside and never quite reach the surface: a tool that touches "
                "with its surface feels nothing until the first sphere touches. Distances from " +
                    std::to_string(s.standoff.samples.size()) +
                    " points spread evenly over the surface. The largest, " +
                    length(s.standoff.max) +
                    ", is that of the worst of these points and all corners, at x, y, z = " +
                    vector_text(s.standoff.worst) + " of the tool frame.");
}

std::string degree_plot(const PackingStatistics& s) {
  Histogram degrees;
  degrees.bins = Bins::whole_numbers;
  degrees.x_label = "neighbours of a sphere";
  degrees.y_label = "spheres in bin";
  degrees.values.assign(s.degrees.begin(), s.degrees.end());
  const auto marker = [&](const char* name, int degree) {
    degrees.markers.push_back({static_cast<double>(degree), name + std::to_string(degree)});
  };
  marker("median ", s.median_degree);
  marker("99 % ", s.p99_degree);
  marker("most ", s.max_degree);
  return "<h2>How the spheres are connected</h2>\n" +
         figure(draw(degrees),
                "Neighbours in the leaf graph, counted. Large spheres have many small neighbours.");
}

/// The diagonal and the upper triangle, in g cm2 for a density of 1 g/cm3.
std::pair<std::string, std::string> inertia_text(const Mat3d& inertia) {
  constexpr double kGramSquareCentimetres = 1e10;  // density 1000 kg/m3, then 1e7 g cm2 per kg m2
  const auto number = [&](int i, int k) {
    return short_number(inertia.m[i][k] * kGramSquareCentimetres);
  };
  return {number(0, 0) + ", " + number(1, 1) + ", " + number(2, 2),
          number(0, 1) + ", " + number(0, 2) + ", " + number(1, 2)};
}

std::string mass_table(const Tool& tool, const PackingStatistics& s) {
  const MassProperties &spheres = tool.sphere_mass(), &mesh = tool.mesh_mass();
  const auto line = [](const char* name, const std::string& a, const std::string& b) {
    return std::string("<tr><td>") + name + "</td><td>" + escape_html(a) + "</td><td>" +
           escape_html(b) + "</td></tr>";
  };
  const auto sphere_inertia = inertia_text(spheres.inertia),
             mesh_inertia = inertia_text(mesh.inertia);
  return "<h2>Mass</h2><table>" + line("", "spheres", "mesh") +
         line("volume", with_unit(spheres.volume, kVolumeUnits, 6),
              with_unit(mesh.volume, kVolumeUnits, 6)) +
         line("volumes that the spheres stand for, together",
              with_unit(s.represented_volume, kVolumeUnits, 6),
              with_unit(mesh.volume, kVolumeUnits, 6)) +
         line("centre of mass x, y, z", vector_text(spheres.centre_of_mass),
              vector_text(mesh.centre_of_mass)) +
         line("inertia xx, yy, zz in g\u00a0cm² at 1\u00a0g/cm³", sphere_inertia.first,
              mesh_inertia.first) +
         line("xy, xz, yz", sphere_inertia.second, mesh_inertia.second) +
         "</table><p class='sub'>Contacts are measured with the spheres and about their centre of "
         "mass.</p>\n";
}

std::string tables(const Tool& tool, const PackingStatistics& s, const PackingNotes& notes) {
  const LeafGraph& graph = tool.graph();
  const bool relative = tool.gap_rule() == GapRule::relative;
  std::string left = row("mesh", tool.source()) +
                     row("triangles", std::to_string(tool.mesh().triangles.size())) +
                     row("tree nodes", std::to_string(tool.tree().nodes().size())) +
                     row("gap rule", relative ? "relative: at most half the smaller radius"
                                              : "absolute: less than twice the smallest radius") +
                     row("edges", std::to_string(graph.num_edges())) +
                     row("of these bridges", std::to_string(graph.num_bridges())) +
                     row("connected parts without bridges",
                         std::to_string(graph.num_components_before_bridging())) +
                     row("neighbours: mean / median",
                         short_number(s.mean_degree, 3) + " / " + std::to_string(s.median_degree)) +
                     row("neighbours: 90 % / 99 % / most",
                         std::to_string(s.p90_degree) + " / " + std::to_string(s.p99_degree) +
                             " / " + std::to_string(s.max_degree));
  std::string right;
  if (!notes.stopped.empty()) right += row("no more spheres because", notes.stopped);
  for (const auto& [name, value] : notes.options) right += row(name, value);
  for (const auto& [name, seconds] : notes.step_seconds) {
    right += row("time: " + name, with_unit(seconds, kTimeUnits));
  }
  return "<h2>Details</h2><div class='tables'><table>" + left + "</table><table>" + right +
         "</table></div>\n";
}

}  // namespace

std::string packing_page(const Tool& tool, const PackingStatistics& statistics,
                         const PackingNotes& notes) {
  const Bounds box = bounds(tool.mesh());
  const Vec3d size = (box.high - box.low) * 1000;
  return open_page(tool.source(), "A tool of " + short_number(size.x, 3) + " × " +
                                      short_number(size.y, 3) + " × " + short_number(size.z, 3) +
                                      "\u00a0mm, filled with " +
                                      std::to_string(tool.spheres().size()) + " spheres.") +
         headline(tool, statistics) + warning(tool, statistics) + pictures(tool) +
         fill_plots(statistics) + radius_plot(statistics, tool) + standoff_plot(statistics) +
         degree_plot(statistics) + mass_table(tool, statistics) + tables(tool, statistics, notes) +
         close_page(
             "The spheres and edges themselves: palpate export. The main numbers for "
             "programs: palpate info --json.");
}

}  // namespace palpate
