#include "src/session/recording/change_list.h"

#include <nlohmann/json.hpp>

#include "src/session/internal/settings_json.h"

namespace palpate { inline namespace v0 {

void ChangeList::add(const RunSettings& settings) {
  using Json = nlohmann::ordered_json;
  const Json before = to_json(settings_of(before_)), after = to_json(settings_of(settings));
  Json changed = Json::object();
  for (const auto& [section, keys] : after.items()) {
    for (const auto& [key, value] : keys.items()) {
      if (value != before[section][key]) changed[section][key] = value;
    }
  }
  before_ = settings;
  ++num_;
  if (first_.size() < kNumKept) return first_.push_back(changed.dump());
  last_.push_back(changed.dump());
  if (last_.size() > kNumKept) last_.pop_front();
}

nlohmann::ordered_json ChangeList::json() const {
  auto list = nlohmann::ordered_json::array();
  for (const std::string& change : first_) list.push_back(nlohmann::ordered_json::parse(change));
  for (const std::string& change : last_) list.push_back(nlohmann::ordered_json::parse(change));
  return list;
}

}}  // namespace palpate::v0
