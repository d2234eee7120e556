#include "src/io/internal/toml_file.h"

#include <algorithm>
#include <string>
#include <string_view>
#include <utility>

#include "src/io/internal/atomic_file.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kLargestFile = 1 << 16;
/// Keys a.b.c nest tables, which the parser takes apart by recursion.
constexpr std::ptrdiff_t kLongestLine = 1000;

Error no_toml(const std::string& file, std::size_t line, std::string_view why) {
  return {Errc::bad_input,
          file + " line " + std::to_string(line) + " is not TOML: " + std::string(why)};
}

/// True if a line opens a section with a character that begins no name: the parser does not check
/// for that.
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

/// Tracks, character by character, whether a text is between quotes or in a comment.
class Quotes {
 public:
  /// True if text[at] is; to be called for each character in turn.
  bool hold(std::string_view text, std::size_t at) {
    if (at < skip_to_) return is_open_;
    const char c = text[at];
    if (!is_open_) {
      if (c == '#') open("\n", at);
      // In the middle of a word the parser takes it for no quote.
      const bool is_at_word = at == 0 || kBefore.find(text[at - 1]) != std::string_view::npos;
      if (is_at_word && (c == '"' || c == '\'')) open(closing(text, at), at);
      return is_open_;
    }
    const bool is_broken = c == '\n' && end_.size() == 1;  // strings of one line
    if (c == '\\' && end_.front() == '"') {
      skip_to_ = at + 2;
    } else if (is_broken || text.substr(at).starts_with(end_)) {
      is_open_ = false;
      // The last quotes of a long string may be two of its own.
      for (skip_to_ = at + end_.size(); end_.size() == 3 && skip_to_ < at + 5 &&
                                        skip_to_ < text.size() && text[skip_to_] == c;) {
        ++skip_to_;
      }
    }
    return true;
  }
  bool is_in_comment() const { return is_open_ && end_ == "\n"; }

 private:
  static constexpr std::string_view kBefore = " \t\r\n=,[{.";

  static std::string_view closing(std::string_view text, std::size_t at) {
    const std::string_view three = text[at] == '"' ? R"(""")" : "'''";
    return text.substr(at).starts_with(three) ? three : three.substr(0, 1);
  }
  void open(std::string_view end, std::size_t at) {
    end_ = end;
    is_open_ = true;
    skip_to_ = at + end.size();
  }

  std::string_view end_;  // what closes it
  bool is_open_ = false;
  std::size_t skip_to_ = 0;
};

/// Returns the text without parts that break the parser: a byte order mark, letters beyond ASCII in
/// keys (no key has them) and comments (which may be in any encoding), lines without end and
/// sections without a name.
Result<std::string> harmless(std::string text, const std::string& file) {
  if (text.starts_with("\xEF\xBB\xBF")) text.erase(0, 3);
  Quotes quotes;
  for (std::size_t at = 0; at < text.size(); ++at) {
    const bool is_quoted = quotes.hold(text, at) && !quotes.is_in_comment();
    if (static_cast<unsigned char>(text[at]) > 127 && !is_quoted) text[at] = '?';
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

}  // namespace

Result<toml::table> read_toml(const std::filesystem::path& path) {
  auto read = read_file(path, kLargestFile);
  if (!read) return read.error();
  const auto text = harmless(*std::move(read), path.string());
  if (!text) return text.error();
  toml::parse_result document = toml::parse(*text);
  if (!document) {
    const toml::parse_error& error = document.error();
    return no_toml(path.string(), error.source().begin.line, error.description());
  }
  return std::move(document).table();
}

}}  // namespace palpate::v0
