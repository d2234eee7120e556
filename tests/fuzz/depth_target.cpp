// Depth images (PNG, RVL), images of labels (PNG), optical flow (.flo) and clouds (PCD, PLY): the
// first byte says which.
#include "palpate/io/formats.h"
#include "src/io/internal/rvl.h"
#include "tests/fuzz/target.h"
#include "tests/test_util/contact_scenes.h"

namespace palpate::fuzz {
namespace {

constexpr char kPng = 'n', kRvl = 'r', kPcd = 'd', kPly = 'l', kLabels = 'b', kFlow = 'o';

DepthFrame small_frame() {
  DepthFrame frame{12, 9, 0.001, {}, 0};
  for (int i = 0; i < 12 * 9; ++i) frame.pixels.push_back(static_cast<std::uint16_t>(i * 600));
  return frame;
}

void read_png(std::string_view bytes) {
  const auto frame = decode_depth_png(bytes, "image");
  if (!frame) return;
  require(frame->pixels.size() ==
              static_cast<std::size_t>(frame->width) * static_cast<std::size_t>(frame->height),
          "an image has all its pixels");
  const auto written = encode_depth_png(*frame, "image");
  require(written.has_value(), "an image that was read can be written");
  const auto again = decode_depth_png(*written, "image");
  require(again && again->pixels == frame->pixels, "an image comes back with the same counts");
}

void read_labels(std::string_view bytes) {
  static ScratchFile file(".labels.png");
  const auto image = load_label_png(file.write(bytes));
  if (!image) return;
  require(image->labels.size() ==
              static_cast<std::size_t>(image->width) * static_cast<std::size_t>(image->height),
          "an image of labels has all its pixels");
}

/// 4 x 2 pixels of one byte each, as few bytes as the format allows: not even compressed.
std::string label_image(char color_type) {
  const auto big = [](std::uint32_t value) {
    std::string bytes;
    for (int shift = 24; shift >= 0; shift -= 8) bytes += static_cast<char>(value >> shift);
    return bytes;
  };
  const auto chunk = [&](const std::string& name, const std::string& data) {
    std::uint32_t crc = 0xffffffff;
    for (const char c : name + data) {
      crc ^= static_cast<unsigned char>(c);
      for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1u) != 0 ? 0xedb88320 : 0);
    }
    return big(static_cast<std::uint32_t>(data.size())) + name + data + big(~crc);
  };
  const std::string rows("\0\1\2\3\1\0\3\2\1\0", 10);
  std::uint32_t a = 1, b = 0;
  for (const char c : rows) b += a += static_cast<unsigned char>(c);
  const std::string packed = std::string("\x78\x01\x01\x0a\0\xf5\xff", 7) + rows + big(b << 16 | a);
  return "\x89PNG\r\n\x1a\n" +
         chunk("IHDR", big(4) + big(2) + '\x08' + color_type + std::string(3, '\0')) +
         (color_type == 3 ? chunk("PLTE", std::string(12, '\x40')) : "") + chunk("IDAT", packed) +
         chunk("IEND", "");
}

/// As its page says it; the reader has its own arithmetic.
std::string encode_rvl(const DepthFrame& frame) {
  std::string nibbles, bytes;
  const auto put = [&](std::uint32_t value) {
    do {
      nibbles += static_cast<char>((value & 7u) | (value > 7 ? 8u : 0u));
    } while (value >>= 3);
  };
  int before = 0;
  for (std::size_t at = 0; at < frame.pixels.size();) {
    std::size_t others = at;
    while (others < frame.pixels.size() && frame.pixels[others] == 0) ++others;
    put(static_cast<std::uint32_t>(others - at));
    at = others;
    while (others < frame.pixels.size() && frame.pixels[others] != 0) ++others;
    put(static_cast<std::uint32_t>(others - at));
    for (; at < others; ++at) {
      const int difference = frame.pixels[at] - before;
      before = frame.pixels[at];
      put(static_cast<std::uint32_t>(difference < 0 ? -2 * difference - 1 : 2 * difference));
    }
  }
  while (nibbles.size() % 8 != 0) nibbles += '\0';
  for (const int size : {frame.width, frame.height}) {
    for (int byte = 0; byte < 4; ++byte) bytes += static_cast<char>(size >> (8 * byte));
  }
  for (std::size_t word = 0; word < nibbles.size(); word += 8) {
    for (std::size_t pair = 4; pair-- > 0;) {
      bytes += static_cast<char>(16 * nibbles[word + 2 * pair] + nibbles[word + 2 * pair + 1]);
    }
  }
  return bytes;
}

