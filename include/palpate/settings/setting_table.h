// Tables of settings: the members of an options struct by name, with unit, range and meaning.
// Files, command line, viewer and recordings all use them.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "palpate/core/core.h"
#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

// Keywords for the values of an enumeration, on the command line, in files and in reports.
//
// An enumeration that counts from 0 gets its keywords, in order, from a function beside it:
//
//   constexpr auto names_of(Priority) { return std::array{"distance", "count"}; }

template <class Enum>
concept NamedEnum = requires(Enum value) {
  names_of(value).size();
};

/// The enumerator with a value as the source spells it; empty if there is none.
template <auto kValue>
constexpr auto identifier_of() {
  constexpr std::string_view kBefore = "kValue = ";
  std::string_view text = __PRETTY_FUNCTION__;
  text.remove_prefix(text.find(kBefore) + kBefore.size());  // "ns::Enum::name]" or "(ns::Enum)7]"
  text.remove_suffix(1);
  return text.front() == '(' ? std::string_view() : text.substr(text.rfind(':') + 1);
}

/// True if there is a keyword for each enumerator, and none that is another's identifier.
template <NamedEnum Enum, std::size_t... i>
constexpr bool names_each(std::index_sequence<i...>) {
  constexpr std::size_t num = sizeof...(i);
  constexpr auto names = names_of(Enum{});
  constexpr std::string_view identifiers[] = {identifier_of<static_cast<Enum>(i)>()...,
                                              identifier_of<static_cast<Enum>(num)>()};
  for (std::size_t own = 0; own < num; ++own) {
    if (identifiers[own].empty()) return false;
    for (std::size_t other = 0; other < num; ++other) {
      if (other != own && names[own] == identifiers[other]) return false;
    }
  }
  return identifiers[num].empty();
}

/// The keywords of an enumeration, checked against its enumerators.
template <NamedEnum Enum>
constexpr auto checked_names() {
  static_assert(names_each<Enum>(std::make_index_sequence<names_of(Enum{}).size()>()),
                "names_of needs a name for each enumerator, in their order");
  return names_of(Enum{});
}

/// The keyword of a value; "?" if the value is not in the enumeration.
template <NamedEnum Enum>
std::string name_of(Enum value) {
  constexpr auto names = checked_names<Enum>();
  const auto index = static_cast<std::size_t>(value);
  return index < names.size() ? names[index] : "?";
}
/// No value ("auto"): the program chooses.
template <NamedEnum Enum>
std::string name_of(const std::optional<Enum>& value) {
  return value ? name_of(*value) : "auto";
}

/// The value of a keyword, or nullopt.
template <NamedEnum Enum>
std::optional<Enum> value_named(std::string_view name) {
  constexpr auto names = checked_names<Enum>();
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (name == names[i]) return static_cast<Enum>(i);
  }
  return std::nullopt;
}

/// The valid range of a number, both ends included.
struct NumberRange {
  double low = 0, high = 0;
  const char* unit = "";  ///< SI, or what is counted; empty: a plain number

  bool holds(double value) const { return value >= low && value <= high; }  ///< NaN: false
};

/// The value of a setting. Integers are stored as double.
using SettingValue = std::variant<bool, double, std::string, Pose>;

enum class SettingKind { flag, whole, number, word, pose };

/// One member of an options struct. The struct must outlive it.
class Setting {
 public:
  std::string_view section;  ///< in files: "coupling"; empty for the table of a part
  std::string name;          ///< within its section: "stiffness"
  std::string_view help;     ///< the meaning, in one line
  SettingKind kind = SettingKind::flag;
  NumberRange range;               ///< for numbers
  std::vector<const char*> words;  ///< all keywords; of a number: "auto" if it may have no value

  /// The full name: "coupling.stiffness".
  std::string key() const;
  /// The current value.
  SettingValue get() const;
  /// Sets the value. Errors: another kind, or out of range; nothing changes then. The message has
  /// the name (`reported_name`, or the key), the accepted range with its unit, and the value.
  Status set(const SettingValue& value, std::string_view reported_name = {});
  /// Checks the current value. Errors: same as set.
  Status check() const;
  /// "1 to 7 pixels", "0 to 1 or auto", or the keywords separated by commas; otherwise empty.
  std::string range_text() const;
  /// "a whole number from 1 to 7 pixels"
  std::string accepted() const;

 private:
  friend class SettingTable;
  friend struct UncheckedSetting;  // lets tests write invalid values
  bool accepts(const SettingValue& value) const;
  bool is_word(const SettingValue& value) const;
  Error refusal(const SettingValue& value, std::string_view reported_name) const;

