// Bags of ROS 2 in SQLite databases (rosbag2_storage_sqlite3), by libsqlite3, which is found when
// the program runs.
#include <algorithm>
#include <string>
#include <system_error>
#include <utility>

#include "src/core/shared_library.h"
#include "src/io/bag_formats.h"

namespace palpate::inline v0 {
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
  const char* (*message)(Database*);
  int (*limit)(Database*, int which, int most);
  void (*on_progress)(Database*, int num_steps, int (*is_over)(void*), void*);
};
constexpr int kOk = 0, kRow = 100, kDone = 101, kReadOnly = 1;
constexpr int kLengthLimit = 0, kLargestRow = 256 << 20;  // bytes
/// Of its machine, between two looks at how many there were; at most, and for each byte of the
/// file.
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
  library->require("sqlite3_errmsg", sqlite.message);
  library->require("sqlite3_limit", sqlite.limit);
  library->require("sqlite3_progress_handler", sqlite.on_progress);
  if (library->missing().empty()) return sqlite;
  return Error{Errc::unavailable, library->path() + " lacks " + listed(library->missing())};
}

class SqliteBag final : public BagReader {
 public:
  SqliteBag(const Sqlite& sqlite, std::filesystem::path path)
      : sqlite_(sqlite), path_(std::move(path)) {}
  ~SqliteBag() override {
    sqlite_.finalize(query_);
    sqlite_.close(database_);
  }

  Status open() {
    if (sqlite_.open(path_.c_str(), &database_, kReadOnly, nullptr) != kOk) return failure();
    // Of tables alone, whose rows lie in the file: views and columns that are computed can be of
    // any size. No row is larger than the file, and none is read twice, whatever its pages say.
    std::error_code ignored;
    const std::uint64_t file_size = std::filesystem::file_size(path_, ignored);
    sqlite_.limit(database_, kLengthLimit,
                  static_cast<int>(std::min<std::uint64_t>(kLargestRow, file_size)));
    steps_left_ = kMaxSteps + kStepsPerByte * file_size;
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
                                        "'messages'; give one that ros2 bag wrote"};
    }
    if (!prepare("SELECT id, name, type, serialization_format FROM topics")) return failure();
    int status = 0;
    while ((status = sqlite_.step(query_)) == kRow) {
      const std::int64_t id = sqlite_.number(query_, 0);
      const std::string type = text(2), format = text(3);
      if (id < 0 || id > 65535) {
        return Error{Errc::bad_input, path_.string() + " numbers a topic " + std::to_string(id) +
                                          ", and at most 65535 is read; rewrite it"};
      }
      channels_[static_cast<std::uint16_t>(id)] = {text(1), format == "cdr" ? type : "", ""};
    }
    if (status != kDone) return failure();
    // In the order in which they were written.
    if (!prepare("SELECT topic_id, timestamp, data FROM messages ORDER BY id")) return failure();
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
  bool prepare(const char* question) {
    sqlite_.finalize(query_);
    query_ = nullptr;
    return sqlite_.prepare(database_, question, -1, &query_, nullptr) == kOk;
  }
  std::string text(int column) const {
    const unsigned char* const found = sqlite_.text(query_, column);
    return found == nullptr ? "" : reinterpret_cast<const char*>(found);
  }
  Error failure() const {
    return {Errc::bad_input,
            path_.string() + " cannot be read as a bag of ROS 2: " + sqlite_.message(database_) +
                "; copy it again, or repair it with .recover of sqlite3"};
  }

  const Sqlite& sqlite_;
  const std::filesystem::path path_;
  Database* database_ = nullptr;
  Query* query_ = nullptr;
  std::map<std::uint16_t, McapChannel> channels_;
  std::uint64_t steps_left_ = 0;
  bool is_over_ = false;
};

}  // namespace

Result<std::unique_ptr<BagReader>> open_sqlite_bag(const std::filesystem::path& path) {
  static const Result<Sqlite> sqlite = load();
  if (!sqlite) return Error{Errc::unavailable, path.string() + ": " + sqlite.error().message};
  auto bag = std::make_unique<SqliteBag>(*sqlite, path);
  if (const Status opened = bag->open(); !opened) return opened.error();
  return std::unique_ptr<BagReader>(std::move(bag));
}

}  // namespace palpate::inline v0
