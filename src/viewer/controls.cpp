#include "src/viewer/controls.h"

#include <algorithm>
#include <cmath>
#include <concepts>
#include <optional>
#include <type_traits>

#include "src/session/haptic_settings.h"

namespace palpate {
namespace {

using Json = nlohmann::ordered_json;

std::string key_of(const SettingName& name) { return std::string(name.section) + "." + name.key; }

/// Calls visit(name, value, how...) for every setting of these names but poses.
template <class Settings, class Visit>
void visit_controls(Settings& settings, ControlNames names, Visit&& visit) {
  visit_settings(settings, [&](const SettingName& name, auto& value, const auto&... how) {
    if constexpr (!std::same_as<std::remove_cvref_t<decltype(value)>, Pose>) {
      const auto is_it = [&](std::string_view control) {
        return control == name.section || control == key_of(name);
      };
      if (std::any_of(names.begin(), names.end(), is_it)) visit(name, value, how...);
    }
  });
}

template <class Table>
Json names_in(const Table& table) {
  Json names = Json::array();
  for (const auto& entry : table) names.push_back(std::string(entry.name));
  return names;
}

Json value_json(bool value) { return value; }
template <class Number>
Json value_json(Number value, const SettingRange&) {
  return value;
}
template <class Value, std::size_t n>
Json value_json(const Value& value, const std::array<Named<Value>, n>& table) {
  return name_of(table, value);
}

void describe(Json& control, bool) { control["kind"] = "switch"; }
template <class Number>
void describe(Json& control, Number, const SettingRange& range) {
  control["kind"] = "number";
  control["low"] = range.low;
  control["high"] = range.high;
  if (std::integral<Number>) control["whole"] = true;
}
template <class Value, std::size_t n>
void describe(Json& control, const Value&, const std::array<Named<Value>, n>& table) {
  control["kind"] = "choice";
  control["choices"] = names_in(table);
}

/// What a control can be, where `json` is none of it; else nullopt and the value is set.
std::optional<std::string> take(const Json& json, bool& value) {
  if (!json.is_boolean()) return "true or false";
  value = json.get<bool>();
  return std::nullopt;
}
template <class Number>
std::optional<std::string> take(const Json& json, Number& value, const SettingRange& range) {
  const double number = json.is_number() ? json.get<double>() : NAN;
  if (!(number >= range.low && number <= range.high)) {
    return "a number from " + Json(range.low).dump() + " to " + Json(range.high).dump();
  }
  value = std::integral<Number> ? static_cast<Number>(std::lround(number))
                                : static_cast<Number>(number);
  return std::nullopt;
}
template <class Value, std::size_t n>
std::optional<std::string> take(const Json& json, Value& value,
                                const std::array<Named<Value>, n>& table) {
  const auto found = value_of(table, json.is_string() ? json.get<std::string>() : "");
  if (!found) return "one of " + names_in(table).dump();
  value = *found;
  return std::nullopt;
}

}  // namespace

Json list_controls(const HapticSettings& settings, ControlNames names) {
  Json list = Json::array();
  visit_controls(settings, names,
                 [&](const SettingName& name, const auto& value, const auto&... how) {
                   Json control{{"key", key_of(name)}, {"words", name.words}};
                   describe(control, value, how...);
                   control["value"] = value_json(value, how...);
                   list.push_back(std::move(control));
                 });
  return list;
}

Json control_values(const HapticSettings& settings, ControlNames names) {
  Json values = Json::object();
  visit_controls(settings, names,
                 [&](const SettingName& name, const auto& value, const auto&... how) {
                   values[key_of(name)] = value_json(value, how...);
                 });
  return values;
}

Result<Json> set_control(HapticSettings& settings, ControlNames names, std::string_view key,
                         const Json& json) {
  std::optional<Result<Json>> answer;
  visit_controls(settings, names, [&](const SettingName& name, auto& value, const auto&... how) {
    if (key_of(name) != key) return;
    if (const auto needed = take(json, value, how...)) {
      answer = Error{Errc::invalid_argument, std::string(key) + " must be " + *needed + ", not " +
                                                 json.dump().substr(0, 80)};
    } else {
      answer = value_json(value, how...);
    }
  });
  if (answer) return *answer;
  return Error{Errc::invalid_argument, "there is nothing to turn that is called '" +
                                           std::string(key.substr(0, 80)) +
                                           "'; `controls` of hello lists all"};
}

}  // namespace palpate
