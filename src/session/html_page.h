// The parts that all our pages are made of.
#pragma once

#include <span>
#include <string>

namespace palpate {

/// A unit in which the largest value reads well.
struct Unit {
  const char* name;
  double factor;
};
inline constexpr Unit kLengthUnits[] = {{"m", 1}, {"mm", 1e3}, {"µm", 1e6}};
inline constexpr Unit kVolumeUnits[] = {{"m³", 1}, {"cm³", 1e6}, {"mm³", 1e9}};
inline constexpr Unit kTorqueUnits[] = {{"m⁴", 1}, {"cm⁴", 1e8}, {"mm⁴", 1e12}};
inline constexpr Unit kTimeUnits[] = {{"s", 1}, {"ms", 1e3}, {"µs", 1e6}};

/// The first unit in which `largest` is at least 1, else the last one.
Unit unit_for(double largest, std::span<const Unit> units);
/// The value in a unit that suits it.
std::string with_unit(double value, std::span<const Unit> units, int digits = 3);

/// From the doctype to the title, with one line below it. Both are text, not HTML. `style` is CSS
/// of this page alone.
std::string open_page(const std::string& title, const std::string& subtitle,
                      const std::string& style = "");
std::string close_page(const std::string& footer);

/// A number in large type and what it is.
std::string card(const std::string& value, const std::string& caption);
/// One line of a table: a name and a value.
std::string row(const std::string& name, const std::string& value);
/// `svg` with a caption, which is text.
std::string figure(const std::string& svg, const std::string& caption);

}  // namespace palpate
