// A plot of the evaluation as inline SVG: each curve with its own x, named where it ends. Colours
// come from classes ("m-weighted" ...), which the page defines for light and dark.
#pragma once

#include <string>

#include "eval/figure.h"

namespace palpate::eval {

std::string draw(const Plot& plot);

/// The class of a style; styles that are not known share the class of "other1".
std::string style_class(const std::string& style);

}  // namespace palpate::eval
