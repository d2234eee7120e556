#include "src/session/picture_overlay.h"

#include <cmath>
#include <cstdio>

#include "src/session/base64.h"
#include "src/session/svg_plot.h"

namespace palpate {
namespace {

std::string svg_line(const char* css_class, double x1, double y1, double x2, double y2) {
  char text[160];
  std::snprintf(text, sizeof text, "<line class='%s' x1='%.1f' y1='%.1f' x2='%.1f' y2='%.1f'/>",
                css_class, x1, y1, x2, y2);
  return text;
}

}  // namespace

std::string svg_text(double x, double y, const char* anchor, const std::string& content) {
  char text[120];
  std::snprintf(text, sizeof text, "<text x='%.1f' y='%.1f' text-anchor='%s'>", x, y, anchor);
  return text + escape_html(content) + "</text>";
}

std::string svg_arrow(double x1, double y1, double x2, double y2) {
  const double length = std::hypot(x2 - x1, y2 - y1);
  const double ex = (x2 - x1) / length, ey = (y2 - y1) / length;
  char head[200];
  std::snprintf(head, sizeof head, "<path class='ink-fill' d='M%.1f %.1fL%.1f %.1fL%.1f %.1fz'/>",
                x2 + 4 * ex, y2 + 4 * ey, x2 - 11 * ex - 7 * ey, y2 - 11 * ey + 7 * ex,
                x2 - 11 * ex + 7 * ey, y2 - 11 * ey - 7 * ex);
  const double xs = x2 - 8 * ex, ys = y2 - 8 * ey;
  return svg_line("halo-line", x1, y1, xs, ys) + svg_line("ink", x1, y1, xs, ys) + head;
}

std::string scale_bar(const View& view, double pixels_per_metre) {
  double length = std::pow(10.0, std::floor(std::log10(0.25 * view.width / pixels_per_metre)));
  for (const double factor : {5.0, 2.0}) {
    if (length * factor * pixels_per_metre <= 0.25 * view.width) {
      length *= factor;
      break;
    }
  }
  const double x = 18, y = view.height - 18, end = x + length * pixels_per_metre;
  return svg_line("halo-line", x, y, end, y) + svg_line("ink", x, y, end, y) +
         svg_text(x, y - 10, "start",
                  length < 0.01 ? short_number(length * 1000) + " mm"
                                : short_number(length * 100) + " cm");
}

std::string picture(const View& view, const std::string& png, const std::string& overlay,
                    const std::string& caption) {
  char open[120];
  std::snprintf(open, sizeof open, "<svg viewBox='0 0 %d %d'>", view.width, view.height);
  return "<figure><div class='picture'><img alt='' src='data:image/png;base64," + base64(png) +
         "'>" + open + overlay + "</svg></div><figcaption>" + escape_html(caption) +
         "</figcaption></figure>\n";
}

}  // namespace palpate
