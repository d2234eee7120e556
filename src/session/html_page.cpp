#include "src/session/html_page.h"

#include <cmath>

#include "palpate/version.h"
#include "src/session/report_style.h"
#include "src/session/svg_parts.h"

namespace palpate {

Unit unit_for(double largest, std::span<const Unit> units) {
  for (const Unit& unit : units) {
    if (largest * unit.factor >= 1) return unit;
  }
  return units.back();
}

std::string with_unit(double value, std::span<const Unit> units, int digits) {
  const Unit unit = unit_for(std::abs(value), units);
  return short_number(value * unit.factor, digits) + "\u00a0" + unit.name;
}

std::string open_page(const std::string& title, const std::string& subtitle,
                      const std::string& style) {
  return "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
         "<meta name='viewport' content='width=device-width,initial-scale=1'><title>Palpate: " +
         escape_html(title) + "</title><style>" + kReportStyle + style +
         "</style></head><body><main>\n" + "<h1>" + escape_html(title) + "</h1><p class='sub'>" +
         escape_html(subtitle) + "</p>\n";
}

std::string close_page(const std::string& footer) {
  return "<footer>Palpate " PALPATE_VERSION ". " + escape_html(footer) +
         "</footer>\n</main></body></html>\n";
}

std::string card(const std::string& value, const std::string& caption) {
  return "<div class='card'><b>" + escape_html(value) + "</b><span>" + escape_html(caption) +
         "</span></div>";
}

std::string row(const std::string& name, const std::string& value) {
  return "<tr><td>" + escape_html(name) + "</td><td>" + escape_html(value) + "</td></tr>";
}

std::string figure(const std::string& svg, const std::string& caption) {
  return "<figure>" + svg + "<figcaption>" + escape_html(caption) + "</figcaption></figure>\n";
}

}  // namespace palpate
