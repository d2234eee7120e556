// The words for the values of an enumeration, on the command line, in files and in reports.
//
// An enumeration that counts from 0 is given its words by a function beside it, in their order:
//
//   constexpr auto names_of(Priority) { return std::array{"distance", "count"}; }
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>

namespace palpate {

template <class Enum>
concept NamedEnum = requires(Enum value) {
  names_of(value).size();
};

/// The word for a value, "?" for none of the enumeration.
template <NamedEnum Enum>
std::string name_of(Enum value) {
  constexpr auto names = names_of(Enum{});
  const auto index = static_cast<std::size_t>(value);
  return index < names.size() ? names[index] : "?";
}
/// No value: the program chooses.
template <NamedEnum Enum>
std::string name_of(const std::optional<Enum>& value) {
  return value ? name_of(*value) : "auto";
}

/// The value that a word stands for, or nullopt.
template <NamedEnum Enum>
std::optional<Enum> value_named(std::string_view name) {
  constexpr auto names = names_of(Enum{});
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (name == names[i]) return static_cast<Enum>(i);
  }
  return std::nullopt;
}

}  // namespace palpate