  void* value_ = nullptr;
  std::size_t (*get_word_)(const void*) = nullptr;
  void (*set_word_)(void*, std::size_t) = nullptr;
};

/// The settings of an options struct, in the order of a settings file.
class SettingTable {
 public:
  /// Settings added from now on belong to this section.
  void section(std::string_view name) { section_ = name; }

  void add(const Setting& setting) { settings_.push_back(setting); }
  void add(std::string_view name, bool& value, std::string_view help);
  void add(std::string_view name, int& value, NumberRange range, std::string_view help);
  void add(std::string_view name, double& value, NumberRange range, std::string_view help);
  /// Adds the keyword "auto" for no value.
  void add(std::string_view name, std::optional<double>& value, NumberRange range,
           std::string_view help);
  void add(std::string_view name, Pose& value, std::string_view help);
  template <NamedEnum Enum>
  void add(std::string_view name, Enum& value, std::string_view help);
  /// Adds the keyword "auto" for no value.
  template <NamedEnum Enum>
  void add(std::string_view name, std::optional<Enum>& value, std::string_view help);

  auto begin() { return settings_.begin(); }
  auto end() { return settings_.end(); }
  auto begin() const { return settings_.begin(); }
  auto end() const { return settings_.end(); }
  /// Finds by section and name, "coupling.stiffness"; null if there is none.
  Setting* find(std::string_view key);
  const Setting* find(std::string_view key) const;
  /// Sets a value by key. Errors: an unknown key (with the nearest one); as of Setting::set.
  Status set(std::string_view key, const SettingValue& value);

 private:
  Setting& append(std::string_view name, SettingKind kind, void* value, std::string_view help);

  std::vector<Setting> settings_;
  std::string_view section_;
};

/// The table of an options struct. The struct must outlive it.
template <class Options>
SettingTable settings_of(Options& options) {
  SettingTable table;
  add_settings(table, options);
  return table;
}
/// Read-only.
template <class Options>
const SettingTable settings_of(const Options& options) {
  return settings_of(const_cast<Options&>(options));
}

/// Checks all settings. Error: the first setting that is out of range.
Status check_settings(const SettingTable& table);
/// The first setting whose values differ, or null. Both tables are of the same options type.
const Setting* first_difference(const SettingTable& a, const SettingTable& b);
/// Copies every setting that both tables have, except the keys in `except`, from `from` to `to`, if
/// `to` accepts the value.
void copy_settings(const SettingTable& from, SettingTable to,
                   std::span<const std::string> except = {});

template <class Options>
Status check_settings(const Options& options) {
  return check_settings(settings_of(options));
}
template <class Options>
bool has_same_settings(const Options& a, const Options& b) {
  return first_difference(settings_of(a), settings_of(b)) == nullptr;
}

/// Converts to x y z qx qy qz qw and back. nullopt if there are not exactly seven numbers.
std::array<double, 7> seven_numbers(const Pose& X);
std::optional<Pose> pose_of(std::span<const double> seven);

/// The entry of `words` with the smallest edit distance to `word`. `words` must not be
/// empty.
std::string nearest_word(std::string_view word, std::span<const std::string> words);
/// The shortest decimal that reads back to the same bits; integers up to 1e15 with all digits.
std::string shortest_decimal(double value);

// Implementation

template <NamedEnum Enum>
void SettingTable::add(std::string_view name, Enum& value, std::string_view help) {
  static constexpr auto kNames = checked_names<Enum>();
  Setting& setting = append(name, SettingKind::word, &value, help);
  setting.words.assign(kNames.begin(), kNames.end());
  setting.get_word_ = [](const void* at) {
    return static_cast<std::size_t>(*static_cast<const Enum*>(at));
  };
  setting.set_word_ = [](void* at, std::size_t word) {
    *static_cast<Enum*>(at) = static_cast<Enum>(word);
  };
}

template <NamedEnum Enum>
void SettingTable::add(std::string_view name, std::optional<Enum>& value, std::string_view help) {
  static constexpr auto kNames = checked_names<Enum>();
  Setting& setting = append(name, SettingKind::word, &value, help);
  setting.words.assign(kNames.begin(), kNames.end());
  setting.words.push_back("auto");
  setting.get_word_ = [](const void* at) {
    const auto& chosen = *static_cast<const std::optional<Enum>*>(at);
    return chosen ? static_cast<std::size_t>(*chosen) : kNames.size();
  };
  setting.set_word_ = [](void* at, std::size_t word) {
    auto& chosen = *static_cast<std::optional<Enum>*>(at);
    if (word < kNames.size()) {
      chosen = static_cast<Enum>(word);
    } else {
      chosen.reset();
    }
  };
}

}}  // namespace palpate::v0
