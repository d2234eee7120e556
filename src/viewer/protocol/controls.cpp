#include "src/viewer/protocol/controls.h"

#include <cmath>
#include <string>
#include <vector>

#include "src/session/internal/settings_json.h"

namespace palpate { inline namespace v0 {
namespace {

using Json = nlohmann::ordered_json;

Error no_control(const SettingTable& table, IsControl is_control, std::string_view key) {
  if (const Setting* const setting = table.find(key)) {
    return {Errc::invalid_argument,
            setting->key() + " cannot change here: it is as it was when the run began"};
  }
  std::vector<std::string> keys;
  for (const Setting& setting : table) {
    if (is_control(setting)) keys.push_back(setting.key());
  }
  return {Errc::invalid_argument, "there is no setting '" + std::string(key.substr(0, 80)) +
                                      "'; the nearest one is '" + nearest_word(key, keys) + "'"};
}

}  // namespace

Json list_controls(const SettingTable& table, IsControl is_control) {
  Json list = Json::array();
  for (const Setting& setting : table) {
    if (!is_control(setting)) continue;
    Json control{
        {"key", setting.key()}, {"words", std::string(setting.help)}, {"unit", setting.range.unit}};
    switch (setting.kind) {
      case SettingKind::flag: control["kind"] = "switch"; break;
      case SettingKind::word:
        control["kind"] = "choice";
        control["choices"] = setting.words;
        break;
      case SettingKind::whole: control["whole"] = true; [[fallthrough]];
      case SettingKind::number:
        control["kind"] = "number";
        if (!setting.words.empty()) control["choices"] = setting.words;
        control["low"] = setting.range.low;
        control["high"] = setting.range.high;
        break;
      case SettingKind::pose: continue;  // the page has no way to show one
    }
    control["value"] = value_to_json(setting);
    list.push_back(std::move(control));
  }
  return list;
}

Json control_values(const SettingTable& table, IsControl is_control) {
  Json values = Json::object();
  auto& members = values.get_ref<Json::object_t&>();
  for (const Setting& setting : table) {
    // Each key comes once. Looking for it in an ordered object takes as long as there are members.
    if (is_control(setting)) members.emplace_back(setting.key(), value_to_json(setting));
  }
  return values;
}

Result<Json> set_control(SettingTable table, IsControl is_control, std::string_view key,
                         const Json& json) {
  Setting* const setting = table.find(key);
  if (setting == nullptr || !is_control(*setting)) return no_control(table, is_control, key);
  auto value = value_from_json(json);
  if (!value) {
    return Error{Errc::invalid_argument, setting->key() + " must be " + setting->accepted() +
                                             ", not " + json.dump().substr(0, 80)};
  }
  double* const number = std::get_if<double>(&*value);
  const bool is_whole = setting->kind == SettingKind::whole && number != nullptr;
  if (is_whole && setting->range.holds(*number)) *number = std::round(*number);
  if (const Status status = setting->set(*value); !status) return status.error();
  return value_to_json(*setting);
}

}}  // namespace palpate::v0
