#include "eval/report/choose.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <numeric>
#include <optional>
#include <set>

namespace palpate::eval {
namespace {

/// A figure of the thesis: "5.17" is chapter 5, number 17; letters, as in "3.10a", are ignored.
struct FigureNumber {
  int chapter = 0, number = 0;
};

std::optional<int> whole_number(const char*& at, const char* end) {
  int value = 0;
  const auto [stop, error] = std::from_chars(at, end, value);
  if (error != std::errc()) return std::nullopt;
  at = stop;
  return value;
}

/// Parses the number at `at` and moves `at` behind it. `chapter` applies if none is written.
std::optional<FigureNumber> parse_number(const char*& at, const char* end, int chapter) {
  const auto first = whole_number(at, end);
  if (!first) return std::nullopt;
  FigureNumber result{chapter, *first};
  if (at < end && *at == '.') {
    const auto second = whole_number(++at, end);
    if (!second) return std::nullopt;
    result = {*first, *second};
  }
  while (at < end && std::isalpha(static_cast<unsigned char>(*at)) != 0) ++at;
  if (result.chapter == 0) return std::nullopt;
  return result;
}

std::string in_lower_case(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

/// Returns the Levenshtein distance.
std::size_t distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t(0));
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i + 1;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row.back();
}

/// Returns all words that name a figure.
std::vector<std::string> names_of(const FigureSpec& figure) {
  std::vector<std::string> names = figure_numbers(figure.id);
  names.push_back(in_lower_case(figure.id));
  names.push_back(in_lower_case(figure.section));
  names.push_back(names.back().substr(0, names.back().find(' ')));
  return names;
}

Error unknown(std::span<const FigureSpec> all, const std::string& word) {
  constexpr std::size_t kMaxNames = 4;
  std::set<std::pair<std::size_t, std::string>> near;
  for (const FigureSpec& figure : all) {
    for (const std::string& name : names_of(figure)) {
      near.insert({distance(in_lower_case(word), name), name});
    }
  }
  std::string like;
  std::size_t num = 0;
  for (const auto& [edits, name] : near) {
    if (++num > kMaxNames) break;
    like += (like.empty() ? "" : ", ") + name;
  }
  return {Errc::not_found, "there is no figure or section '" + word + "'; near are " + like +
                               "; palpate_eval --list shows all"};
}

}  // namespace

std::vector<std::string> figure_numbers(const std::string& id) {
  std::vector<std::string> numbers;
  const char* at = id.data();
  const char* const end = at + id.size();
  int chapter = 0;
  while (at < end) {
    const auto first = parse_number(at, end, chapter);
    if (!first) return {};
    chapter = first->chapter;
    FigureNumber last = *first;
    if (at < end && *at == '-') {
      const auto second = parse_number(++at, end, chapter);
      if (!second || second->chapter != chapter) return {};
      last = *second;
    }
    for (int n = first->number; n <= last.number; ++n) {
      numbers.push_back(std::to_string(chapter) + "." + std::to_string(n));
    }
    while (at < end && (*at == ',' || *at == '/' || *at == ' ')) ++at;
  }
  return numbers;
}

Result<std::vector<FigureSpec>> choose_figures(std::span<const FigureSpec> all,
                                               std::span<const std::string> words) {
  std::vector<bool> is_chosen(all.size(), words.empty());
  for (const std::string& word : words) {
    bool is_known = false;
    for (std::size_t i = 0; i < all.size(); ++i) {
      const std::vector<std::string> names = names_of(all[i]);
      if (std::find(names.begin(), names.end(), in_lower_case(word)) == names.end()) continue;
      is_known = is_chosen[i] = true;
    }
    if (!is_known) return unknown(all, word);
  }
  std::vector<FigureSpec> chosen;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (is_chosen[i]) chosen.push_back(all[i]);
  }
  return chosen;
}

}  // namespace palpate::eval
