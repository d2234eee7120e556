#include "src/io/internal/frame_list.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string_view>
#include <utility>

#include "src/cloud/internal/frame_limits.h"
#include "src/io/internal/atomic_file.h"
#include "src/io/internal/file_names.h"
#include "src/io/internal/text_scanner.h"

namespace palpate { inline namespace v0 {
namespace {

namespace fs = std::filesystem;

Error bad(const fs::path& path, const std::string& what) {
  return {Errc::bad_input, path.string() + " " + what};
}

/// "frame2" before "frame10": runs of digits compare as numbers, then everything as text.
bool natural_less(const std::string& a, const std::string& b) {
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (!is_digit(a[i]) || !is_digit(b[j])) {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i;
      ++j;
      continue;
    }
    const auto take_digits = [&](const std::string& text, std::size_t& at) {
      while (at < text.size() && text[at] == '0') ++at;
      const std::size_t first = at;
      while (at < text.size() && is_digit(text[at])) ++at;
      return std::string_view(text).substr(first, at - first);
    };
    const std::string_view m = take_digits(a, i), n = take_digits(b, j);
    if (m.size() != n.size()) return m.size() < n.size();
    if (m != n) return m < n;
  }
  if ((i < a.size()) != (j < b.size())) return j < b.size();
  return a < b;
}

/// Lines "timestamp path" relative to the folder, as the TUM RGB-D benchmark has them.
Result<std::vector<FrameEntry>> read_tum_list(const fs::path& list) {
  const auto content = read_file(list);
  if (!content) return content.error();
  std::vector<FrameEntry> entries;
  const std::string folder = (list.parent_path() / "").string();
  std::string_view rest = without_mark(*content);
  for (int line_number = 1; !rest.empty(); ++line_number) {
    std::string_view line = take_line(rest);
    const std::string_view stamp = take_word(line), name = take_word(line);
    if (stamp.empty() || stamp.starts_with('#')) continue;
    const std::string where = "line " + std::to_string(line_number);
    const auto time = parse_number<double>(stamp);
    if (!time || name.empty() || !take_word(line).empty())
      return bad(list, where + " is not 'timestamp path'; correct it");
    if (!is_in_seconds(*time))
      return bad(list, where + " has the time stamp " + std::string(stamp.substr(0, 40)) +
                           ", which is no time in seconds; give seconds");
    if (!entries.empty() && *time <= entries.back().time)
      return bad(list, where + " does not come after the line before in time; sort the list");
    entries.push_back(
        {*time, name.starts_with('/') ? std::string(name) : folder + std::string(name)});
  }
  return entries;
}

using IsFrame = bool(const std::string& path);

bool is_png_name(const std::string& path) {
  return path.ends_with(".png") || path.ends_with(".PNG");
}

Result<std::vector<FrameEntry>> list_files(const fs::path& folder, double rate, IsFrame& is_frame) {
  std::error_code error;
  std::vector<FrameEntry> entries;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    std::string path = it->path().string();
    if (!is_hidden(it->path()) && is_frame(path)) entries.push_back({0, std::move(path)});
  }
  if (error)
    return Error{Errc::io_failure, "cannot list " + folder.string() + ": " + error.message() +
                                       "; check its permissions"};
  std::sort(entries.begin(), entries.end(), [](const FrameEntry& a, const FrameEntry& b) {
    return natural_less(a.path, b.path);  // of one folder
  });
  for (std::size_t k = 0; k < entries.size(); ++k) entries[k].time = static_cast<double>(k) / rate;
  return entries;
}

}  // namespace

bool is_cloud_name(const std::string& path) {
  const auto ends = [&](const char* extension) { return path.ends_with(extension); };
  return ends(".pcd") || ends(".PCD") || ends(".ply") || ends(".PLY");
}

Result<FrameList> list_frames(const fs::path& folder, double rate) {
  std::error_code ignored;
  const auto kind = fs::status(folder, ignored).type();
  if (kind == fs::file_type::regular)
    return bad(folder, "is not a folder; give the folder of the frames");
  if (kind == fs::file_type::not_found)
    return Error{Errc::not_found, "no such folder: " + folder.string() + "; check its name"};
  const bool is_tum = fs::exists(folder / "depth.txt", ignored);
  auto entries =
      is_tum ? read_tum_list(folder / "depth.txt") : list_files(folder, rate, is_png_name);
  if (entries && entries->empty() && !is_tum && fs::is_directory(folder / "depth", ignored))
    entries = list_files(folder / "depth", rate, is_png_name);
  if (entries && entries->empty() && !is_tum) entries = list_files(folder, rate, is_cloud_name);
  if (!entries) return entries.error();
  if (entries->empty())
    return bad(folder,
               "has no depth frames; give a folder with 16-bit PNGs, PCD or PLY files, or a "
               "depth.txt");
  FrameList list{*std::move(entries), rate};
  if (is_tum && list.entries.size() > 1) {
    list.rate = static_cast<double>(list.entries.size() - 1) /
                (list.entries.back().time - list.entries.front().time);
    if (!(list.rate > 0) || !std::isfinite(list.rate) ||
        usual_step(list.entries) > kLongestUsualStep)
      return bad(folder / "depth.txt",
                 "has timestamps that are not seconds; divide nanoseconds by 1e9");
  }
  return list;
}

}}  // namespace palpate::v0
