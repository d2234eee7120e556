// Recordings of one or several files, whatever their format and however their messages are packed.
#include <algorithm>
#include <charconv>
#include <fstream>
#include <sstream>
#include <utility>
#include <vector>

#include "src/io/bags/bag_formats.h"
#include "src/io/bags/mcap_format.h"
#include "src/io/bags/unpack.h"
#include "src/io/internal/atomic_file.h"
#include "src/io/internal/file_names.h"
#include "src/io/internal/ros_types.h"

namespace palpate { inline namespace v0 {
namespace {

namespace fs = std::filesystem;

class McapBag final : public BagFile {
 public:
  explicit McapBag(McapReader reader) : reader_(std::move(reader)) {}
  Result<std::optional<McapMessage>> next() override { return reader_.next(); }
  const std::map<std::uint16_t, McapChannel>& channels() const override {
    return reader_.channels();
  }
  bool was_cut_off() const override { return reader_.was_cut_off(); }

 private:
  McapReader reader_;
};

/// Compressions of whole files, by their first bytes.
struct Packing {
  std::string_view begin;
  const char* unpack;
};
constexpr Packing kPackings[] = {{kZstdMagic, "zstd -d"},
                                 {"\x1f\x8b", "gunzip"},
                                 {"BZh", "bunzip2"},
                                 {"\xfd"
                                  "7zXZ",
                                  "unxz"},
                                 {"\x04\x22\x4d\x18", "lz4 -d"},
                                 {"PK\x03\x04", "unzip"}};

Result<std::unique_ptr<BagFile>> open_file(const fs::path& path, std::size_t number,
                                           KeptChunks& kept) {
  if (const Status status = check_regular_file(path); !status) return status.error();
  std::ifstream file(path, std::ios::binary);
  char bytes[16] = {};
  if (!file) {
    return Error{Errc::not_found,
                 "cannot read " + path.string() + "; check the name and its permissions"};
  }
  file.read(bytes, sizeof bytes);
  if (file.bad()) return unreadable(path, 0);
  const std::string_view begin(bytes, static_cast<std::size_t>(file.gcount()));
  if (begin.empty()) {
    return Error{Errc::bad_input,
                 path.string() + " is empty, as of a recorder that was killed; record it again"};
  }
  if (begin.starts_with(mcap::kMagic)) {
    auto reader = McapReader::open(path);
    if (!reader) return reader.error();
    return std::unique_ptr<BagFile>(std::make_unique<McapBag>(*std::move(reader)));
  }
  if (begin.starts_with(kRos1Magic)) return open_ros1_bag(path, number, kept);
  if (begin.starts_with(kSqliteMagic)) return open_sqlite_bag(path);
  if (begin.starts_with("#ROSBAG V1")) {
    return Error{
        Errc::bad_input,
        path.string() + " is a bag of before 2010 (format 1); rewrite it with rosbag reindex"};
  }
  for (const Packing& packing : kPackings) {
    if (!begin.starts_with(packing.begin)) continue;
    return Error{Errc::bad_input, path.string() + " is compressed as a whole; unpack it with '" +
                                      packing.unpack + "' and give what comes out"};
  }
  return Error{Errc::bad_input,
               path.string() + " is not a recording (MCAP, ROS 1 .bag or ROS 2 .db3)"};
}

/// Files of a recording in the order of time, and what is to be said of others that it had.
struct Files {
  std::vector<fs::path> paths;
  std::vector<std::string> notes;
};

/// Notes for a folder that lacks these parts; none: it lacks none.
std::vector<std::string> notes_of_lack(const fs::path& folder,
                                       const std::vector<std::string>& parts) {
  constexpr std::size_t kMax = 5;
  if (parts.empty()) return {};
  std::string note = folder.string() + " lacks parts of its recording: " + parts.front();
  for (std::size_t i = 1; i < std::min(kMax, parts.size()); ++i) note += ", " + parts[i];
  if (parts.size() > kMax) note += " and " + std::to_string(parts.size() - kMax) + " more";
  return {note};
}

/// Returns those that rosbag2 lists. None: it lists no file that exists.
Files noted_files(const fs::path& folder) {
  constexpr std::size_t kMaxText = 16 << 20;  // bytes
  const auto text = read_file(folder / "metadata.yaml", kMaxText);
  if (!text) return {};
  std::vector<fs::path> files;
  std::vector<std::string> absent;
  std::istringstream lines(*text);
  bool is_list = false;
  for (std::string line; std::getline(lines, line);) {
    const std::size_t begin = line.find_first_not_of(" \t"),
                      end = line.find_last_not_of(" \t\r\"'");
    if (begin == std::string::npos) continue;
    const std::string_view words = std::string_view(line).substr(begin, end + 1 - begin);
    if (is_list && words.starts_with("- ")) {
      const std::size_t name = words.find_first_not_of(" \"'", 1);
      // Older ones have the folder's name before it; and it may have been unpacked since.
      const fs::path file = folder / fs::path(words.substr(name)).filename();
      const fs::path unpacked = file.parent_path() / file.stem();
      std::error_code ignored;
      if (file.extension() == ".zstd" && fs::exists(unpacked, ignored)) {
        files.push_back(unpacked);
      } else if (fs::exists(file, ignored)) {
        files.push_back(file);
      } else {
        absent.push_back(file.filename().string());
      }
    } else {
      is_list = words == "relative_file_paths:";
    }
  }
  if (files.empty()) return {};
  return {std::move(files), notes_of_lack(folder, absent)};
}

/// "NAME_12.mcap" is part 12 of a recording, whose parts may have other digits in NAME, that of
/// their time.
struct Part {
  std::string recording;  // the name with all digits alike
  unsigned long number = 0;
  fs::path path;
};
std::optional<Part> part_of(const fs::path& path) {
  Part part{path.filename().string(), 0, path};
  const std::string name = path.stem().string();
  const std::size_t line = name.rfind('_');
  const char* const end = name.data() + name.size();
  if (line == std::string::npos ||
      std::from_chars(name.data() + line + 1, end, part.number).ptr != end) {
    return std::nullopt;
  }
  part.recording.replace(line, name.size() - line, "");
  std::ranges::replace_if(
      part.recording, [](char c) { return c >= '0' && c <= '9'; }, '0');
  return part;
}

/// Returns the numbers that are left out between parts in their order.
std::vector<std::string> gaps_between(const std::vector<Part>& parts) {
  std::vector<std::string> gaps;
  for (std::size_t i = 1; i < parts.size(); ++i) {
    const Part &a = parts[i - 1], &b = parts[i];
    if (b.number - a.number < 2) continue;
    const std::string first = std::to_string(a.number + 1), last = std::to_string(b.number - 1);
    gaps.push_back("number " + first + (first == last ? "" : " to " + last) + " between " +
                   a.path.filename().string() + " and " + b.path.filename().string());
  }
  return gaps;
}

/// Leaves out empty files, unless there are no others.
Files without_empty(Files files) {
  const auto is_empty = [](const fs::path& path) {
    std::error_code error;
    return fs::file_size(path, error) == 0 && !error;
  };
  if (std::ranges::all_of(files.paths, is_empty)) return files;
  std::erase_if(files.paths, [&](const fs::path& path) {
    if (!is_empty(path)) return false;
    files.notes.push_back(path.string() +
                          " is empty, as of a recorder that was killed: it is left out");
    return true;
  });
  return files;
}

/// The file, or those of a folder: as rosbag2 has noted them, the only one, or the numbered parts
/// of one recording.
Result<Files> files_of(fs::path target) {
  std::error_code error;
  if (target.filename() == "metadata.yaml") {
    target = target.has_parent_path() ? target.parent_path() : fs::path(".");
  }
  if (!fs::is_directory(target, error)) return Files{{target}, {}};
  if (Files noted = noted_files(target); !noted.paths.empty()) {
    return without_empty(std::move(noted));
  }
  Files files;
  std::vector<Part> parts;
  for (fs::directory_iterator it(target, error), end; !error && it != end; it.increment(error)) {
    fs::path name = it->path().filename();
    if (is_hidden(name)) continue;
    if (name.extension() == ".zstd") name = name.stem();
    const fs::path ending = name.extension();
    if (ending != ".mcap" && ending != ".db3" && ending != ".bag") continue;
    files.paths.push_back(it->path());
    if (auto part = part_of(it->path())) parts.push_back(*std::move(part));
  }
  if (error) {
    return Error{Errc::io_failure, "cannot list " + target.string() + ": " + error.message() +
                                       "; check its disk and permissions"};
  }
  std::ranges::sort(parts, {}, &Part::number);
  const auto is_other = [](const Part& a, const Part& b) {
    return a.recording != b.recording || a.number == b.number;
  };
  const std::size_t num = files.paths.size();
  if (num > 1 && parts.size() == num &&
      std::ranges::adjacent_find(parts, is_other) == parts.end()) {
    std::ranges::transform(parts, files.paths.begin(), &Part::path);
    files.notes = notes_of_lack(target, gaps_between(parts));
    return without_empty(std::move(files));
  }
  if (num == 1) return files;
  return Error{Errc::bad_input,
               target.string() + " holds " + std::to_string(num) + " .mcap, .db3 and .bag files" +
                   (num == 0 ? "" : ", not parts of one recording") + "; give the one to read"};
}

/// "sensor_msgs/Image" of the names "sensor_msgs/msg/Image", "sensor_msgs::msg::Image" and
/// "sensor_msgs::msg::dds_::Image_"; a name that is none of these as it is.
std::string plain_type(std::string type) {
  for (const std::string_view from : {"::", "/msg/", "/dds_/"}) {
    for (std::size_t at; (at = type.find(from)) != std::string::npos;) {
      type.replace(at, from.size(), "/");
      if (from == "/dds_/" && type.ends_with('_')) type.pop_back();
    }
  }
  return type;
}

/// One file after the other; each numbers its channels as it likes.
class Recording final : public BagReader {
 public:
  explicit Recording(Files files)
      : files_(std::move(files.paths)), notes_(std::move(files.notes)) {}

