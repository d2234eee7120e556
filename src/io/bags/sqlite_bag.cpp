// Bags of ROS 2 in SQLite databases (rosbag2_storage_sqlite3), by libsqlite3, which is found when
// the program runs.
#include <algorithm>
#include <fstream>
#include <string>
#include <system_error>
#include <utility>

#include "src/core/internal/shared_library.h"
#include "src/io/bags/bag_formats.h"

namespace palpate { inline namespace v0 {
namespace {

// sqlite3.h
struct Database;
struct Query;
struct Sqlite {
  int (*open)(const char* file, Database**, int flags, const char* vfs);
  int (*close)(Database*);
  int (*prepare)(Database*, const char* text, int size, Query**, const char** tail);
  int (*step)(Query*);
  int (*finalize)(Query*);
  std::int64_t (*number)(Query*, int column);
  const unsigned char* (*text)(Query*, int column);
  const void* (*blob)(Query*, int column);
  int (*size)(Query*, int column);
  int (*type)(Query*, int column);
  const char* (*message)(Database*);
  int (*limit)(Database*, int which, int most);
  void (*on_progress)(Database*, int num_steps, int (*is_over)(void*), void*);
};
constexpr int kOk = 0, kRow = 100, kDone = 101, kReadOnly = 1, kIsUri = 0x40;
constexpr int kText = 3, kBlob = 4;
constexpr int kLengthLimit = 0, kLargestRow = 256 << 20;  // bytes
/// Steps of SQLite's virtual machine: between two calls of the progress handler; limit for any file
/// and for each byte of the file.
constexpr int kSteps = 1'000'000;
constexpr std::uint64_t kMaxSteps = 10'000'000, kStepsPerByte = 10;

Result<Sqlite> load() {
  const std::string name = "libsqlite3.so.0";
  auto library = SharedLibrary::open({&name, 1});
  if (!library) {
    return Error{Errc::unavailable, library.error().message + "; install libsqlite3-0"};
  }
  Sqlite sqlite{};
  library->require("sqlite3_open_v2", sqlite.open);
  library->require("sqlite3_close", sqlite.close);
  library->require("sqlite3_prepare_v2", sqlite.prepare);
  library->require("sqlite3_step", sqlite.step);
  library->require("sqlite3_finalize", sqlite.finalize);
  library->require("sqlite3_column_int64", sqlite.number);
  library->require("sqlite3_column_text", sqlite.text);
  library->require("sqlite3_column_blob", sqlite.blob);
  library->require("sqlite3_column_bytes", sqlite.size);
  library->require("sqlite3_column_type", sqlite.type);
  library->require("sqlite3_errmsg", sqlite.message);
  library->require("sqlite3_limit", sqlite.limit);
  library->require("sqlite3_progress_handler", sqlite.on_progress);
  if (const Status status = library->check(""); !status) return status.error();
  return sqlite;
}

constexpr const char* kShared = "its rows have more bytes than the file";

class SqliteBag final : public BagFile {
 public:
  SqliteBag(const Sqlite& sqlite, std::filesystem::path path)
      : sqlite_(sqlite), path_(std::move(path)) {}
  ~SqliteBag() override {
    sqlite_.finalize(query_);
    sqlite_.close(database_);
  }

  Status open() {
    if (!open_database()) return failure();
    // Only tables are read, whose rows lie in the file: views and computed columns can be of any
    // size. All rows together are no larger than the file, whatever its pages say.
    bytes_left_ = size_on_disk();
    sqlite_.limit(database_, kLengthLimit,
                  static_cast<int>(std::min<std::uint64_t>(kLargestRow, bytes_left_)));
    steps_left_ = kMaxSteps + kStepsPerByte * bytes_left_;
    sqlite_.on_progress(
        database_, kSteps,
        [](void* left) {
          auto& steps = *static_cast<std::uint64_t*>(left);
          return std::exchange(steps, steps - std::min<std::uint64_t>(steps, kSteps)) == 0 ? 1 : 0;
        },
        &steps_left_);
    if (!prepare(
            "SELECT count(*) FROM sqlite_master WHERE name IN ('topics', 'messages') AND type = "
            "'table' AND sql LIKE 'CREATE TABLE%' AND sql NOT LIKE '% AS %' AND sql NOT LIKE "
            "'% AS(%'") ||
        sqlite_.step(query_) != kRow) {
      return failure();
    }
    if (sqlite_.number(query_, 0) != 2) {
      return Error{Errc::bad_input, path_.string() +
                                        " is not a bag of ROS 2: it has no tables 'topics' and "
                                        "'messages'; give one that ros2 bag wrote" +
                                        (is_in_wal_mode() ? ", with its -wal file beside it" : "")};
    }
    if (!prepare("SELECT id, name, type, serialization_format FROM topics")) return failure();
    int status = 0;
    while ((status = sqlite_.step(query_)) == kRow) {
      if (!takes_row(4)) return failure(kShared);
      const std::int64_t id = sqlite_.number(query_, 0);
      const std::string type = text(2), format = text(3);
      if (id < 0 || id > 65535) {
        return Error{Errc::bad_input, path_.string() + " numbers a topic " + std::to_string(id) +
                                          ", and at most 65535 is read; rewrite it"};
      }
      channels_[static_cast<std::uint16_t>(id)] = {text(1), format == "cdr" ? type : "", ""};
    }
    if (status != kDone) return failure();
    // Rows in the order in which they were written. Nothing is sorted, which would read all of them
    // at once.
    if (!prepare("SELECT topic_id, timestamp, data FROM messages NOT INDEXED")) return failure();
    return Done{};
  }

