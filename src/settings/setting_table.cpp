#include "palpate/settings/setting_table.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <utility>

#include "src/settings/internal/did_you_mean.h"

namespace palpate { inline namespace v0 {
namespace {

/// Limits of a pose: its coordinates, m, and the deviation of the quaternion's length from 1.
constexpr double kFarthest = 1000, kLengthTolerance = 1e-3;

std::string end_of_range(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.15g", value);
  return text;
}

bool is_pose(const Pose& X) {
  const auto& [p, q] = X;
  const double length = std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
  const bool is_near =
      std::abs(p.x) <= kFarthest && std::abs(p.y) <= kFarthest && std::abs(p.z) <= kFarthest;
  return is_near && std::abs(length - 1) <= kLengthTolerance;
}

/// A quaternion that is as long as rounding lets it be keeps its bits.
Pose with_unit_quaternion(const Pose& X) {
  const Quaternion& q = X.rotation;
  const double off = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w - 1;
  return std::abs(off) < 1e-12 ? X : Pose{X.translation, normalized(q)};
}

struct AsText {
  std::string operator()(bool value) const { return value ? "true" : "false"; }
  std::string operator()(double value) const { return shortest_decimal(value); }
  std::string operator()(const std::string& value) const {
    constexpr std::size_t kLongest = 40;
    return "'" + (value.size() > kLongest ? value.substr(0, kLongest) + "..." : value) + "'";
  }
  std::string operator()(const Pose& X) const {
    std::string text;
    for (const double v : seven_numbers(X)) {
      text += (text.empty() ? "" : " ") + shortest_decimal(v);
    }
    return text;
  }
};

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

}  // namespace

std::string shortest_decimal(double value) {
  constexpr double kMaxDigits = 1e15;
  const bool is_whole = value == std::floor(value) && std::abs(value) < kMaxDigits;
  char text[32];
  char* const end =
      is_whole ? std::to_chars(text, text + sizeof text, value, std::chars_format::fixed).ptr
               : std::to_chars(text, text + sizeof text, value).ptr;
  return {text, end};
}

std::array<double, 7> seven_numbers(const Pose& X) {
  const auto& [p, q] = X;
  return {p.x, p.y, p.z, q.x, q.y, q.z, q.w};
}

std::optional<Pose> pose_of(std::span<const double> v) {
  if (v.size() != 7) return std::nullopt;
  return Pose{{v[0], v[1], v[2]}, {v[3], v[4], v[5], v[6]}};
}

std::string nearest_word(std::string_view word, std::span<const std::string> words) {
  const auto distance = [&](std::string_view other) {
    constexpr std::size_t kLongest = 80;  // bounds the time
    return edit_distance(word.substr(0, kLongest), other.substr(0, kLongest));
  };
  return *std::ranges::min_element(words, {}, distance);
}

std::string did_you_mean(std::string_view word, std::span<const std::string> words) {
  if (words.empty()) return {};
  const std::string nearest = nearest_word(word, words);
  return 2 * edit_distance(word, nearest) <= word.size() ? "; did you mean " + nearest + "?" : "";
}

// One setting

std::string Setting::key() const {
  return (section.empty() ? "" : std::string(section) + ".") + name;
}

SettingValue Setting::get() const {
  switch (kind) {
    case SettingKind::flag: return *static_cast<const bool*>(value_);
    case SettingKind::whole: return static_cast<double>(*static_cast<const int*>(value_));
    case SettingKind::number: {
      if (words.empty()) return *static_cast<const double*>(value_);
      const auto& number = *static_cast<const std::optional<double>*>(value_);
      return number ? SettingValue(*number) : std::string(words.front());
    }
    case SettingKind::word: {
      const std::size_t word = get_word_(value_);
      return std::string(word < words.size() ? words[word] : "?");
    }
    case SettingKind::pose: break;
  }
  return *static_cast<const Pose*>(value_);
}

bool Setting::is_word(const SettingValue& value) const {
  const auto* const word = std::get_if<std::string>(&value);
  return word != nullptr && std::find(words.begin(), words.end(), *word) != words.end();
}

bool Setting::accepts(const SettingValue& value) const {
  const double* const number = std::get_if<double>(&value);
  switch (kind) {
    case SettingKind::flag: return std::holds_alternative<bool>(value);
    case SettingKind::whole:
      return number != nullptr && range.holds(*number) && *number == std::floor(*number);
    case SettingKind::number: return is_word(value) || (number != nullptr && range.holds(*number));
    case SettingKind::word: return is_word(value);
    case SettingKind::pose: break;
  }
  const Pose* const X = std::get_if<Pose>(&value);
  return X != nullptr && is_pose(*X);
}

Status Setting::set(const SettingValue& value, std::string_view reported_name) {
  if (!accepts(value)) return refusal(value, reported_name);
  switch (kind) {
    case SettingKind::flag: *static_cast<bool*>(value_) = std::get<bool>(value); break;
    case SettingKind::whole:
      *static_cast<int*>(value_) = static_cast<int>(std::get<double>(value));
      break;
    case SettingKind::number: {
      const auto* const number = std::get_if<double>(&value);
      if (words.empty()) {
        *static_cast<double*>(value_) = *number;
      } else {
        *static_cast<std::optional<double>*>(value_) =
            number != nullptr ? std::optional(*number) : std::nullopt;
      }
      break;
    }
    case SettingKind::word: {
      const auto word = std::find(words.begin(), words.end(), std::get<std::string>(value));
      set_word_(value_, static_cast<std::size_t>(word - words.begin()));
      break;
    }
    case SettingKind::pose:
      *static_cast<Pose*>(value_) = with_unit_quaternion(std::get<Pose>(value));
      break;
  }
  return Done{};
}

Status Setting::check() const {
  const SettingValue value = get();
  if (!accepts(value)) return refusal(value, {});
  return Done{};
}

std::string Setting::range_text() const {
  std::string text;
  if (kind == SettingKind::whole || kind == SettingKind::number) {
    text = end_of_range(range.low) + " to " + end_of_range(range.high);
    if (*range.unit != '\0') text += " " + std::string(range.unit);
  }
  const char* const between = kind == SettingKind::number ? " or " : ", ";
  for (const char* word : words) text += (text.empty() ? "" : between) + std::string(word);
  return text;
}

std::string Setting::accepted() const {
  switch (kind) {
    case SettingKind::flag: return "true or false";
    case SettingKind::whole: return "a whole number from " + range_text();
    case SettingKind::number: return "a number from " + range_text();
    case SettingKind::word: return "one of " + range_text();
    case SettingKind::pose: break;
  }
  return "seven numbers: x, y, z up to " + end_of_range(kFarthest) +
         " m and a unit quaternion x, y, z, w";
}

Error Setting::refusal(const SettingValue& value, std::string_view reported_name) const {
  std::string text = (reported_name.empty() ? key() : std::string(reported_name)) + " must be " +
                     accepted() + ", not " + std::visit(AsText{}, value);
  const auto* const word = std::get_if<std::string>(&value);
  if (kind == SettingKind::word && word != nullptr && !word->empty()) {
    text += did_you_mean(*word, std::vector<std::string>(words.begin(), words.end()));
  }
  return {Errc::invalid_argument, text};
}

// Tables

Setting& SettingTable::append(std::string_view name, SettingKind kind, void* value,
                              std::string_view help) {
  Setting& setting = settings_.emplace_back();
  setting.section = section_;
  setting.name = name;
  setting.help = help;
  setting.kind = kind;
  setting.value_ = value;
  return setting;
}

void SettingTable::add(std::string_view name, bool& value, std::string_view help) {
  append(name, SettingKind::flag, &value, help);
}
void SettingTable::add(std::string_view name, int& value, NumberRange range,
                       std::string_view help) {
  append(name, SettingKind::whole, &value, help).range = range;
}
void SettingTable::add(std::string_view name, double& value, NumberRange range,
                       std::string_view help) {
  append(name, SettingKind::number, &value, help).range = range;
}
void SettingTable::add(std::string_view name, std::optional<double>& value, NumberRange range,
                       std::string_view help) {
  Setting& setting = append(name, SettingKind::number, &value, help);
  setting.range = range;
  setting.words = {"auto"};
}
void SettingTable::add(std::string_view name, Pose& value, std::string_view help) {
  append(name, SettingKind::pose, &value, help);
}

const Setting* SettingTable::find(std::string_view key) const {
  const auto found = std::find_if(settings_.begin(), settings_.end(),
                                  [&](const Setting& each) { return each.key() == key; });
  return found == settings_.end() ? nullptr : &*found;
}
Setting* SettingTable::find(std::string_view key) {
  return const_cast<Setting*>(std::as_const(*this).find(key));
}

Status SettingTable::set(std::string_view key, const SettingValue& value) {
  if (Setting* const setting = find(key)) return setting->set(value);
  std::vector<std::string> keys;
  for (const Setting& setting : settings_) keys.push_back(setting.key());
  // A force is limited by a share, as devices differ.
  const bool is_force = key == "safety.max_force" || key == "safety.max_torque";
  const std::string nearest = is_force ? "safety.force_share" : nearest_word(key, keys);
  return Error{Errc::invalid_argument, "there is no setting '" + std::string(key.substr(0, 80)) +
                                           "'; the nearest one is '" + nearest + "'" +
                                           (is_force ? ", of what the device can give" : "")};
}

Status check_settings(const SettingTable& table) {
  for (const Setting& setting : table) {
    if (Status status = setting.check(); !status) return status;
  }
  return Done{};
}

const Setting* first_difference(const SettingTable& a, const SettingTable& b) {
  for (const Setting& setting : a) {
    const Setting* const other = b.find(setting.key());
    if (other == nullptr || setting.get() != other->get()) return &setting;
  }
  return nullptr;
}

void copy_settings(const SettingTable& from, SettingTable to, std::span<const std::string> except) {
  for (Setting& setting : to) {
    if (std::ranges::find(except, setting.key()) != except.end()) continue;
    const Setting* const source = from.find(setting.key());
    if (source != nullptr) (void)setting.set(source->get());
  }
}

}}  // namespace palpate::v0
