// Large depth images and clouds.
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "palpate/io/formats.h"
#include "src/io/internal/mcap_file.h"
#include "src/io/internal/ros_image.h"
#include "src/io/internal/ros_messages.h"
#include "tests/fuzz/large_inputs.h"
#include "tests/test_util/random.h"

namespace palpate::fuzz {
namespace {

namespace fs = std::filesystem;

/// Noise, as large as images may be.
DepthFrame noise(std::size_t num_bytes) {
  const double side = std::sqrt(static_cast<double>(num_bytes) / 2);
  const int size = std::min(4096, static_cast<int>(side));
  DepthFrame frame{size, size, 0.001, {}, 0};
  test::Random random(1);
  for (int i = 0; i < size * size; ++i) {
    frame.pixels.push_back(static_cast<std::uint16_t>(random.bits()));
  }
  return frame;
}

std::string big_endian(std::uint32_t value) {
  std::string bytes;
  for (int shift = 24; shift >= 0; shift -= 8) bytes += static_cast<char>(value >> shift);
  return bytes;
}

std::string png_chunk(const std::string& name, const std::string& data) {
  const std::string checked = name + data;
  const auto crc = crc32_z(0, reinterpret_cast<const Bytef*>(checked.data()), checked.size());
  return big_endian(static_cast<std::uint32_t>(data.size())) + checked +
         big_endian(static_cast<std::uint32_t>(crc));
}

/// An image of 8 x 8 with something else between its size and its pixels.
void png_with(const fs::path& path, std::size_t num_bytes, const std::string& chunk) {
  constexpr std::size_t kBegin = 33;  // mark and IHDR
  const std::string image =
      *encode_depth_png({8, 8, 0.001, std::vector<std::uint16_t>(64, 700), 0}, "small");
  write_pieces(
      path, num_bytes, image.substr(0, kBegin), [&](std::size_t) { return chunk; },
      image.substr(kBegin));
}

void texts_png(const fs::path& path, std::size_t num_bytes) {
  const std::string text(7'900'000, 'a');  // libpng takes up to 8 MB
  std::string packed(compressBound(text.size()), '\0');
  uLongf size = packed.size();
  compress2(reinterpret_cast<Bytef*>(packed.data()), &size,
            reinterpret_cast<const Bytef*>(text.data()), text.size(), 9);
  png_with(path, num_bytes, png_chunk("zTXt", std::string("a\0\0", 3) + packed.substr(0, size)));
}
void empty_chunks_png(const fs::path& path, std::size_t num_bytes) {
  png_with(path, num_bytes, png_chunk("paLp", ""));
}
void noise_png(const fs::path& path, std::size_t num_bytes) {
  (void)save_depth_png(noise(num_bytes), path);
}

/// Counts that jump as far as they can, each six of RVL's digits.
void jumps_rvl(const fs::path& path, std::size_t num_bytes) {
  constexpr std::size_t kBytesPerPixel = 3;
  const auto side = static_cast<std::uint32_t>(
      std::min(4096.0, std::sqrt(static_cast<double>(num_bytes) / kBytesPerPixel)));
  std::string bytes;
  std::uint32_t word = 0;
  int num_digits = 0;
  const auto put_word = [&](std::uint32_t value) {
    for (int shift = 0; shift < 32; shift += 8) bytes += static_cast<char>(value >> shift);
  };
  const auto put = [&](std::uint32_t value) {
    do {
      word = word << 4 | (value & 7u) | (value > 7 ? 8u : 0u);
      if (++num_digits % 8 == 0) put_word(word);
    } while (value >>= 3);
  };
  put_word(side);
  put_word(side);
  put(0);
  put(side * side);
  put(2);  // to 1
  for (std::uint32_t i = 1; i < side * side; ++i) put(i % 2 == 1 ? 2 * 65534 : 2 * 65534 - 1);
  while (num_digits % 8 != 0) put(0);
  write_pieces(path, 0, bytes, nullptr);
}

std::string pcd_header(std::size_t num_points, const std::string& data) {
  const std::string n = std::to_string(num_points);
  return "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z normal_x normal_y normal_z\nSIZE 4 4 4 4 4 4\n"
         "TYPE F F F F F F\nCOUNT 1 1 1 1 1 1\nWIDTH " +
         n + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + n + "\nDATA " + data + "\n";
}
constexpr const char* kPoint = "0.125 -0.25 1.0625 0 0 -1\n";

void text_pcd(const fs::path& path, std::size_t num_bytes) {
  const std::size_t num = num_bytes / 26;
  const std::string head = pcd_header(num, "ascii");
  write_pieces(path, head.size() + 26 * num, head, [](std::size_t) { return kPoint; });
}
void binary_pcd(const fs::path& path, std::size_t num_bytes) {
  const std::size_t num = num_bytes / 24;
  const float point[] = {0, 0, 1, 0, 0, -1};
  write_pieces(
      path, 0,
      pcd_header(num, "binary") +
          [&] {
            std::string bytes;
            for (std::size_t i = 0; i < num; ++i)
              bytes.append(reinterpret_cast<const char*>(point), 24);
            return bytes;
          }(),
      nullptr);
}
/// Copies of the byte before, as long as LZF can say them.
void packed_pcd(const fs::path& path, std::size_t num_bytes) {
  constexpr std::size_t kCopied = 264;
  const std::size_t num_copies =
      std::min<std::size_t>(num_bytes, 10'000'000) / 3;  // 88 times as much
  // A whole number of points.
  const std::size_t size = (num_copies * kCopied + 1 + 23) / 24 * 24;
  std::string packed("\0\0", 2);
  std::size_t unpacked = 1;
  for (std::size_t i = 0; i < num_copies; ++i, unpacked += kCopied)
    packed += std::string("\xe0\xff\0", 3);
  for (; unpacked < size; ++unpacked) packed += std::string("\0\0", 2);
  const std::uint32_t sizes[] = {static_cast<std::uint32_t>(packed.size()),
                                 static_cast<std::uint32_t>(size)};
  write_pieces(path, 0,
               pcd_header(size / 24, "binary_compressed") +
                   std::string(reinterpret_cast<const char*>(sizes), 8) + packed,
               nullptr);
}
void fields_pcd(const fs::path& path, std::size_t num_bytes) {
  write_pieces(path, num_bytes, "# .PCD v0.7\nVERSION 0.7\n",
               [](std::size_t) { return "FIELDS x\nSIZE 4\n"; });
}
void text_ply(const fs::path& path, std::size_t num_bytes) {
  const std::size_t num = num_bytes / 26;
  std::string head = "ply\nformat ascii 1.0\nelement vertex " + std::to_string(num) + "\n";
  for (const char* name : {"x", "y", "z", "nx", "ny", "nz"}) {
    head += std::string("property float ") + name + "\n";
  }
  head += "end_header\n";
  write_pieces(path, head.size() + 26 * num, head, [](std::size_t) { return kPoint; });
}

/// A recording whose images are of two sizes in turn, both smaller than the first one, whose size
/// all frames get.
void sizes_mcap(const fs::path& path, std::size_t num_bytes) {
  const std::size_t size = std::min<std::size_t>(num_bytes, 1'000'000);
  auto writer = McapWriter::create(path, {.chunk_bytes = size, .chunk_seconds = 1e9});
  const auto channel = writer->add_channel({"/depth", "sensor_msgs/msg/Image", ""});
  const auto add = [&](std::uint64_t i, const DepthFrame& frame) {
    const std::uint64_t time = 1'000'000'000 + 100'000'000 * i;
    (void)writer->write(channel, time, image_message({time, "cam"}, frame));
  };
  add(0, noise(100'000));
  for (std::uint64_t i = 1; i < size / 600; ++i) {
    add(i, noise(i % 2 == 0 ? 128 : 162));
  }
  (void)writer->finish();
}

Status read_png(const fs::path& path) { return status_of(load_depth_png(path)); }
Status read_rvl(const fs::path& path) {
  return status_of(decode_depth_rvl(file_bytes(path), "image", 0.001));
}
Status read_cloud(const fs::path& path) { return status_of(load_cloud(path)); }
Status read_images(const fs::path& path) {
  return read_camera("bag:" + path.string() + "?intrinsics=300,300,200,200");
}

}  // namespace

std::vector<LargeInput> large_images() {
  return {{"PNG", "noise", true, noise_png, read_png, ".png"},
          {"PNG", "packed texts", true, texts_png, read_png, ".png"},
          {"PNG", "empty chunks", true, empty_chunks_png, read_png, ".png"},
          {"RVL", "jumps", true, jumps_rvl, read_rvl, ".rvl"},
          {"PCD", "text", true, text_pcd, read_cloud, ".pcd"},
          {"PCD", "binary", true, binary_pcd, read_cloud, ".pcd"},
          {"PCD", "packed as far as can be", {}, packed_pcd, read_cloud, ".pcd"},
          {"PCD", "a header of fields", false, fields_pcd, read_cloud, ".pcd"},
          {"PLY", "cloud as text", true, text_ply, read_cloud, ".ply"},
          {"camera", "images of two sizes in turn", true, sizes_mcap, read_images, ".mcap", 40}};
}

}  // namespace palpate::fuzz