  Status open_next() {
    if (file_) was_cut_off_ = was_cut_off();
    auto opened = open_file(files_[num_opened_], num_opened_, kept_);
    if (!opened) return opened.error();
    file_ = *std::move(opened);
    ++num_opened_;
    known_.clear();
    return Done{};
  }

  Result<std::optional<McapMessage>> next() override {
    for (;;) {
      auto message = file_->next();
      if (!message) return message;
      if (*message) {
        const Known* const known = channel_of((*message)->channel);
        if (known == nullptr) {
          return Error{Errc::bad_input,
                       files_.front().string() + " has more topics than anybody has"};
        }
        (*message)->channel = known->number;
        (*message)->data = as_cdr(known->ros1_type, (*message)->data);
        return message;
      }
      if (num_opened_ == files_.size()) return message;
      if (const Status opened = open_next(); !opened) return opened.error();
    }
  }
  const std::map<std::uint16_t, McapChannel>& channels() const override { return channels_; }
  bool was_cut_off() const override { return was_cut_off_ || file_->was_cut_off(); }
  const std::vector<std::string>& notes() const override { return notes_; }
  Status rewind() override {
    num_opened_ = 0;
    return open_next();
  }

 private:
  /// The channel of the file as a topic here.
  struct Known {
    std::uint16_t number;
    std::string ros1_type;  // of messages in the bytes of ROS 1
  };

