// What is written over a picture: arrows, labels and a scale, as SVG in the picture's pixels.
#pragma once

#include <string>

#include "src/session/scene_picture.h"

namespace palpate {

std::string svg_text(double x, double y, const char* anchor, const std::string& content);
/// A line with a head at its end, legible on any ground.
std::string svg_arrow(double x1, double y1, double x2, double y2);
/// A round length whose bar is between a tenth and a quarter of the picture wide.
std::string scale_bar(const View& view, double pixels_per_metre);

/// The picture itself, embedded, with the overlay on it and a caption, which is text, below.
std::string picture(const View& view, const std::string& png, const std::string& overlay,
                    const std::string& caption);

}  // namespace palpate
