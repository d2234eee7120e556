#include "python/src/bindings.h"

#include <algorithm>

namespace palpate::python {
namespace {

std::string keyword_of(const Setting& setting) {
  std::string word = setting.key();
  std::replace_if(
      word.begin(), word.end(), [](char c) { return c == '.' || c == ' '; }, '_');
  return word;
}

Setting& find(const std::string& word, SettingTable& table) {
  std::vector<Setting*> found;
  std::vector<std::string> words;
  for (Setting& setting : table) {
    words.push_back(keyword_of(setting));
    if (setting.key() == word || words.back() == word) return setting;
    if (setting.name == word) found.push_back(&setting);
  }
  if (found.size() == 1) return *found.front();
  if (found.empty()) {
    throw PalpateError("there is no setting '" + word + "'; the nearest one is '" +
                       nearest_word(word, words) + "'");
  }
  std::string all;
  for (const Setting* setting : found) all += (all.empty() ? "" : ", ") + keyword_of(*setting);
  throw PalpateError("'" + word + "' is the name of several settings: " + all);
}

SettingValue value_of(nb::handle given, const Setting& setting, const std::string& word) {
  if (nb::isinstance<nb::bool_>(given)) return nb::cast<bool>(given);
  if (nb::isinstance<nb::str>(given)) return nb::cast<std::string>(given);
  if (setting.kind == SettingKind::pose) return pose_of(given, word.c_str());
  double number = 0;
  if (nb::try_cast<double>(given, number)) return number;
  const std::string type = nb::cast<std::string>(given.type().attr("__name__"));
  throw PalpateError(word + " takes " + setting.accepted() + ", not an object of type " + type);
}

}  // namespace

void apply(const nb::dict& keywords, SettingTable& table) {
  for (const auto& [key, given] : keywords) {
    const std::string word = nb::cast<std::string>(key);
    Setting& setting = find(word, table);
    check(setting.set(value_of(given, setting, word), word));
  }
}

}  // namespace palpate::python
