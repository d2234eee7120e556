#include <png.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <random>
#include <set>

#include <gtest/gtest.h>

#include "palpate/io/formats.h"
#include "tests/io/files.h"
#include "tests/test_util/data.h"
#include "tests/test_util/made_frame.h"

namespace palpate {
namespace {

using test::expect_error;
using test::TemporaryFolder;
using test::write_bytes;

DepthFrame noise(int width, int height) {
  std::mt19937 random(1);
  DepthFrame frame{width, height, 0.001, {}, 0};
  for (int i = 0; i < width * height; ++i)
    frame.pixels.push_back(static_cast<std::uint16_t>(random()));
  return frame;
}

/// Any kind of PNG, written by libpng itself from rows of zeros or, with one channel, of `frame`:
/// of 8 bits its lower ones.
void write_png(const std::filesystem::path& path, int bits, int color_type, int interlace,
               const DepthFrame& frame) {
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  std::FILE* file = std::fopen(path.c_str(), "wb");
  png_init_io(png, file);
  png_set_IHDR(png, info, png_uint_32(frame.width), png_uint_32(frame.height), bits, color_type,
               interlace, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  const png_color palette[256] = {{0, 0, 0}, {255, 255, 255}};
  if (color_type == PNG_COLOR_TYPE_PALETTE) png_set_PLTE(png, info, palette, 256);
  png_write_info(png, info);
  std::vector<png_byte> bytes(frame.pixels.size() * 8, 0);
  const std::size_t pixel_bytes = png_get_rowbytes(png, info) / frame.width;
  if (bits == 16 && color_type == PNG_COLOR_TYPE_GRAY) {
    for (std::size_t i = 0; i < frame.pixels.size(); ++i) {
      bytes[2 * i] = png_byte(frame.pixels[i] >> 8);
      bytes[2 * i + 1] = png_byte(frame.pixels[i] & 255);
    }
  } else if (bits == 8 && pixel_bytes == 1) {
    for (std::size_t i = 0; i < frame.pixels.size(); ++i) bytes[i] = png_byte(frame.pixels[i]);
  }
  std::vector<png_bytep> rows;
  for (int v = 0; v < frame.height; ++v)
    rows.push_back(bytes.data() + std::size_t(v) * frame.width * pixel_bytes);
  png_write_image(png, rows.data());
  png_write_end(png, nullptr);
  png_destroy_write_struct(&png, &info);
  std::fclose(file);
}

TEST(DepthPng, RoundTrips) {
  const TemporaryFolder folder;
  for (const auto& [width, height] : {std::pair(1, 1), {640, 480}, {3, 4096}, {4096, 2}}) {
    const DepthFrame frame = noise(width, height);
    ASSERT_TRUE(save_depth_png(frame, folder / "depth.png").has_value());
    const auto loaded = load_depth_png(folder / "depth.png", 0.0002);
    ASSERT_TRUE(loaded.has_value()) << loaded.error().message;
    EXPECT_EQ(loaded->width, width);
    EXPECT_EQ(loaded->height, height);
    EXPECT_EQ(loaded->unit, 0.0002);
    EXPECT_EQ(loaded->pixels, frame.pixels);
  }
}

TEST(DepthPng, ReadsWhatLibpngWrites) {
  const TemporaryFolder folder;
  const DepthFrame frame = noise(61, 43);
  for (const int interlace : {PNG_INTERLACE_NONE, PNG_INTERLACE_ADAM7}) {
    write_png(folder / "depth.png", 16, PNG_COLOR_TYPE_GRAY, interlace, frame);
    const auto loaded = load_depth_png(folder / "depth.png");
    ASSERT_TRUE(loaded.has_value()) << loaded.error().message;
    EXPECT_EQ(loaded->pixels, frame.pixels);
  }
}

TEST(DepthPng, RefusesOtherKindsOfPng) {
  const TemporaryFolder folder;
  const DepthFrame frame = noise(8, 8);
  for (const auto& [bits, color] : {std::pair(8, PNG_COLOR_TYPE_GRAY),
                                    {16, PNG_COLOR_TYPE_RGB},
                                    {8, PNG_COLOR_TYPE_RGB},
                                    {8, PNG_COLOR_TYPE_PALETTE},
                                    {16, PNG_COLOR_TYPE_GRAY_ALPHA},
                                    {8, PNG_COLOR_TYPE_RGBA}}) {
    write_png(folder / "other.png", bits, color, PNG_INTERLACE_NONE, frame);
    expect_error(load_depth_png(folder / "other.png"), "16-bit grayscale");
  }
}

TEST(LabelPng, ReadsGraysAndIndicesAsTheyAre) {
  const TemporaryFolder folder;
  const DepthFrame frame = noise(61, 43);
  for (const int color : {PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_PALETTE}) {
    for (const int interlace : {PNG_INTERLACE_NONE, PNG_INTERLACE_ADAM7}) {
      write_png(folder / "labels.png", 8, color, interlace, frame);
      const auto loaded = load_label_png(folder / "labels.png");
      ASSERT_TRUE(loaded.has_value()) << loaded.error().message;
      EXPECT_EQ(loaded->width, 61);
      EXPECT_EQ(loaded->height, 43);
      ASSERT_EQ(loaded->labels.size(), frame.pixels.size());
      for (std::size_t i = 0; i < frame.pixels.size(); ++i) {
        ASSERT_EQ(loaded->labels[i], frame.pixels[i] & 255) << i;
      }
    }
  }
}

TEST(LabelPng, RefusesWhatIsNone) {
  const TemporaryFolder folder;
  const auto path = folder / "labels.png";
  for (const auto& [bits, color] : {std::pair(16, PNG_COLOR_TYPE_GRAY),
                                    {8, PNG_COLOR_TYPE_RGB},
                                    {8, PNG_COLOR_TYPE_GRAY_ALPHA},
                                    {4, PNG_COLOR_TYPE_GRAY}}) {
    write_png(path, bits, color, PNG_INTERLACE_NONE, noise(8, 8));
    expect_error(load_label_png(path), "save it with 8 bits and one channel");
  }
  write_bytes(path, "this is not an image");
  expect_error(load_label_png(path), "is not a PNG file; label images are");
  EXPECT_EQ(load_label_png(folder / "absent.png").error().code, Errc::not_found);
  write_png(path, 8, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE, noise(64, 48));
  test::for_each_truncation(path, 200, [](const std::filesystem::path& cut, std::size_t length) {
    EXPECT_FALSE(load_label_png(cut).has_value()) << length;
  });
}

TEST(DepthPng, RefusesBombsBeforeAllocating) {
  const TemporaryFolder folder;
  ASSERT_TRUE(save_depth_png(noise(8, 8), folder / "depth.png").has_value());
  std::string bytes = test::read_bytes(folder / "depth.png");
  // 100000 x 100000 pixels with a matching checksum of the chunk IHDR.
  bytes.replace(16, 8, std::string("\x00\x01\x86\xa0\x00\x01\x86\xa0", 8));
  std::uint32_t crc = 0xffffffffu;
  for (std::size_t i = 12; i < 29; ++i) {
    crc ^= static_cast<unsigned char>(bytes[i]);
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ (crc & 1 ? 0xedb88320u : 0u);
  }
  crc = ~crc;
  for (int i = 0; i < 4; ++i) bytes[29 + i] = static_cast<char>(crc >> (24 - 8 * i));
  write_bytes(folder / "bomb.png", bytes);
  expect_error(load_depth_png(folder / "bomb.png"), "100000 x 100000");
}

TEST(DepthPng, RefusesDamage) {
  const TemporaryFolder folder;
  const auto path = folder / "depth.png";
  ASSERT_TRUE(save_depth_png(noise(64, 48), path).has_value());
  test::for_each_truncation(path, 200, [](const std::filesystem::path& cut, std::size_t length) {
    EXPECT_FALSE(load_depth_png(cut).has_value()) << length;
  });
  const std::string good = test::read_bytes(path);
  for (std::size_t i = 0; i < good.size(); i += 7) {
    std::string bytes = good;
    bytes[i] ^= 0x10;
    write_bytes(folder / "bad.png", bytes);
    (void)load_depth_png(folder / "bad.png").has_value();
  }
  write_bytes(folder / "text.png", "this is not an image");
  expect_error(load_depth_png(folder / "text.png"), "is not a PNG file; depth images are");
  EXPECT_EQ(load_depth_png(folder / "absent.png").error().code, Errc::not_found);
  EXPECT_FALSE(load_depth_png(folder.path()).has_value());
}

TEST(DepthPng, RefusesBadArguments) {
  const TemporaryFolder folder;
  EXPECT_EQ(load_depth_png(folder / "x.png", 0).error().code, Errc::invalid_argument);
  EXPECT_EQ(load_depth_png(folder / "x.png", std::nan("")).error().code, Errc::invalid_argument);
  EXPECT_FALSE(save_depth_png({}, folder / "x.png").has_value());
  DepthFrame frame = noise(4, 4);
  frame.pixels.pop_back();
  EXPECT_FALSE(save_depth_png(frame, folder / "x.png").has_value());
  EXPECT_FALSE(std::filesystem::exists(folder / "x.png"));
}

TEST(DepthPng, AMadeFrameComesBackToTheCount) {
  const test::TemporaryFolder folder;
  for (int i = 0; i < test::kNumMadeFrames; ++i) {
    const DepthFrame made = test::made_frame(i);
    EXPECT_GT(std::set<std::uint16_t>(made.pixels.begin(), made.pixels.end()).size(), 100u);
    ASSERT_TRUE(save_depth_png(made, folder / "x.png"));
    const auto read = load_depth_png(folder / "x.png");
    ASSERT_TRUE(read.has_value()) << read.error().message;
    EXPECT_EQ(read->pixels, made.pixels);
  }
}

TEST(DepthPng, LoadsEveryRealFrame) {
  PALPATE_DATA_OR_SKIP(folder, "frames");
  int num_frames = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".png") continue;
    const auto frame = load_depth_png(entry.path());
    ASSERT_TRUE(frame.has_value()) << frame.error().message;
    EXPECT_EQ(frame->width, 640);
    EXPECT_EQ(frame->height, 480);
    EXPECT_GT(std::set<std::uint16_t>(frame->pixels.begin(), frame->pixels.end()).size(), 100u);
    ++num_frames;
  }
  EXPECT_EQ(num_frames, 12);
}

TEST(DepthPng, OrganizedPcdEqualsItsPng) {
  PALPATE_DATA_OR_SKIP(folder, "frames");
  const auto png = load_depth_png(folder / "pcl_person.png");
  const auto pcd = load_depth_pcd(folder / "pcl_person.pcd");
  ASSERT_TRUE(png.has_value()) << png.error().message;
  ASSERT_TRUE(pcd.has_value()) << pcd.error().message;
  ASSERT_EQ(png->pixels.size(), pcd->pixels.size());
  int worst = 0;
  for (std::size_t i = 0; i < png->pixels.size(); ++i)
    worst = std::max(worst, std::abs(int(png->pixels[i]) - int(pcd->pixels[i])));
  EXPECT_LE(worst, 1);
}

}  // namespace
}  // namespace palpate
