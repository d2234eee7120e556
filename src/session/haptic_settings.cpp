#include "src/session/haptic_settings.h"

#include <nlohmann/json.hpp>

namespace palpate {
namespace {

using Json = nlohmann::ordered_json;

struct Writer {
  Json& json;

  template <class Value, class... Range>
  void operator()(const SettingName& name, const Value& value, const Range&...) {
    json[name.section][name.key] = value;
  }
  template <class Value, std::size_t n>
  void operator()(const SettingName& name, const Value& value,
                  const std::array<Named<Value>, n>& table) {
    json[name.section][name.key] = name_of(table, value);
  }
  void operator()(const SettingName& name, const Pose& X) {
    const Vec3d& p = X.translation;
    const Quaternion& q = X.rotation;
    json[name.section][name.key] = {p.x, p.y, p.z, q.x, q.y, q.z, q.w};
  }
};

struct Reader {
  const Json& json;
  std::string unknown;  ///< the first name that is not known

  const Json& at(const SettingName& name) const { return json.at(name.section).at(name.key); }

  template <class Value, class... Range>
  void operator()(const SettingName& name, Value& value, const Range&...) {
    at(name).get_to(value);
  }
  template <class Value, std::size_t n>
  void operator()(const SettingName& name, Value& value, const std::array<Named<Value>, n>& table) {
    const auto word = at(name).template get<std::string>();
    if (const auto found = value_of(table, word)) {
      value = *found;
    } else if (unknown.empty()) {
      unknown = std::string(name.section) + "." + name.key + " = " + word;
    }
  }
  void operator()(const SettingName& name, Pose& X) {
    const auto v = at(name).get<std::array<double, 7>>();
    X = {{v[0], v[1], v[2]}, {v[3], v[4], v[5], v[6]}};
  }
};

}  // namespace

Json to_json(const HapticSettings& settings) {
  Json json;
  visit_settings(settings, Writer{json});
  return json;
}

Result<HapticSettings> haptic_settings_from_json(const Json& json) {
  HapticSettings settings;
  Reader reader{json, {}};
  visit_settings(settings, reader);
  if (reader.unknown.empty()) return settings;
  return Error{Errc::bad_input,
               "the settings hold " + reader.unknown + ", which this version does not know"};
}

}  // namespace palpate
