// Options structs as tables of settings: the members by name, with unit, range and meaning, for all
// ways in.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "palpate/core/core.h"
#include "palpate/math/geometry.h"

namespace palpate::inline v0 {

// The words for the values of an enumeration, on the command line, in files and in reports.
//
// An enumeration that counts from 0 is given its words by a function beside it, in their order:
//
//   constexpr auto names_of(Priority) { return std::array{"distance", "count"}; }

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

/// What a number may be, both ends included.
struct NumberRange {
  double low = 0, high = 0;
  const char* unit = "";  ///< SI, or what is counted; empty: a plain number

  bool holds(double value) const { return value >= low && value <= high; }  ///< NaN: false
};

/// A value as files, pages and people give it. Whole numbers are numbers too.
using SettingValue = std::variant<bool, double, std::string, Pose>;

enum class SettingKind { flag, whole, number, word, pose };

/// One member of an options struct, which must outlive it.
class Setting {
 public:
  std::string_view section;  ///< in files: "coupling"; empty for the table of a part
  std::string_view name;     ///< in its section: "stiffness"
  std::string_view help;     ///< what it means, in a line
  SettingKind kind = SettingKind::flag;
  NumberRange range;               ///< of numbers
  std::vector<const char*> words;  ///< of a word, all there are

  /// As it is told: "coupling.stiffness".
  std::string key() const;
  SettingValue get() const;
  /// Errors: a value of another kind or out of range; then nothing has changed. The sentence says
  /// name (`told_as`, or the key), what is accepted with its unit, and the value.
  Status set(const SettingValue& value, std::string_view told_as = {});
  /// Is the value that it has now accepted? Error: as of set.
  Status check() const;
  /// "1 to 7 pixels", or the words with commas between them; else empty.
  std::string range_text() const;
  /// "a whole number from 1 to 7 pixels"
  std::string accepted() const;

 private:
  friend class SettingTable;
  friend struct UncheckedSetting;  // tests write what no way in lets pass
  bool accepts(const SettingValue& value) const;
  Error refusal(const SettingValue& value, std::string_view told_as) const;

  void* value_ = nullptr;
  std::size_t (*get_word_)(const void*) = nullptr;
  void (*set_word_)(void*, std::size_t) = nullptr;
};

/// The settings of an options struct, in the order of a settings file.
class SettingTable {
 public:
  /// What is added from now on belongs to this section.
  void section(std::string_view name) { section_ = name; }

  void add(const Setting& setting) { settings_.push_back(setting); }
  void add(std::string_view name, bool& value, std::string_view help);
  void add(std::string_view name, int& value, NumberRange range, std::string_view help);
  void add(std::string_view name, double& value, NumberRange range, std::string_view help);
  void add(std::string_view name, Pose& value, std::string_view help);
  template <NamedEnum Enum>
  void add(std::string_view name, Enum& value, std::string_view help);
  /// With the word "auto" for no value.
  template <NamedEnum Enum>
  void add(std::string_view name, std::optional<Enum>& value, std::string_view help);

  auto begin() { return settings_.begin(); }
  auto end() { return settings_.end(); }
  auto begin() const { return settings_.begin(); }
  auto end() const { return settings_.end(); }
  /// By section and name, "coupling.stiffness"; null if there is none.
  Setting* find(std::string_view key);
  const Setting* find(std::string_view key) const;
  /// Error: a key that is not there, with the nearest one; as of Setting::set.
  Status set(std::string_view key, const SettingValue& value);

 private:
  Setting& append(std::string_view name, SettingKind kind, void* value, std::string_view help);

  std::vector<Setting> settings_;
  std::string_view section_;
};

/// The table of an options struct, which must outlive it.
template <class Options>
SettingTable settings_of(Options& options) {
  SettingTable table;
  add_settings(table, options);
  return table;
}
/// To read only.
template <class Options>
const SettingTable settings_of(const Options& options) {
  return settings_of(const_cast<Options&>(options));
}

/// Error: the first setting that is out of its range.
Status check_settings(const SettingTable& table);
/// The first setting whose values differ, or null. The tables are of one type of options.
const Setting* first_difference(const SettingTable& a, const SettingTable& b);
/// Gives every setting of `to` that `from` has too, but those of the keys `except`, the value it
/// has there, if it accepts that.
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

/// x y z qx qy qz qw, and back. Error: other than seven numbers.
std::array<double, 7> seven_numbers(const Pose& X);
std::optional<Pose> pose_of(std::span<const double> seven);

/// The word that takes the fewest insertions, deletions and replacements to become `word`. `words`
/// is not empty.
std::string nearest_word(std::string_view word, std::span<const std::string> words);
/// The shortest decimals that read back to the same bits; whole numbers up to 1e15 digit by digit.
std::string shortest_decimal(double value);

// Implementation

template <NamedEnum Enum>
void SettingTable::add(std::string_view name, Enum& value, std::string_view help) {
  static constexpr auto kNames = names_of(Enum{});
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
  static constexpr auto kNames = names_of(Enum{});
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

}  // namespace palpate::inline v0
