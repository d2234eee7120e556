// Large recordings: MCAP, bags of ROS 1 and of ROS 2 in SQLite, and raw frames.
#include <zstd.h>

#include <algorithm>
#include <map>

#include "palpate/io/files.h"
#include "palpate/session/run.h"
#include "src/core/internal/shared_library.h"
#include "src/io/bags/mcap_format.h"
#include "src/io/internal/bag_file.h"
#include "src/io/internal/ros_image.h"
#include "src/io/internal/ros_messages.h"
#include "src/session/internal/run_messages.h"
#include "src/session/internal/run_reader.h"
#include "tests/fuzz/large_inputs.h"
#include "tests/io/ros1_bag_writer.h"
#include "tests/test_util/contact_scenes.h"

namespace palpate::fuzz {
namespace {

namespace fs = std::filesystem;
using mcap::Bytes;
using mcap::Op;

constexpr std::uint64_t kSecond = 1'000'000'000;

Bytes schema_record(std::uint16_t id, const std::string& name, const std::string& text) {
  return Bytes().record(Op::schema, Bytes().number(id).text(name).text("ros2msg").text(text).str());
}
Bytes channel_record(std::uint16_t id, std::uint16_t schema, const std::string& topic) {
  return Bytes().record(Op::channel,
                        Bytes().number(id).number(schema).text(topic).text("cdr").text("").str());
}
Bytes message_record(std::uint16_t channel, std::uint64_t time, std::string_view data) {
  return Bytes().record(
      Op::message,
      Bytes().number(channel).number(std::uint32_t{0}).number(time).number(time).raw(data).str());
}
Bytes chunk_record(std::string_view records, std::uint64_t size, std::string_view compression) {
  return Bytes().record(Op::chunk, Bytes()
                                       .number(std::uint64_t{0})
                                       .number(std::uint64_t{0})
                                       .number(size)
                                       .number(std::uint32_t{0})
                                       .text(compression)
                                       .number(std::uint64_t{records.size()})
                                       .raw(records)
                                       .str());
}
const std::string kMagic(mcap::kMagic);

// MCAP.

void ticks_mcap(const fs::path& path, std::size_t num_bytes) {
  auto writer = McapWriter::create(path);
  RunSetup setup;
  setup.streams.resize(1);
  const auto settings = writer->add_channel(settings_channel());
  const auto tick = writer->add_channel(tick_channel());
  (void)writer->write(settings, 1, settings_message(setup));
  test::Random random(1);
  for (std::uint64_t i = 0; writer->bytes_written() < num_bytes; ++i) {
    TickRecord record;
    record.number = i;
    record.time = 1e-3 * static_cast<double>(i);
    for (int axis = 0; axis < 3; ++axis) record.F_H_B.force[axis] = random.normal();
    (void)writer->write(tick, 2 + i, tick_message(record));
  }
  (void)writer->finish();
}

void empty_records_mcap(const fs::path& path, std::size_t num_bytes) {
  const std::string record = Bytes().record(Op::statistics, "").str();
  write_pieces(path, num_bytes, kMagic, [&](std::size_t) { return record; });
}
void bare_messages_mcap(const fs::path& path, std::size_t num_bytes) {
  const std::string record = message_record(1, 1, "").str();
  write_pieces(path, num_bytes,
               kMagic + schema_record(1, "a/msg/B", "").str() + channel_record(1, 1, "/a").str(),
               [&](std::size_t) { return record; });
}
/// One long schema, and channels that are all of it.
void channels_mcap(const fs::path& path, std::size_t num_bytes) {
  std::string records = schema_record(1, "a/msg/B", std::string(num_bytes / 2, ' ')).str();
  for (std::uint32_t i = 0; records.size() < num_bytes; ++i) {
    records += channel_record(static_cast<std::uint16_t>(i), 1, "").str();
  }
  records += message_record(1, 1, "").str();
  write_pieces(path, 0, kMagic + chunk_record(records, records.size(), "").str(), nullptr);
}
/// Chunks of zeros, packed as far as can be.
void zeros_mcap(const fs::path& path, std::size_t num_bytes) {
  const std::string zeros =
      Bytes().record(Op::header, std::string(std::size_t(60) << 20, '\0')).str();
  std::string packed(ZSTD_compressBound(zeros.size()), '\0');
  packed.resize(ZSTD_compress(packed.data(), packed.size(), zeros.data(), zeros.size(), 19));
  const std::string chunk = chunk_record(packed, zeros.size(), mcap::kZstd).str();
  // Their number alone is limited: all that is unpacked counts.
  write_pieces(path, std::min(num_bytes, 20 * chunk.size()), kMagic,
               [&](std::size_t) { return chunk; });
}
void one_zero_chunk_mcap(const fs::path& path, std::size_t) {
  const std::string zeros(std::size_t(1000) << 20, '\0');
  std::string packed(ZSTD_compressBound(zeros.size()), '\0');
  packed.resize(ZSTD_compress(packed.data(), packed.size(), zeros.data(), zeros.size(), 19));
  write_pieces(path, 0, kMagic + chunk_record(packed, zeros.size(), mcap::kZstd).str(), nullptr);
}

/// A run with as many objects as there is room for, each a tool, behind a large file that nobody
/// requests.
void objects_mcap(const fs::path& path, std::size_t num_bytes) {
  auto writer = McapWriter::create(path);
  const std::string tool = *tool_to_bytes(test::random_tool(1, 0.03, 1));
  RunSetup setup;
  setup.streams.resize(1);
  (void)writer->attach("other", "text/plain", std::string(num_bytes / 2, ' '));
  const auto shape = std::make_shared<const Tool>(test::random_tool(1, 0.03, 1));
  for (std::size_t size = 0; size < num_bytes / 2; size += 2 * tool.size()) {
    (void)writer->attach(object_file(setup.settings.objects.size()), "a/b", tool);
    setup.settings.objects.push_back({shape, {}});
  }
  (void)writer->attach(std::string(kToolFile), "a/b", tool);
  const auto settings = writer->add_channel(settings_channel());
  (void)writer->write(settings, 1, settings_message(setup));
  (void)writer->finish();
}

/// A run of four large cameras, of which no frame ever comes; `more` adds to it. Its messages are
/// much longer than what they are packed to.
void frameless_mcap(const fs::path& path, std::size_t num_bytes,
                    const std::function<void(McapWriter&, RunSetup&)>& more) {
  auto writer = McapWriter::create(path);
  RunSetup setup;
  DepthStreamInfo stream;
  stream.width = stream.height = 1024;
  stream.intrinsics = {900, 900, 511.5, 511.5};
  setup.streams.assign(4, stream);
  setup.settings.contact.method = MethodKind::field;
  setup.settings.coupling.kind = CouplingKind::none;
  setup.device.rate = 1000;
  (void)writer->attach(std::string(kToolFile), "a/b",
                       *tool_to_bytes(test::random_tool(1, 0.03, 1)));
  const auto settings = writer->add_channel(settings_channel());
  (void)writer->write(settings, 1, settings_message(setup));
  while (writer->bytes_written() < std::min(num_bytes, std::size_t{1'000'000}))
    more(*writer, setup);
  (void)writer->finish();
}
/// Settings that each need other surfaces.
void settings_mcap(const fs::path& path, std::size_t num_bytes) {
  std::optional<std::uint16_t> channel;
  frameless_mcap(path, num_bytes, [&](McapWriter& writer, RunSetup& setup) {
    if (!channel) channel = writer.add_channel(settings_channel());
    ++setup.revision;
    setup.settings.binning = setup.settings.binning == 1 ? 2 : 1;
    (void)writer.write(*channel, 1, settings_message(setup));
  });
}
/// Empty parts.
void parts_mcap(const fs::path& path, std::size_t num_bytes) {
  std::optional<std::uint16_t> channel;
  PartStart part;
  frameless_mcap(path, num_bytes, [&](McapWriter& writer, RunSetup&) {
    if (!channel) channel = writer.add_channel(part_channel());
    ++part.number;
    (void)writer.write(*channel, 1, part_message(part));
  });
}

/// An image, and transforms that come in the order of `time_of`.
template <class TimeOf>
void transforms_mcap(const fs::path& path, std::size_t num_bytes, const TimeOf& time_of) {
  const std::string image =
      image_message({kSecond, "cam"}, {8, 8, 0.001, std::vector<std::uint16_t>(64, 700), 1});
  std::string records =
      schema_record(1, "tf2_msgs/msg/TFMessage", "").str() +
      schema_record(2, "sensor_msgs/msg/Image", "").str() + channel_record(1, 1, "/tf").str() +
      channel_record(2, 2, "/depth/image_raw").str() + message_record(2, kSecond, image).str();
  for (std::uint64_t i = 0; records.size() < num_bytes; ++i) {
    const RosTransform moved[] = {{"map", "cam", {}}};
    records += message_record(1, kSecond, transform_message(time_of(i), moved)).str();
  }
  write_pieces(path, 0, kMagic + chunk_record(records, records.size(), "").str(), nullptr);
}
void ordered_mcap(const fs::path& path, std::size_t num_bytes) {
  transforms_mcap(path, num_bytes, [](std::uint64_t i) { return kSecond + 1000 * i; });
}
void reversed_mcap(const fs::path& path, std::size_t num_bytes) {
  transforms_mcap(path, num_bytes, [](std::uint64_t i) { return 1000 * kSecond - 1000 * i; });
}

// ROS 1.

void ros1_of_records(const fs::path& path, std::size_t num_bytes, const std::string& record) {
  write_pieces(path, num_bytes, test::ros1_bag({}), [&](std::size_t) { return record; });
}
void empty_records_ros1(const fs::path& path, std::size_t num_bytes) {
  ros1_of_records(path, num_bytes, std::string(8, '\0'));
}
void empty_chunks_ros1(const fs::path& path, std::size_t num_bytes) {
  ros1_of_records(path, num_bytes, test::ros1_chunk(""));
}
/// One message of markers with as many small elements as there is room for.
void markers_ros1(const fs::path& path, std::size_t num_bytes) {
  Bytes marker;
  marker.number(std::uint32_t{1}).raw(test::ros1_stamp(1, 2, "a").str()).text("");
  marker.raw(std::string(12 + 56 + 24 + 16 + 8 + 1, '\0'));
  marker.number(std::uint32_t{0}).number(std::uint32_t{0}).text("");
  marker.raw(test::ros1_stamp(1, 2, "a").str()).text("").text("");
  const auto num = static_cast<std::uint32_t>(num_bytes / 8);
  marker.number(num).raw(std::string(std::size_t{8} * num, '\0'));
  marker.text("").text("").text("").text("").raw(std::string(1, '\0'));
  const std::string records = test::ros1_connection(1, "/m", "visualization_msgs/MarkerArray") +
                              test::ros1_message(1, 1, 2, marker.str());
  write_pieces(path, 0, test::ros1_bag({test::ros1_chunk(records)}), nullptr);
}
void images_ros1(const fs::path& path, std::size_t num_bytes, const std::string& packing) {
  test::Random random(1);
  std::string counts;
  for (int i = 0; i < 640 * 480; ++i) {
    counts += static_cast<char>(random.bits());
    counts += '\2';
  }
  const std::string records =
      test::ros1_connection(1, "/d", "sensor_msgs/Image") +
      test::ros1_message(1, 1, 0,
                         test::ros1_image(test::ros1_stamp(1, 0, "cam"), 640, 480, counts));
  if (packing == "none") {
    return ros1_of_records(path, num_bytes, test::ros1_chunk(records));
  }
  std::string packed(2 * records.size() + 1000, '\0');
  const std::string lz4_name = "liblz4.so.1", bzip2_name = "libbz2.so.1.0";
  auto library = SharedLibrary::open({packing == "lz4" ? &lz4_name : &bzip2_name, 1});
  if (!library) return;
  if (packing == "lz4") {
    std::size_t (*pack)(void*, std::size_t, const void*, std::size_t, const void*) = nullptr;
    library->require("LZ4F_compressFrame", pack);
    packed.resize(pack(packed.data(), packed.size(), records.data(), records.size(), nullptr));
  } else {
    int (*pack)(char*, unsigned*, char*, unsigned, int, int, int) = nullptr;
    library->require("BZ2_bzBuffToBuffCompress", pack);
    auto size = static_cast<unsigned>(packed.size());
    std::string from = records;
    pack(packed.data(), &size, from.data(), static_cast<unsigned>(from.size()), 9, 0, 0);
    packed.resize(size);
  }
  ros1_of_records(
      path, num_bytes,
      test::ros1_record({{"op", test::op(5)},
                         {"compression", packing},
                         {"size", test::bytes_of(static_cast<std::uint32_t>(records.size()))}},
                        packed));
}

// SQLite.

/// Makes a database by commands.
void sqlite(const fs::path& path, const std::string& commands) {
  const std::string name = "libsqlite3.so.0";
  auto library = SharedLibrary::open({&name, 1});
  if (!library) return;
  struct Database;
  int (*open)(const char*, Database**) = nullptr;
  int (*execute)(Database*, const char*, void*, void*, char**) = nullptr;
  int (*close)(Database*) = nullptr;
  library->require("sqlite3_open", open);
  library->require("sqlite3_exec", execute);
  library->require("sqlite3_close", close);
  Database* database = nullptr;
  open(path.c_str(), &database);
  execute(
      database,
      ("PRAGMA journal_mode=OFF; PRAGMA synchronous=OFF; CREATE TABLE topics(id INTEGER PRIMARY "
       "KEY, name TEXT, type TEXT, serialization_format TEXT, offered_qos_profiles TEXT); INSERT "
       "INTO topics VALUES(1, '/a', 'a/msg/B', 'cdr', '');" +
       commands)
          .c_str(),
      nullptr, nullptr, nullptr);
  close(database);
}
constexpr const char* kMessages =
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data "
    "BLOB);";
std::string rows(std::size_t num, const std::string& values) {
  return "WITH RECURSIVE c(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM c WHERE i < " +
         std::to_string(num) + ") INSERT INTO messages SELECT " + values + " FROM c;";
}

void large_rows_db3(const fs::path& path, std::size_t num_bytes) {
  sqlite(path, kMessages + rows(num_bytes / 600'000, "i, 1, i, randomblob(600000)"));
}
void small_rows_db3(const fs::path& path, std::size_t num_bytes) {
  sqlite(path, kMessages + rows(num_bytes / 11, "i, 1, 1, x''"));
}
/// Data that is computed, in words that do not look like it.
void computed_db3(const fs::path& path, std::size_t num_bytes) {
  sqlite(path,
         "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data "
         "BLOB AS/**/(zeroblob(200000000)));" +
             ("WITH RECURSIVE c(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM c WHERE i < " +
              std::to_string(num_bytes / 11) +
              ") INSERT INTO messages(id, topic_id, timestamp) SELECT i, 1, 1 FROM c;"));
}
/// One long row, to which all branches of the tree lead.
void shared_rows_db3(const fs::path& path, std::size_t num_bytes) {
  constexpr std::size_t kPage = 65536, kRoot = 2 * kPage, kTrunks = 40;
  const std::size_t num_branches = std::min<std::size_t>(num_bytes / 128, 9000);
  sqlite(path, kMessages + ("INSERT INTO messages VALUES(1, 1, 1, zeroblob(" +
                            std::to_string(num_bytes - num_bytes / 4) +
                            ")); PRAGMA page_size=65536; VACUUM;"));
  std::string bytes = file_bytes(path);
  const auto put = [](std::string& to, std::size_t at, std::size_t value, int size) {
    for (int i = 0; i < size; ++i) to[at + i] = static_cast<char>(value >> 8 * (size - 1 - i));
  };
  const auto branches = [&](std::size_t num, std::size_t page) {
    std::string all(kPage, '\0');
    all[0] = 5;
    put(all, 3, num, 2);
    put(all, 5, kPage - 5 * num, 2);
    put(all, 8, page, 4);
    for (std::size_t i = 0; i < num; ++i) {
      const std::size_t at = kPage - 5 * (i + 1);
      put(all, 12 + 2 * i, at, 2);
      put(all, at, page, 4);
      all[at + 4] = 1;
    }
    return all;
  };
  if (bytes.size() < kRoot + kPage) return;
  const std::size_t num_pages = bytes.size() / kPage;
  bytes += bytes.substr(kRoot, kPage) + branches(num_branches, num_pages + 1);
  bytes.replace(kRoot, kPage, branches(kTrunks, num_pages + 2));
  put(bytes, 28, num_pages + 2, 4);
  write_pieces(path, 0, bytes, nullptr);
}

// Raw frames.

void frames_raw(const fs::path& path, std::size_t num_bytes) {
  const std::string frame(640 * 480 * 2, '\2');
  write_pieces(path, num_bytes, "", [&](std::size_t) { return frame; });
}

// Readers.

Status read_all(const fs::path& path) {
  const auto bag = BagReader::open(path);
  if (!bag) return bag.error();
  for (;;) {
    const auto message = (*bag)->next();
    if (!message) return message.error();
    if (!*message) return Done{};
  }
}
Status read_run(const fs::path& path) {
  auto run = RunReader::open(path);
  if (!run) return run.error();
  TickRecord tick;
  for (;;) {
    const auto got = run->next_tick(tick, nullptr);
    if (!got) return got.error();
    if (!*got) return Done{};
  }
}
Status read_tools(const fs::path& path) {
  auto run = RunReader::open(path);
  if (!run) return run.error();
  return status_of(run->load_tools());
}
Status repeat_run(const fs::path& path) { return status_of(replay_run(path)); }
Status read_moving_camera(const fs::path& path) {
  return read_camera("bag:" + path.string() + "?intrinsics=10,10,3.5,3.5&world=map");
}
Status read_images(const fs::path& path) {
  return read_camera("bag:" + path.string() + "?intrinsics=500,500,319.5,239.5");
}
Status read_raw(const fs::path& path) {
  return read_camera("pipe:" + path.string() + "?size=640x480&intrinsics=500,500,319.5,239.5");
}

}  // namespace

std::vector<LargeInput> large_recordings() {
  const auto images = [](const std::string& packing) {
    return [packing](const fs::path& path, std::size_t num_bytes) {
      images_ros1(path, num_bytes, packing);
    };
  };
  return {
      {"MCAP", "ticks of a run", true, ticks_mcap, read_run, ".mcap"},
      {"MCAP", "empty records", true, empty_records_mcap, read_all, ".mcap"},
      {"MCAP", "messages outside of chunks", true, bare_messages_mcap, read_all, ".mcap"},
      {"MCAP", "channels of one long schema", true, channels_mcap, read_all, ".mcap"},
      {"MCAP", "1.2 GB of zeros", true, zeros_mcap, read_all, ".mcap", 3e5},
      {"MCAP", "a chunk of 1 GB of zeros", false, one_zero_chunk_mcap, read_all, ".mcap"},
      {"MCAP", "a run with many objects", {}, objects_mcap, read_tools, ".mcap"},
      {"MCAP", "a run that changes its surfaces", false, settings_mcap, repeat_run, ".mcap", 300},
      {"MCAP", "a run in many parts", false, parts_mcap, repeat_run, ".mcap", 60},
      {"MCAP", "transforms", true, ordered_mcap, read_moving_camera, ".mcap"},
      {"MCAP", "transforms, the last one first", true, reversed_mcap, read_moving_camera, ".mcap"},
      {"ROS 1", "images", true, images("none"), read_images, ".bag"},
      {"ROS 1", "images, lz4", true, images("lz4"), read_images, ".bag"},
      {"ROS 1", "images, bz2", true, images("bz2"), read_images, ".bag", 60},
      {"ROS 1", "empty records", true, empty_records_ros1, read_all, ".bag"},
      {"ROS 1", "empty chunks", true, empty_chunks_ros1, read_all, ".bag"},
      {"ROS 1", "markers of small elements", true, markers_ros1, read_all, ".bag"},
      {"SQLite", "large rows", true, large_rows_db3, read_all, ".db3"},
      {"SQLite", "small rows", true, small_rows_db3, read_all, ".db3"},
      {"SQLite", "data that is computed", false, computed_db3, read_all, ".db3"},
      {"SQLite", "rows that share their bytes", false, shared_rows_db3, read_all, ".db3"},
      {"raw", "frames", true, frames_raw, read_raw, ".raw"}};
}

}  // namespace palpate::fuzz
