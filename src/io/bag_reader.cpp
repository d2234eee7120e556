// Which format a recording has.
#include <fstream>
#include <utility>
#include <vector>

#include "src/io/bag_formats.h"
#include "src/io/internal/atomic_file.h"
#include "src/io/mcap_format.h"

namespace palpate::inline v0 {
namespace {

namespace fs = std::filesystem;

class McapBag final : public BagReader {
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

/// rosbag2 makes a folder with one file in it.
Result<fs::path> file_of(const fs::path& target) {
  std::error_code error;
  if (!fs::is_directory(target, error)) return target;
  std::vector<fs::path> files;
  for (fs::directory_iterator it(target, error), end; !error && it != end; it.increment(error)) {
    const fs::path ending = it->path().extension();
    if (ending == ".mcap" || ending == ".db3") files.push_back(it->path());
  }
  if (error) {
    return Error{Errc::io_failure, "cannot list " + target.string() + ": " + error.message() +
                                       "; check its disk and permissions"};
  }
  if (files.size() == 1) return files.front();
  return Error{Errc::bad_input, target.string() + " holds " + std::to_string(files.size()) +
                                    " .mcap and .db3 files; give the one to read"};
}

}  // namespace

Error unreadable(const fs::path& path, std::uint64_t place) {
  return {Errc::io_failure, "cannot read " + path.string() + " at byte " + std::to_string(place) +
                                "; check its disk"};
}

Result<std::unique_ptr<BagReader>> BagReader::open(const fs::path& target) {
  const auto found = file_of(target);
  if (!found) return found.error();
  const fs::path& path = *found;
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
  if (begin.starts_with(mcap::kMagic)) {
    auto reader = McapReader::open(path);
    if (!reader) return reader.error();
    return std::unique_ptr<BagReader>(std::make_unique<McapBag>(*std::move(reader)));
  }
  if (begin.starts_with(kRos1Magic)) return open_ros1_bag(path);
  if (begin.starts_with(kSqliteMagic)) return open_sqlite_bag(path);
  if (begin.starts_with("#ROSBAG V1")) {
    return Error{
        Errc::bad_input,
        path.string() + " is a bag of before 2010 (format 1); rewrite it with rosbag reindex"};
  }
  return Error{Errc::bad_input,
               path.string() + " is not a recording (MCAP, ROS 1 .bag or ROS 2 .db3)"};
}

}  // namespace palpate::inline v0