  const std::map<std::uint16_t, McapChannel>& channels() const override { return channels_; }
  bool was_cut_off() const override { return false; }

  Result<std::optional<McapMessage>> next() override {
    for (;;) {
      const int status = is_over_ ? kDone : sqlite_.step(query_);
      is_over_ = status != kRow;
      if (status == kDone) return std::optional<McapMessage>();
      if (status != kRow) return failure();
      is_over_ = !takes_row(3);
      if (is_over_) return failure(kShared);
      const std::int64_t id = sqlite_.number(query_, 0);
      if (id < 0 || id > 65535 || !channels_.contains(static_cast<std::uint16_t>(id))) continue;
      const void* const data = sqlite_.blob(query_, 2);
      const int size = sqlite_.size(query_, 2);
      return std::optional(McapMessage{
          static_cast<std::uint16_t>(id),
          static_cast<std::uint64_t>(sqlite_.number(query_, 1)),
          {static_cast<const char*>(data), data == nullptr ? 0 : static_cast<std::size_t>(size)}});
    }
  }

 private:
  /// Opens the database without making files: SQLite makes the -shm file that readers of a WAL
  /// share, unless it is there or the database is opened as immutable or exclusively.
  bool open_database() {
    std::error_code none;
    const std::string wal = path_.string() + "-wal", shared = path_.string() + "-shm";
    const bool has_wal = std::filesystem::file_size(wal, none) > 0 && !none;
    if (!is_in_wal_mode() || (has_wal && std::filesystem::exists(shared, none))) {
      return sqlite_.open(path_.c_str(), &database_, kReadOnly, nullptr) == kOk;
    }
    if (!has_wal) {
      return sqlite_.open((uri() + "?immutable=1").c_str(), &database_, kReadOnly | kIsUri,
                          nullptr) == kOk;
    }
    return sqlite_.open(path_.c_str(), &database_, kReadOnly, "unix-none") == kOk &&
           prepare("PRAGMA locking_mode = EXCLUSIVE") && sqlite_.step(query_) == kRow;
  }
  /// True if the header says so.
  bool is_in_wal_mode() const {
    constexpr std::size_t kVersions = 18;  // offset of the write and read versions; 2: WAL
    char header[kVersions + 2] = {};
    std::ifstream(path_, std::ios::binary).read(header, sizeof header);
    return header[kVersions] == 2 && header[kVersions + 1] == 2;
  }
  std::string uri() const {
    std::string uri = "file://";
    for (const char c : std::filesystem::absolute(path_).string()) {
      uri += c == '%' ? "%25" : c == '?' ? "%3f" : c == '#' ? "%23" : std::string(1, c);
    }
    return uri;
  }
  bool prepare(const char* question) {
    sqlite_.finalize(query_);
    query_ = nullptr;
    return sqlite_.prepare(database_, question, -1, &query_, nullptr) == kOk;
  }
  std::string text(int column) const {
    const unsigned char* const found = sqlite_.text(query_, column);
    return found == nullptr ? "" : reinterpret_cast<const char*>(found);
  }
  /// Returns the size of the file and of its write-ahead log.
  std::uint64_t size_on_disk() const {
    std::error_code no_file, none_beside;
    const std::uint64_t size = std::filesystem::file_size(path_, no_file);
    const std::uint64_t beside = std::filesystem::file_size(path_.string() + "-wal", none_beside);
    return (no_file ? 0 : size) + (none_beside ? 0 : beside);
  }
  /// True if the bytes of this row and all before it fit into the file.
  bool takes_row(int num_columns) {
    for (int column = 0; column < num_columns; ++column) {
      const int type = sqlite_.type(query_, column);
      if (type != kText && type != kBlob) continue;
      const auto size = static_cast<std::uint64_t>(sqlite_.size(query_, column));
      if (size > bytes_left_) return false;
      bytes_left_ -= size;
    }
    return true;
  }
  Error failure() const { return failure(sqlite_.message(database_)); }
  Error failure(const std::string& why) const {
    return {Errc::bad_input, path_.string() + " cannot be read as a bag of ROS 2: " + why +
                                 "; copy it again, or repair it with .recover of sqlite3"};
  }

  const Sqlite& sqlite_;
  const std::filesystem::path path_;
  Database* database_ = nullptr;
  Query* query_ = nullptr;
  std::map<std::uint16_t, McapChannel> channels_;
  std::uint64_t steps_left_ = 0, bytes_left_ = 0;
  bool is_over_ = false;
};

}  // namespace

Result<std::unique_ptr<BagFile>> open_sqlite_bag(const std::filesystem::path& path) {
  static const Result<Sqlite> sqlite = load();
  if (!sqlite) return Error{Errc::unavailable, path.string() + ": " + sqlite.error().message};
  auto bag = std::make_unique<SqliteBag>(*sqlite, path);
  if (const Status opened = bag->open(); !opened) return opened.error();
  return std::unique_ptr<BagFile>(std::move(bag));
}

}}  // namespace palpate::v0
