// Settings files.
#include <algorithm>
#include <vector>

#include "palpate/session/run.h"
#include "src/io/internal/toml_file.h"
#include "src/session/internal/settings_json.h"

namespace palpate { inline namespace v0 {
namespace {

std::optional<SettingValue> value_of(const toml::node& node) {
  if (const auto* const flag = node.as_boolean()) return SettingValue(**flag);
  if (node.is_number()) return SettingValue(number_of(node));
  if (const auto* const word = node.as_string()) return SettingValue(**word);
  const toml::array* const array = node.as_array();
  std::vector<double> numbers;
  for (std::size_t i = 0; array != nullptr && i < array->size(); ++i) {
    const toml::node& element = *array->get(i);
    if (!element.is_number()) return std::nullopt;
    numbers.push_back(number_of(element));
  }
  return pose_of(numbers);
}

class Reader {
 public:
  Reader(std::string file, SettingTable& table) : file_(std::move(file)), table_(table) {}

  /// Reads a document; returns the keys that it names.
  Result<std::vector<std::string>> read(const toml::table& document) {
    for (const auto& [name, node] : document) {
      const std::vector<std::string> names = names_in(name.str());
      if (node.as_table() == nullptr || names.empty()) return no_section(name);
      for (const auto& [key, value] : *node.as_table()) {
        const Status status = set(std::string(name.str()), names, key, value);
        if (!status) return status.error();
      }
    }
    return std::move(keys_);
  }

 private:
  std::vector<std::string> names_in(std::string_view section) const {
    std::vector<std::string> names;
    for (const Setting& setting : table_) {
      if (setting.section == section) names.emplace_back(setting.name);
    }
    return names;
  }
  Error no_section(const toml::key& name) const {
    std::vector<std::string> sections;
    for (const Setting& setting : table_) sections.emplace_back(setting.section);
    return refuse(name.source(), "there is no section [" + std::string(name.str()) +
                                     "]; the nearest one is [" +
                                     nearest_word(name.str(), sections) + "]");
  }
  Status set(const std::string& section, const std::vector<std::string>& names,
             const toml::key& key, const toml::node& node) {
    Setting* const setting = table_.find(section + "." + std::string(key.str()));
    if (setting == nullptr) {
      return refuse(key.source(), "[" + section + "] has no key '" + std::string(key.str()) +
                                      "'; the nearest one is '" + nearest_word(key.str(), names) +
                                      "'");
    }
    const auto value = value_of(node);
    if (!value) {
      return refuse(node.source(), setting->key() + " must be " + setting->accepted());
    }
    const Status status = setting->set(*value);
    if (!status) return refuse(node.source(), status.error().message);
    keys_.push_back(setting->key());
    return Done{};
  }
  Error refuse(const toml::source_region& where, const std::string& what) const {
    return {Errc::bad_input, file_ + " line " + std::to_string(where.begin.line) + ": " + what +
                                 "; palpate touch --print-settings shows them all"};
  }

  std::string file_;
  SettingTable& table_;
  std::vector<std::string> keys_;
};

/// Returns a number with a point or an exponent, so that it stays a decimal.
std::string decimal(double value) {
  const std::string text = shortest_decimal(value);
  return text.find_first_of(".e") == std::string::npos ? text + ".0" : text;
}

std::string toml_value(const Setting& setting) {
  const SettingValue value = setting.get();
  switch (setting.kind) {
    case SettingKind::flag: return std::get<bool>(value) ? "true" : "false";
    case SettingKind::whole: return shortest_decimal(std::get<double>(value));
    case SettingKind::number:
      if (const double* const number = std::get_if<double>(&value)) return decimal(*number);
      [[fallthrough]];
    case SettingKind::word: return '"' + std::get<std::string>(value) + '"';
    case SettingKind::pose: break;
  }
  std::string list;
  for (const double v : seven_numbers(std::get<Pose>(value))) {
    list += (list.empty() ? "[" : ", ") + decimal(v);
  }
  return list + "]";
}

}  // namespace

Result<std::vector<std::string>> read_settings_file(const std::filesystem::path& path,
                                                    SettingTable table) {
  const auto document = read_toml(path);
  if (!document) return document.error();
  return Reader(path.string(), table).read(*document);
}

DepthAverage usual_average(std::span<const DepthStreamInfo> streams) noexcept {
  const bool moves = std::ranges::any_of(streams, &DepthStreamInfo::is_moving);
  return moves ? DepthAverage::none : DepthAverage::kalman;
}

std::string settings_toml(const SettingTable& table) {
  std::string text;
  std::string_view section;
  for (const Setting& setting : table) {
    if (section != setting.section) {
      section = setting.section;
      text += (text.empty() ? "[" : "\n[") + std::string(section) + "]\n";
    }
    // Identity is a pose like any other, so a pose that is not set is left out of the file.
    const bool is_left_out =
        setting.kind == SettingKind::pose && std::get<Pose>(setting.get()) == Pose{};
    std::string line =
        (is_left_out ? "# " : "") + std::string(setting.name) + " = " + toml_value(setting);
    line.resize(std::max<std::size_t>(line.size(), 34), ' ');
    const std::string range = setting.range_text();
    text += line + "  # " + std::string(setting.help) + (range.empty() ? "" : " (" + range + ")") +
            "\n";
  }
  return text;
}

}}  // namespace palpate::v0
