// Settings as people write them.
#define TOML_EXCEPTIONS 0
#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "palpate/io/atomic_file.h"
#include "palpate/session/haptic_run.h"
#include "src/session/haptic_settings.h"
#include "src/session/svg_plot.h"

namespace palpate {
namespace {

constexpr std::size_t kLargestFile = 1 << 20;

/// Insertions, deletions and replacements that make one word of the other.
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i);
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i - 1] != b[j - 1]);
      diagonal = std::exchange(row[j], std::min({row[j] + 1, row[j - 1] + 1, replaced}));
    }
  }
  return row.back();
}

std::string nearest(std::string_view word, const std::vector<std::string>& known) {
  return *std::min_element(known.begin(), known.end(), [&](const auto& a, const auto& b) {
    return edit_distance(word, a) < edit_distance(word, b);
  });
}

template <class Table>
std::string names_in(const Table& table) {
  std::string text;
  for (const auto& entry : table) text += (text.empty() ? "" : ", ") + std::string(entry.name);
  return text;
}

/// Reads what a document holds, and keeps the first complaint.
class Reader {
 public:
  Reader(const toml::table& document, std::string file)
      : document_(document), file_(std::move(file)) {}

  const Status& status() const { return status_; }

  void operator()(const SettingName& name, bool& value) {
    if (const toml::node* node = find(name)) {
      if (!node->is_boolean()) return refuse(*node, name, "must be true or false");
      value = **node->as_boolean();
    }
  }
  void operator()(const SettingName& name, double& value, const SettingRange& range) {
    if (const toml::node* node = find(name)) {
      const auto number = node->value<double>();
      if (!node->is_number() || !number || !(*number >= range.low && *number <= range.high)) {
        return refuse(*node, name, "must be a number from " + words(range));
      }
      value = *number;
    }
  }
  void operator()(const SettingName& name, int& value, const SettingRange& range) {
    if (const toml::node* node = find(name)) {
      const auto number = node->value_exact<std::int64_t>();
      if (!number || !(static_cast<double>(*number) >= range.low &&
                       static_cast<double>(*number) <= range.high)) {
        return refuse(*node, name, "must be a whole number from " + words(range));
      }
      value = static_cast<int>(*number);
    }
  }
  template <class Value, std::size_t n>
  void operator()(const SettingName& name, Value& value, const std::array<Named<Value>, n>& table) {
    if (const toml::node* node = find(name)) {
      const auto word = node->value_exact<std::string>();
      const auto found = word ? value_of(table, *word) : std::nullopt;
      if (!found) return refuse(*node, name, "must be one of the words " + names_in(table));
      value = *found;
    }
  }
  void operator()(const SettingName& name, Pose& X) {
    if (const toml::node* node = find(name)) {
      const toml::array* array = node->as_array();
      double v[7] = {};
      bool good = array != nullptr && array->size() == 7;
      for (std::size_t i = 0; good && i < 7; ++i) {
        const toml::node& element = *array->get(i);
        v[i] = element.is_number() ? element.value<double>().value_or(NAN) : NAN;
        good = std::abs(v[i]) <= 1e3;
      }
      const double length = std::sqrt(v[3] * v[3] + v[4] * v[4] + v[5] * v[5] + v[6] * v[6]);
      if (!good || std::abs(length - 1) > 1e-3) {
        return refuse(*node, name,
                      "must be seven numbers: x, y, z in metres and a unit quaternion x, y, z, w");
      }
      X = {{v[0], v[1], v[2]}, normalized(Quaternion{v[3], v[4], v[5], v[6]})};
    }
  }

  /// Sections and keys that nobody asked for; after all the others.
  void check_unknown() {
    for (const auto& [section, node] : document_) {
      const toml::table* table = node.as_table();
      const auto known = keys_.find(std::string(section.str()));
      if (known == keys_.end() || table == nullptr) {
        std::vector<std::string> sections;
        for (const auto& [name, keys] : keys_) sections.push_back(name);
        return complain(section.source().begin.line,
                        "there is no section [" + std::string(section.str()) +
                            "]; the nearest one is [" + nearest(section.str(), sections) + "]");
      }
      for (const auto& [key, value] : *table) {
        const std::vector<std::string>& keys = known->second;
        if (std::find(keys.begin(), keys.end(), key.str()) != keys.end()) continue;
        return complain(key.source().begin.line, "[" + std::string(section.str()) +
                                                     "] has no key '" + std::string(key.str()) +
                                                     "'; the nearest one is '" +
                                                     nearest(key.str(), keys) + "'");
      }
    }
  }

