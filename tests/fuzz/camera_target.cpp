// Inputs that cameras are opened by and read from: files of rigs, URIs, recordings, raw frames, and
// the messages in them that no reader of recordings looks into. The first byte says which.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "palpate/cameras/cameras.h"
#include "palpate/io/formats.h"
#include "src/cameras/messages/depth_messages.h"
#include "src/core/internal/shared_library.h"
#include "src/io/internal/mcap_file.h"
#include "src/io/internal/ros_messages.h"
#include "tests/fuzz/target.h"
#include "tests/io/ros1_bag_writer.h"

namespace palpate::fuzz {
namespace {

constexpr char kRig = 'g', kUri = 'u', kBag = 'b', kRaw = 'r', kCompressed = 'c', kInfo = 'i';
constexpr int kMaxFrames = 20;

void read_rig(std::string_view text) {
  static ScratchFile file(".rig.toml"), again(".again.toml");
  const auto rig = load_rig(file.write(text));
  if (!rig) {
    require(rig.error().message.size() > 10, "an error has a message");
    return;
  }
  require(!rig->cameras.empty(), "a rig has a camera");
  std::vector<Pose> X_WC;
  for (const CameraRig::Camera& camera : rig->cameras) {
    require(is_finite(camera.uri.X_WC), "a pose is finite");
    X_WC.push_back(camera.uri.X_WC);
  }
  // A rig that hangs on files that are not there cannot be written anew.
  const auto written = rig_text_with_poses(file.path(), X_WC);
  if (!written) return;
  const auto back = load_rig(again.write(*written));
  require(back && back->cameras.size() == rig->cameras.size(), "a rig comes back whole");
}

void read_uri(std::string_view text) {
  const auto uri = parse_camera_uri(text);
  if (!uri) {
    require(uri.error().message.size() > 10, "an error has a message");
    return;
  }
  require(is_finite(uri->X_WC) && uri->latency >= 0, "what was taken is in its range");
}

/// Whatever the image, a source keeps its word about its size.
void read_camera(const std::string& uri) {
  const auto camera = open_camera(uri, {.in_real_time = false});
  if (!camera) {
    require(camera.error().message.size() > 10, "an error has a message");
    return;
  }
  const DepthStreamInfo info = (*camera)->info();
  DepthFrame frame;
  for (int i = 0; i < kMaxFrames; ++i) {
    const auto got = (*camera)->next(frame);
    if (!got || !*got) break;
    require(frame.width == info.width && frame.height == info.height &&
                frame.pixels.size() ==
                    static_cast<std::size_t>(info.width) * static_cast<std::size_t>(info.height),
            "a camera's images are of one size");
    require(frame.unit > 0 && std::isfinite(frame.unit) && is_finite(frame.X_WC),
            "a frame has a unit and a place");
  }
  (void)(*camera)->take_notes();
}

void read_bag(std::string_view bytes) {
  static ScratchFile file(".camera.bag");
  file.write(bytes);
  const std::string uri = "bag:" + file.path().string();
  read_camera(uri + "?intrinsics=10,10,5.5,3.5");
  read_camera(uri + "?topic=/camera/depth/image_raw&world=map");
}

void read_info(std::string_view message) {
  const auto model = read_camera_model(message);
  if (!model) return;
  for (const char* topic : {"/d/image_raw", "/d/image_rect_raw"}) {
    DepthStreamInfo info;
    info.width = 640;
    info.height = 480;
    set_ros_camera(*model, topic, info);
  }
}

// Seeds.

DepthFrame small_frame(double time = 1) {
  DepthFrame frame{12, 8, 0.001, {}, time};
  for (int i = 0; i < 12 * 8; ++i) frame.pixels.push_back(static_cast<std::uint16_t>(500 + 7 * i));
  return frame;
}

DepthStreamInfo small_stream() {
  DepthStreamInfo info;
  info.width = 12;
  info.height = 8;
  info.intrinsics = {10, 10, 5.5, 3.5};
  return info;
}

/// sensor_msgs/CompressedImage, by the words of RVL's and PNG's transport.
std::string compressed_image(std::string_view format, std::string_view image,
                             std::size_t num_before = 12) {
  mcap::Bytes message;
  message.raw({"\0\1\0\0", 4}).number(1).number(0).text({"cam\0", 4});
  std::string text(format);
  message.text(text + '\0');
  while ((message.str().size() - 4) % 4 != 0) message.number(std::uint8_t{0});
  return message.text(std::string(num_before, '\0') + std::string(image)).str();
}

struct Reported {
  const char *topic, *type;
  std::uint64_t time;
  std::string message;
};
/// An image of a camera that moves, twice, and all that a recording says of it.
std::vector<Reported> reported() {
  constexpr std::uint64_t kSecond = 1'000'000'000;
  std::vector<Reported> all;
  for (const std::uint64_t t : {1, 2}) {
    const RosTransform there[] = {{"map", "cam", {{0.1 * static_cast<double>(t), 0, 0}, {}}}};
    all.push_back(
        {"/tf", "tf2_msgs/msg/TFMessage", t * kSecond, transform_message(t * kSecond, there)});
    all.push_back({"/camera/depth/camera_info", "sensor_msgs/msg/CameraInfo", t * kSecond,
                   camera_info_message({t * kSecond, "cam"}, small_stream())});
    all.push_back({"/camera/depth/image_raw", "sensor_msgs/msg/Image", t * kSecond,
                   image_message({t * kSecond, "cam"}, small_frame())});
  }
  return all;
}

std::string mcap_bag() {
  ScratchFile file(".seed.mcap");
  auto writer = McapWriter::create(file.path());
  for (const Reported& each : reported()) {
    (void)writer->write(writer->add_channel({each.topic, each.type, ""}), each.time, each.message);
  }
  (void)writer->finish();
  return file.read();
}

std::string image_bag(const std::string& chunk) { return test::ros1_bag({chunk}); }

/// Packed by the libraries of which ours reads; nothing where one is not installed.
std::vector<std::string> ros1_bags() {
  std::string records =
      test::ros1_connection(1, "/camera/depth/image_raw", "sensor_msgs/Image") +
      test::ros1_connection(2, "/camera/depth/option/Depth_Units/value", "std_msgs/Float32");
  const DepthFrame frame = small_frame();
  const std::string_view counts(reinterpret_cast<const char*>(frame.pixels.data()), 192);
  for (std::uint32_t t = 1; t < 3; ++t) {
    records +=
        test::ros1_message(2, t, 0, test::bytes_of(0x3a83126f)) +
        test::ros1_message(1, t, 0, test::ros1_image(test::ros1_stamp(t, 0, "cam"), 12, 8, counts));
  }
  std::vector<std::string> bags{image_bag(test::ros1_chunk(records))};
  const auto add = [&](const std::string& packed, const char* kind) {
    bags.push_back(image_bag(
        test::ros1_record({{"op", test::op(5)},
                           {"compression", kind},
                           {"size", test::bytes_of(static_cast<std::uint32_t>(records.size()))}},
                          packed)));
  };
  std::string packed(2 * records.size() + 1000, '\0');
  const std::string lz4_name = "liblz4.so.1", bzip2_name = "libbz2.so.1.0";
  if (auto lz4 = SharedLibrary::open({&lz4_name, 1})) {
    std::size_t (*pack)(void*, std::size_t, const void*, std::size_t, const void*) = nullptr;
    lz4->require("LZ4F_compressFrame", pack);
    const std::size_t size =
        pack(packed.data(), packed.size(), records.data(), records.size(), nullptr);
    add(packed.substr(0, size), "lz4");
  }
  if (auto bzip2 = SharedLibrary::open({&bzip2_name, 1})) {
    int (*pack)(char*, unsigned*, char*, unsigned, int, int, int) = nullptr;
    bzip2->require("BZ2_bzBuffToBuffCompress", pack);
    auto size = static_cast<unsigned>(packed.size());
    if (pack(packed.data(), &size, records.data(), static_cast<unsigned>(records.size()), 9, 0,
             0) == 0) {
      add(packed.substr(0, size), "bz2");
    }
  }
  return bags;
}

/// As rosbag2 makes one; nothing where SQLite is not installed.
std::vector<std::string> sqlite_bags() {
  const std::string name = "libsqlite3.so.0";
  auto library = SharedLibrary::open({&name, 1});
  if (!library) return {};
  struct Database;
  int (*open)(const char*, Database**) = nullptr;
  int (*execute)(Database*, const char*, void*, void*, void*) = nullptr;
  int (*close)(Database*) = nullptr;
  library->require("sqlite3_open", open);
  library->require("sqlite3_exec", execute);
  library->require("sqlite3_close", close);
  ScratchFile file(".seed.db3");
  Database* database = nullptr;
  if (open(file.path().c_str(), &database) != 0) return {};
  std::string text =
      "PRAGMA page_size=512; CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, "
      "serialization_format TEXT, offered_qos_profiles TEXT); CREATE TABLE messages(id INTEGER "
      "PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);";
  std::vector<std::string> topics;
  for (const Reported& each : reported()) {
    auto found = std::find(topics.begin(), topics.end(), each.topic);
    if (found == topics.end()) {
      found = topics.insert(topics.end(), each.topic);
      text += "INSERT INTO topics VALUES(" + std::to_string(topics.size()) + ", '" + each.topic +
              "', '" + each.type + "', 'cdr', '');";
    }
    std::string hex;
    for (const char c : each.message) {
      constexpr char kDigits[] = "0123456789abcdef";
      const auto byte = static_cast<unsigned char>(c);
      hex += {kDigits[byte >> 4], kDigits[byte & 15]};
    }
    text += "INSERT INTO messages(topic_id, timestamp, data) VALUES(" +
            std::to_string(found - topics.begin() + 1) + ", " + std::to_string(each.time) + ", x'" +
            hex + "');";
  }
  execute(database, text.c_str(), nullptr, nullptr, nullptr);
  close(database);
  return {file.read()};
}

std::string raw_frames() {
  const DepthFrame frame = small_frame();
  std::string bytes;
  for (const double time : {0.0, 0.1}) {
    const std::uint32_t size[] = {12, 8};
    const double numbers[] = {time, 0.0005};
    bytes += "PALPDEP1" + std::string(reinterpret_cast<const char*>(size), 8) +
             std::string(reinterpret_cast<const char*>(numbers), 16) +
             std::string(reinterpret_cast<const char*>(frame.pixels.data()), 192);
  }
  return bytes;
}

constexpr const char* kRigText = R"([world]
frame = "table"
gravity = [0, 9.81, 0]
[frames]
bench = [1, 0, 0, 0, 0, 0, 1]
[[camera]]
name = "front"
uri = "scene:wall?size=32x24"
intrinsics = [30, 30, 15.5, 11.5]
distortion = [0.1, -0.2, 0, 0]
unit = 0.001
latency = 0.02
pose = [0, 0, 0, 0, 0.6, 0, 0.8]
accelerometer = [0, -9.81, 0]
[[camera]]
uri = "bag:none.mcap?topic=/a"
pose_from = "tf:front_optical"
[[camera]]
uri = "folder:none"
pose_from = "front.tum"
joints = "ros2:/joint_states"
)";

}  // namespace