void read_rvl(std::string_view bytes) {
  const auto frame = decode_depth_rvl(bytes, "image", 0.001);
  if (!frame) return;
  require(frame->pixels.size() ==
              static_cast<std::size_t>(frame->width) * static_cast<std::size_t>(frame->height),
          "an image has all its pixels");
  const auto again = decode_depth_rvl(encode_rvl(*frame), "image", 0.001);
  require(again && again->pixels == frame->pixels, "an image comes back with the same counts");
}

/// A folder with one small image, whose flow is what the input says.
void read_flow(std::string_view bytes) {
  static ScratchFile name(".flow");
  const std::filesystem::path& folder = name.path();
  std::error_code ignored;
  std::filesystem::create_directories(folder, ignored);
  require(save_depth_png(small_frame(), folder / "a.png").has_value(), "an image can be written");
  std::FILE* const file = std::fopen((folder / "a.flo").c_str(), "wb");
  require(file != nullptr, "the flow can be written");
  std::fwrite(bytes.data(), 1, bytes.size(), file);
  std::fclose(file);
  DepthFolderOptions options{{8, 8, 5.5, 4}};
  options.flow = folder;
  const auto source = open_depth_folder(folder, options);
  require(source.has_value(), "a folder with one image can be opened");
  DepthFrame frame;
  const auto got = (*source)->next(frame);
  if (got) require(frame.flow.size() == 2 * frame.pixels.size(), "every pixel has a flow");
  std::filesystem::remove_all(folder, ignored);
}

std::string flow_file(int width, int height) {
  const std::int32_t size[2] = {width, height};
  std::string bytes = "PIEH" + std::string(reinterpret_cast<const char*>(size), sizeof size);
  const std::vector<float> flow(2 * static_cast<std::size_t>(width * height), 0.25f);
  return bytes.append(reinterpret_cast<const char*>(flow.data()), sizeof(float) * flow.size());
}

void read_cloud(std::string_view bytes, const char* extension) {
  static ScratchFile pcd(".pcd"), ply(".ply"), again(".again.ply");
  ScratchFile& file = extension[2] == 'c' ? pcd : ply;
  file.write(bytes);
  if (&file == &pcd) (void)load_depth_pcd(file.path());
  const auto read = load_cloud(file.path());
  if (!read || !save_cloud_ply(read->cloud.view(), again.path())) return;
  const auto back = load_cloud(again.path());
  // A cloud without a valid point is written, and no cloud any more.
  if (back)
    require(back->cloud.size() <= read->cloud.size(), "a cloud comes back with no more points");
}

}  // namespace

std::vector<std::string> seeds() {
  ScratchFile file(".seed.ply");
  const PointCloud cloud = test::noisy_wall(8, 8, 10, 0.5, 0.001, 1);
  (void)save_cloud_ply(cloud.view(), file.path());
  const std::string header =
      "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z normal_x normal_y normal_z\nSIZE 4 4 4 4 4 4\nTYPE F "
      "F "
      "F F F F\nCOUNT 1 1 1 1 1 1\nWIDTH 2\nHEIGHT 2\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\n";
  std::vector<float> numbers;
  for (int i = 0; i < 24; ++i) numbers.push_back(i % 6 == 5 ? -1.0f : 0.1f * static_cast<float>(i));
  const std::string raw(reinterpret_cast<const char*>(numbers.data()), 96);
  // LZF with one literal run of 24 bytes after the other.
  std::string packed;
  for (std::size_t at = 0; at < raw.size(); at += 24) packed += char(23) + raw.substr(at, 24);
  const std::uint32_t sizes[2] = {static_cast<std::uint32_t>(packed.size()), 96};
  return {
      kRvl + encode_rvl(small_frame()),
      kPng + *encode_depth_png(small_frame(), "seed"),
      kLabels + label_image(0),
      kLabels + label_image(3),
      kFlow + flow_file(12, 9),
      kPly + file.read(),
      kPcd + header + "DATA ascii\n0 0 1 0 0 -1\n1 0 1 0 0 -1\n0 1 1 0 0 -1\nnan nan nan 0 0 0\n",
      kPcd + header + "DATA binary\n" + raw,
      kPcd + header + "DATA binary_compressed\n" +
          std::string(reinterpret_cast<const char*>(sizes), 8) + packed};
}

}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate::fuzz;
  if (size == 0) return 0;
  const std::string_view bytes = text_of(data + 1, size - 1);
  switch (data[0]) {
    case kPng: read_png(bytes); break;
    case kRvl: read_rvl(bytes); break;
    case kLabels: read_labels(bytes); break;
    case kFlow: read_flow(bytes); break;
    case kPcd: read_cloud(bytes, ".pcd"); break;
    case kPly: read_cloud(bytes, ".ply"); break;
    default: break;
  }
  return 0;
}