  const Known* channel_of(std::uint16_t in_file) {
    const auto found = known_.find(in_file);
    if (found != known_.end()) return &found->second;
    McapChannel channel = file_->channels().at(in_file);
    std::string type = plain_type(std::exchange(channel.schema_name, ""));
    if (type == "tf/tfMessage") type = "tf2_msgs/TFMessage";  // its name of old
    channel.schema_name = std::ranges::count(type, '/') == 1 ? ros_interface_name(type) : type;
    if (std::exchange(channel.encoding, "cdr") != "ros1") type.clear();
    const auto same = std::ranges::find_if(channels_, [&](const auto& each) {
      return each.second.topic == channel.topic && each.second.schema_name == channel.schema_name;
    });
    if (same == channels_.end() && channels_.size() > 65535) return nullptr;
    const auto number =
        same == channels_.end() ? static_cast<std::uint16_t>(channels_.size()) : same->first;
    channels_.emplace(number, std::move(channel));
    return &known_.emplace(in_file, Known{number, std::move(type)}).first->second;
  }

  /// Returns the message in CDR; empty if it is damaged or of an unknown type.
  std::string_view as_cdr(const std::string& ros1_type, std::string_view data) {
    if (!ros1_type.empty()) {
      turned_ = cdr_of_ros1(ros1_type, data).value_or("");
      return turned_;
    }
    if (!data.starts_with(kZstdMagic)) return data;
    return unpack_zstd(data, {}, turned_) ? std::string_view(turned_) : std::string_view();
  }

  const std::vector<fs::path> files_;
  const std::vector<std::string> notes_;
  KeptChunks kept_;
  std::size_t num_opened_ = 0;
  std::unique_ptr<BagFile> file_;
  std::map<std::uint16_t, McapChannel> channels_;
  std::map<std::uint16_t, Known> known_;  // by their numbers in the file
  std::string turned_;
  bool was_cut_off_ = false;
};

}  // namespace

Error unreadable(const fs::path& path, std::uint64_t place) {
  return {Errc::io_failure, "cannot read " + path.string() + " at byte " + std::to_string(place) +
                                "; check its disk"};
}

fs::path first_part_of(const fs::path& file) {
  const std::vector<fs::path> parts = noted_files(file.parent_path()).paths;
  const auto is_it = [&](const fs::path& part) { return part.filename() == file.filename(); };
  const auto found = std::ranges::find_if(parts, is_it);
  return found == parts.end() || found == parts.begin() ? fs::path() : parts.front();
}

Result<std::unique_ptr<BagReader>> BagReader::open(const fs::path& target) {
  auto files = files_of(target);
  if (!files) return files.error();
  auto recording = std::make_unique<Recording>(*std::move(files));
  if (const Status opened = recording->open_next(); !opened) return opened.error();
  return std::unique_ptr<BagReader>(std::move(recording));
}

}}  // namespace palpate::v0
