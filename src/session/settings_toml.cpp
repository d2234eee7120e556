// Settings files.
#define TOML_EXCEPTIONS 0
#include <toml++/toml.h>

#include <algorithm>
#include <vector>

#include "palpate/session/settings_file.h"
#include "src/io/internal/atomic_file.h"
#include "src/session/settings_json.h"

namespace palpate {
namespace {

constexpr std::size_t kLargestFile = 1 << 16;
/// Keys a.b.c nest tables, which the parser takes apart by recursion.
constexpr std::ptrdiff_t kLongestLine = 1000;

Error no_toml(const std::string& file, std::size_t line, std::string_view why) {
  return {Errc::bad_input,
          file + " line " + std::to_string(line) + " is not TOML: " + std::string(why)};
}

/// Whether a line opens a section with something that begins no name: the parser takes for granted
/// that it does not.
bool opens_nothing(std::string_view line) {
  constexpr std::string_view kBlanks = " \t";
  std::size_t at = line.find_first_not_of(kBlanks);
  if (at == line.npos || line[at] != '[') return false;
  if (at + 1 < line.size() && line[at + 1] == '[') ++at;
  at = line.find_first_not_of(kBlanks, at + 1);
  if (at == line.npos) return true;
  const char c = line[at];
  const bool is_word = (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
  return !is_word && std::string_view("_-\"']").find(c) == std::string_view::npos;
}

/// The text without what the parser cannot bear: a byte order mark, letters beyond ASCII (which no
/// key or word has), lines without end and sections without a name.
Result<std::string> harmless(std::string text, const std::string& file) {
  if (text.starts_with("\xEF\xBB\xBF")) text.erase(0, 3);
  for (char& c : text) {
    if (static_cast<unsigned char>(c) > 127) c = '?';
  }
  std::size_t line = 1;
  for (auto at = text.begin(); at != text.end(); ++line) {
    const auto end = std::find(at, text.end(), '\n');
    if (end - at > kLongestLine) return no_toml(file, line, "the line is too long");
    if (opens_nothing({at, end})) return no_toml(file, line, "'[' must be followed by a name");
    at = end == text.end() ? end : end + 1;
  }
  return text;
}

std::optional<SettingValue> value_of(const toml::node& node) {
  if (const auto* const flag = node.as_boolean()) return SettingValue(**flag);
  if (node.is_number()) return SettingValue(*node.value<double>());
  if (const auto* const word = node.as_string()) return SettingValue(**word);
  const toml::array* const array = node.as_array();
  std::vector<double> numbers;
  for (std::size_t i = 0; array != nullptr && i < array->size(); ++i) {
    const toml::node& element = *array->get(i);
    if (!element.is_number()) return std::nullopt;
    numbers.push_back(*element.value<double>());
  }
  return pose_of(numbers);
}

class Reader {
 public:
  Reader(std::string file, SettingTable& table) : file_(std::move(file)), table_(table) {}

  /// The keys that it names.
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

/// With a point so that they stay decimals.
std::string decimal(double value) {
  const std::string text = shortest_decimal(value);
  return text.find_first_of(".e") == std::string::npos ? text + ".0" : text;
}

std::string toml_value(const Setting& setting) {
  const SettingValue value = setting.get();
  switch (setting.kind) {
    case SettingKind::flag: return std::get<bool>(value) ? "true" : "false";
    case SettingKind::whole: return shortest_decimal(std::get<double>(value));
    case SettingKind::number: return decimal(std::get<double>(value));
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
  auto read = read_file(path, kLargestFile);
  if (!read) return read.error();
  const auto text = harmless(*std::move(read), path.string());
  if (!text) return text.error();
  const toml::parse_result document = toml::parse(*text);
  if (!document) {
    const toml::parse_error& error = document.error();
    return no_toml(path.string(), error.source().begin.line, error.description());
  }
  return Reader(path.string(), table).read(document.table());
}

std::string settings_toml(const SettingTable& table) {
  std::string text;
  std::string_view section;
  for (const Setting& setting : table) {
    if (section != setting.section) {
      section = setting.section;
      text += (text.empty() ? "[" : "\n[") + std::string(section) + "]\n";
    }
    // Identity is a pose like any other: as long as nobody gives one, there is none in the file.
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

}  // namespace palpate