 private:
  const toml::node* find(const SettingName& name) {
    keys_[name.section].push_back(name.key);
    const toml::table* section = document_[name.section].as_table();
    return section == nullptr ? nullptr : section->get(name.key);
  }
  static std::string words(const SettingRange& range) {
    return short_number(range.low) + " to " + short_number(range.high);
  }
  void refuse(const toml::node& node, const SettingName& name, const std::string& what) {
    complain(node.source().begin.line,
             "[" + std::string(name.section) + "] " + name.key + " " + what);
  }
  void complain(toml::source_index line, const std::string& what) {
    if (!status_) return;
    status_ = Error{Errc::bad_input, file_ + " line " + std::to_string(line) + ": " + what +
                                         "; palpate touch --print-settings shows them all"};
  }

  const toml::table& document_;
  std::string file_;
  Status status_ = Done{};
  std::map<std::string, std::vector<std::string>> keys_;
};

/// The shortest decimals that read back to the same bits, and a point so that they stay decimals.
std::string decimal(double value) {
  char buffer[32];
  std::string text(buffer, std::to_chars(buffer, buffer + sizeof buffer, value).ptr);
  return text.find_first_of(".e") == std::string::npos ? text + ".0" : text;
}

struct Printer {
  std::string text, section;

  void operator()(const SettingName& name, bool value) { line(name, value ? "true" : "false", ""); }
  void operator()(const SettingName& name, double value, const SettingRange& range) {
    line(name, decimal(value), words(range));
  }
  void operator()(const SettingName& name, int value, const SettingRange& range) {
    line(name, std::to_string(value), words(range));
  }
  template <class Value, std::size_t n>
  void operator()(const SettingName& name, const Value& value,
                  const std::array<Named<Value>, n>& table) {
    line(name, "\"" + name_of(table, value) + "\"", ": " + names_in(table));
  }
  void operator()(const SettingName& name, const Pose& X) {
    const Vec3d& p = X.translation;
    const Quaternion& q = X.rotation;
    std::string list;
    for (const double v : {p.x, p.y, p.z, q.x, q.y, q.z, q.w}) {
      list += (list.empty() ? "[" : ", ") + decimal(v);
    }
    line(name, list + "]", "");
  }

 private:
  static std::string words(const SettingRange& range) {
    return " (" + short_number(range.low) + " to " + short_number(range.high) + ")";
  }
  void line(const SettingName& name, const std::string& value, const std::string& more) {
    if (section != name.section) {
      section = name.section;
      text += (text.empty() ? "[" : "\n[") + section + "]\n";
    }
    std::string start = std::string(name.key) + " = " + value;
    start.resize(std::max<std::size_t>(start.size(), 34), ' ');
    text += start + "  # " + name.words + more + "\n";
  }
};

}  // namespace

Result<HapticSettings> load_haptic_settings(const std::filesystem::path& path,
                                            const HapticSettings& defaults) {
  const auto text = read_file(path, kLargestFile);
  if (!text) return text.error();
  const toml::parse_result document = toml::parse(*text);
  if (!document) {
    return Error{Errc::bad_input,
                 path.string() + " line " + std::to_string(document.error().source().begin.line) +
                     " is not TOML: " + std::string(document.error().description())};
  }
  HapticSettings settings = defaults;
  Reader reader(document.table(), path.string());
  visit_settings(settings, reader);
  reader.check_unknown();
  if (!reader.status()) return reader.status().error();
  return settings;
}

std::string haptic_settings_toml(const HapticSettings& settings) {
  Printer printer;
  visit_settings(settings, printer);
  return printer.text;
}

}  // namespace palpate
