// Options as text: the settings of docs/settings.md, as in "contact.method = graph; contact.edges =
// cut".
#include <cstdlib>
#include <optional>

#include "src/c/handles.h"
#include "src/io/internal/text_scanner.h"

namespace palpate { inline namespace v0 {
namespace {

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kSpace = " \t\r";
  const std::size_t begin = text.find_first_not_of(kSpace);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kSpace) - begin + 1);
}

/// Returns the number that a word is, with a point in every locale.
std::optional<double> number(const std::string& word) {
#if defined(__wasi__)  // whose standard library may lack from_chars, and which has one locale
  char* end = nullptr;
  const double value = std::strtod(word.c_str(), &end);
  if (word.empty() || *end != '\0') return std::nullopt;
  return value;
#else
  return parse_number<double>(word);
#endif
}

/// Returns the text as the kind of value that the setting takes, or as text, which it then refuses.
SettingValue value_of(const Setting& setting, const std::string& text) {
  switch (setting.kind) {
    case SettingKind::flag:
      if (text == "true" || text == "false") return text == "true";
      break;
    case SettingKind::whole:
    case SettingKind::number:
      if (const auto value = number(text)) return *value;
      break;
    case SettingKind::word: break;
    case SettingKind::pose: {
      std::vector<double> values;
      std::string_view rest = text;
      while (!rest.empty()) {
        const std::size_t end = std::min(rest.find(' '), rest.size());
        const auto value = number(std::string(rest.substr(0, end)));
        if (!value) return text;
        values.push_back(*value);
        rest = trimmed(rest.substr(end));
      }
      if (const auto pose = pose_of(values)) return *pose;
      break;
    }
  }
  return text;
}

}  // namespace

Status read_settings(const char* text, SettingTable& table) {
  std::string_view rest = text == nullptr ? std::string_view() : text;
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find_first_of(";\n"), rest.size());
    const std::string_view part = trimmed(rest.substr(0, end));
    rest = rest.substr(std::min(end + 1, rest.size()));
    if (part.empty()) continue;
    const std::size_t sign = part.find('=');
    if (sign == std::string_view::npos) {
      return Error{Errc::invalid_argument, "the option '" + std::string(part) +
                                               "' has no value; write section.key = value, with "
                                               "';' between two"};
    }
    const std::string_view key = trimmed(part.substr(0, sign));
    const std::string value(trimmed(part.substr(sign + 1)));
    const Setting* setting = table.find(key);
    const Status status =
        table.set(key, setting == nullptr ? SettingValue(value) : value_of(*setting, value));
    if (!status) return status;
  }
  return Done{};
}

}}  // namespace palpate::v0
