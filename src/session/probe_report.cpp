#include "src/session/probe_report.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <vector>

#include "src/session/picture_overlay.h"
#include "src/session/scene_picture.h"
#include "src/session/svg_parts.h"

namespace palpate {
namespace {

constexpr int kMostColumns = 600;  // of the picture

/// The range in which nearly all measurements lie, counts.
std::pair<double, double> depth_range(const DepthFrame& frame) {
  std::vector<std::uint16_t> counts;
  for (const std::uint16_t count : frame.pixels) {
    if (count > 0 && count < 65535) counts.push_back(count);
  }
  if (counts.empty()) return {0, 1};
  std::sort(counts.begin(), counts.end());
  const auto at = [&](double share) {
    return static_cast<double>(
        counts[static_cast<std::size_t>(share * static_cast<double>(counts.size() - 1))]);
  };
  return {at(0.01), std::max(at(0.95), at(0.01) + 1)};
}

/// Near is bright; what is not measured stays transparent.
std::string depth_png(const DepthFrame& frame, const View& view) {
  const auto [low, high] = depth_range(frame);
  std::vector<std::uint8_t> rgba;
  for (int y = 0; y < view.height; ++y) {
    for (int x = 0; x < view.width; ++x) {
      const std::size_t u = static_cast<std::size_t>(x) * static_cast<std::size_t>(frame.width) /
                            static_cast<std::size_t>(view.width);
      const std::size_t v = static_cast<std::size_t>(y) * static_cast<std::size_t>(frame.height) /
                            static_cast<std::size_t>(view.height);
      const std::uint16_t count = frame.pixels[v * static_cast<std::size_t>(frame.width) + u];
      const double far = std::clamp((count - low) / (high - low), 0.0, 1.0);
      const auto grey = static_cast<std::uint8_t>(60 + 180 * (1 - far));
      const bool is_measured = count > 0 && count < 65535;
      rgba.insert(rgba.end(), {grey, grey, grey, static_cast<std::uint8_t>(is_measured ? 255 : 0)});
    }
  }
  return encode_png(rgba, view.width, view.height);
}

std::string ring(double x, double y) {
  char text[240];
  std::snprintf(text, sizeof text,
                "<circle class='halo-line' cx='%.1f' cy='%.1f' r='15'/>"
                "<circle class='ink' cx='%.1f' cy='%.1f' r='15'/>"
                "<circle class='ink-fill' cx='%.1f' cy='%.1f' r='3'/>",
                x, y, x, y, x, y);
  return text;
}

}  // namespace

std::string probe_words(const ProbeChoice& probe) {
  char text[400];
  std::snprintf(
      text, sizeof text,
      "It probes the pixel %.0f,%.0f, where the surface is at %.3f, %.3f, %.3f m when the "
      "tool arrives after %.3g s: %s. It leads with the tool's point %.4f, %.4f, %.4f m: "
      "%s.",
      probe.u, probe.v, probe.p_W.x, probe.p_W.y, probe.p_W.z, probe.time, probe.why_place.c_str(),
      probe.tip_T.x, probe.tip_T.y, probe.tip_T.z, probe.why_tip.c_str());
  return text;
}

std::string probe_html(const ProbeChoice& probe, const DepthFrame& frame) {
  std::string html = "<h2>Where it probes</h2>\n";
  if (!probe.note.empty()) html += "<p class='warn'>" + escape_html(probe.note) + ".</p>\n";
  html += "<p>Nobody gave a path, so the program made one. " + escape_html(probe_words(probe)) +
          " To choose otherwise, " + escape_html(kHowToAim) + ".</p>\n";
  if (frame.pixels.empty()) return html;
  View view;
  view.width = std::min(kMostColumns, frame.width);
  view.height = std::max(1, frame.height * view.width / frame.width);
  const double scale = static_cast<double>(view.width) / frame.width;
  const double x = (probe.u + 0.5) * scale, y = (probe.v + 0.5) * scale;
  const bool at_right = x > 0.7 * view.width;
  const std::string name =
      short_number(std::round(probe.u)) + ", " + short_number(std::round(probe.v));
  const std::string overlay =
      ring(x, y) + svg_text(at_right ? x - 22 : x + 22, y + 6, at_right ? "end" : "start", name) +
      svg_text(8, 22, "start", "0, 0") +
      svg_text(view.width - 8, view.height - 10, "end",
               std::to_string(frame.width - 1) + ", " + std::to_string(frame.height - 1));
  return html + "<div class='pictures' style='max-width:640px'>" +
         picture(view, depth_png(frame, view), overlay,
                 "The depth image at the deepest moment, near is bright, with the probed pixel. "
                 "The numbers in the corners are pixels u, v for --probe.") +
         "</div>\n";
}

}  // namespace palpate
