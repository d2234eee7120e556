#include "src/session/report_pictures.h"

#include <algorithm>
#include <cmath>

#include "palpate/run/pipeline.h"
#include "src/session/picture_overlay.h"
#include "src/session/scene_picture.h"
#include "src/session/svg_plot.h"

namespace palpate {
namespace {

/// The two axes of the picture, as a small cross of arrows in the lower right corner.
std::string axes(const View& view, const char* to_the_right, const char* vertical,
                 bool vertical_up) {
  const double x = view.width - 92, y = view.height - (vertical_up ? 24 : 84);
  const double tip = y + (vertical_up ? -52 : 52);
  return svg_arrow(x, y, x + 52, y) + svg_arrow(x, y, x, tip) +
         svg_text(x + 64, y + 6, "start", to_the_right) +
         svg_text(x - 10, tip + 6, "end", vertical);
}

/// The force at the centre of mass, one tool radius long if it lies in the picture's plane.
std::string force_arrow(const View& view, const Vec3d& C_W, const Vec3d& force_W, double radius) {
  const Vec3d tip_W = C_W + normalized(force_W) * (1.2 * radius);
  const ScreenPoint from = view.to_screen(C_W), to = view.to_screen(tip_W);
  if (std::hypot(to.x - from.x, to.y - from.y) < 24) return {};
  return svg_arrow(from.x, from.y, to.x, to.y) + svg_text(to.x + 10, to.y + 18, "start", "F");
}

/// Radius of the tool about its centre of mass.
double tool_radius(const Tool& tool) {
  double radius = 0;
  for (const Sphere& s : tool.spheres()) {
    radius = std::max(radius, norm(to_double(s.centre) - tool.sphere_mass().centre_of_mass) +
                                  static_cast<double>(s.radius));
  }
  return radius;
}

}  // namespace

Result<std::string> deepest_moment_html(const Tool& tool, const RunLog& log) {
  const TickRecord& tick = log.deepest;
  const Pose& X_WT = tick.step.X_WT;
  RunSettings settings = log.setup.settings;
  if (tick.revision > 0) settings = log.changes[tick.revision - 1];
  settings.backend = Backend::cpu;  // shows the same, also when a GPU has failed
  settings.time.mode = TimeMode::latest;
  auto surfaces = make_surfaces(log.setup.stream, settings);
  if (!surfaces) return surfaces.error();
  auto part = make_contact_part(ToolIndex::create(tool), settings, {});
  if (!part) return part.error();
  ThreadPool pool(settings.num_threads);
  surfaces->push(log.deepest_frame, 0, pool);
  const PointCloud points = surfaces->newest_cloud(pool);
  const PointCloudView cloud = points.view();
  std::vector<SphereState> states(tool.spheres().size());
  (*part)->query().measure(surfaces->at(0).to, X_WT, {.states = states});

  const Vec3d C_W = X_WT * tool.sphere_mass().centre_of_mass;
  const double radius = tool_radius(tool);
  const bool finite = !tick.penetration.status.has(StepStatus::non_finite_pose);
  if (!finite || !(C_W.z > 0.01)) {
    return std::string(
        "<h2>The deepest moment</h2><p>The tool was not in front of the camera.</p>");
  }
  const std::string slab = short_number(radius * 200, 2) + " cm";
  struct Panel {
    View view;
    std::string overlay, caption;
  };
  const View camera = camera_view(C_W, radius), above = birds_eye_view(C_W, radius),
             side = side_view(C_W, radius);
  const Panel panels[] = {
      {camera, axes(camera, "x", "y", false),
       "As the depth camera sees it, enlarged. The surface is a veil: spheres behind it shine "
       "through. The scale holds at the tool's centre."},
      {above, axes(above, "x", "z", true),
       "From above, without perspective; the camera is below the picture. Only a slice of the "
       "surface is drawn, " +
           slab + " thick, around the tool's centre."},
      {side, axes(side, "z", "y", false),
       "From the side, without perspective; the camera is to the left of the picture. The same "
       "kind of slice."}};
  const bool contact = tick.penetration.volume > 0;
  std::string html = contact
                         ? "<h2>The deepest moment, at " + short_number(tick.time) + " s</h2>"
                         : "<h2>The tool never touched the surface</h2><p>The pictures show the "
                           "start.</p>";
  html += "<div class='pictures'>\n";
  for (const Panel& panel : panels) {
    const View& view = panel.view;
    std::string overlay = scale_bar(view, view.to_screen(C_W).pixels_per_metre) + panel.overlay;
    if (contact) overlay += force_arrow(view, C_W, tick.penetration.measure_W.force, radius);
    html += picture(view, draw_scene_png(view, cloud, tool.spheres(), states, X_WT), overlay,
                    panel.caption);
  }
  html +=
      "</div><div class='key'>"
      "<span><i style='background:#296beb'></i>inside: behind the surface</span>"
      "<span><i style='background:#9e38cc'></i>boundary: at the surface</span>"
      "<span><i style='background:#e03d33'></i>outside: free</span>";
  if (contact) html += "<span>F: direction of the force on the tool</span>";
  return html + "</div>\n";
}

}  // namespace palpate