std::vector<std::string> seeds() {
  const std::string png = *encode_depth_png(small_frame(), "seed");
  std::vector<std::string> all{
      kRig + std::string(kRigText),
      kRig + std::string("[[camera]]\nuri = \"scene:hand\"\n[[camera]]\nuri = \"scene:wall\"\n"),
      kUri + std::string("folder:a%20b?intrinsics=585,585,320,240&distortion=0.1,0,0,0,0.1"
                         "&unit=0.0002&rate=15&latency=0.03&sensor=tof&crop=valid"
                         "&pose=0,0,1,0,0,0,1&poses=a.tum&accelerometer=0,-9.8,0"),
      kUri + std::string("ros2:/d/image?size=640x480&urdf=a.urdf#b#c&joints=bag:j.mcap&world=map"),
      kRaw + raw_frames(),
      kRaw + raw_frames().substr(32),
      kCompressed + compressed_image("16UC1; compressedDepth png", png),
      kCompressed + compressed_image("32FC1; compressedDepth", png),
      kCompressed + compressed_image("16UC1; compressedDepth rvl",
                                     std::string("\x08\0\0\0\x08\0\0\0\0\0\x10\x88", 12)),
      kCompressed + compressed_image("16UC1; png compressed ", png, 0),
      kInfo + camera_info_message({1, "cam"}, small_stream()),
      kBag + mcap_bag()};
  for (const std::string& bag : ros1_bags()) all.push_back(kBag + bag);
  for (const std::string& bag : sqlite_bags()) all.push_back(kBag + bag);
  return all;
}

}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  using namespace palpate::fuzz;
  if (size == 0) return 0;
  const std::string_view bytes = text_of(data + 1, size - 1);
  static ScratchFile raw(".raw");
  switch (data[0]) {
    case kRig: read_rig(bytes); break;
    case kUri: read_uri(bytes); break;
    case kBag: read_bag(bytes); break;
    case kRaw:
      raw.write(bytes);
      read_camera("pipe:" + raw.path().string() + "?size=12x8&intrinsics=10,10,5.5,3.5");
      break;
    case kCompressed:
      for (const double unit : {0.001, kFloatUnit}) (void)read_compressed_depth(bytes, unit);
      break;
    case kInfo: read_info(bytes); break;
    default: break;
  }
  return 0;
}
