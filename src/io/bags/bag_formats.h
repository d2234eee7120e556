// The formats of bags beside MCAP, and what readers of bags share.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "src/io/internal/bag_file.h"

namespace palpate { inline namespace v0 {

/// One file of a recording; see BagReader. Schemas and messages are as stored.
class BagFile {
 public:
  virtual ~BagFile() = default;
  virtual Result<std::optional<McapMessage>> next() = 0;
  virtual const std::map<std::uint16_t, McapChannel>& channels() const = 0;
  virtual bool was_cut_off() const = 0;
};

/// Cache of chunks that took long to unpack, in a form that takes little, for reading them again.
class KeptChunks {
 public:
  using Place = std::pair<std::size_t, std::uint64_t>;  // number of the file, byte in it
  void add(const Place& place, std::string_view chunk);
  /// False: it is not in the cache.
  bool find(const Place& place, std::string& to) const;

 private:
  std::size_t room_ = std::size_t{512} << 20;  // bytes, for all
  std::map<Place, std::string> packed_;
};

inline constexpr std::string_view kRos1Magic = "#ROSBAG V2.0\n";
/// Format 2.0 of ROS 1, with chunks by LZ4, bzip2 or as they are; its index is not needed.
/// `number`: of the file in `kept`.
Result<std::unique_ptr<BagFile>> open_ros1_bag(const std::filesystem::path& path,
                                               std::size_t number, KeptChunks& kept);

inline constexpr std::string_view kSqliteMagic{"SQLite format 3\0", 16};
/// The format of rosbag2 and RealSense cameras.
Result<std::unique_ptr<BagFile>> open_sqlite_bag(const std::filesystem::path& path);

/// Error for a read that fails before the end of the file: it is not cut off.
Error unreadable(const std::filesystem::path& path, std::uint64_t place);

}}  // namespace palpate::v0
