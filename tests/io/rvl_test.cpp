// RVL against an image that was compressed by hand; encoders of others are in tests/apps and
// tests/ros.
#include "src/io/internal/ros_image.h"

#include <gtest/gtest.h>

#include <string>

namespace palpate {
namespace {

std::string bytes(std::initializer_list<int> values) {
  std::string text;
  for (const int value : values) text += static_cast<char>(value);
  return text;
}

/// 3 x 2: 0 0 5 / 4 0 65535. In nibbles: 2 zeros; 2 others, 2 * 5 = 0o12 and 2 * 1 - 1; 1 zero; 1
/// other, 2 * 65531 = 0o377766. That is 22A1111E EFFF3000, as little-endian words.
const std::string kImage =
    bytes({3, 0, 0, 0, 2, 0, 0, 0, 0x1e, 0x11, 0xa1, 0x22, 0, 0x30, 0xff, 0xef});

TEST(Rvl, ReadsWhatWasCompressedByHand) {
  const auto frame = decode_depth_rvl(kImage, "an image", 0.001);
  ASSERT_TRUE(frame) << frame.error().message;
  EXPECT_EQ(frame->width, 3);
  EXPECT_EQ(frame->height, 2);
  EXPECT_EQ(frame->unit, 0.001);
  EXPECT_EQ(frame->pixels, (std::vector<std::uint16_t>{0, 0, 5, 4, 0, 65535}));
}

TEST(Rvl, DamagedImagesAreErrors) {
  const auto refused = [](std::string data, const char* why) {
    const auto frame = decode_depth_rvl(data, "an image", 0.001);
    EXPECT_FALSE(frame) << why;
    if (!frame) {
      EXPECT_EQ(frame.error().message.find("an image (RVL)"), 0u);
    }
  };
  for (std::size_t size = 0; size < kImage.size(); ++size) refused(kImage.substr(0, size), "cut");
  const auto changed = [](std::size_t at, int value) {
    std::string data = kImage;
    data[at] = static_cast<char>(value);
    return data;
  };
  refused(changed(0, 0), "no width");
  refused(changed(1, 0x20), "wider than any");
  refused(changed(7, 0x10), "higher than any");
  refused(changed(0, 1), "more others than pixels");
  refused(changed(11, 0x02), "neither zeros nor others would go on for ever");
  refused(changed(11, 0x72), "more zeros than pixels");
  refused(changed(10, 0x11), "a depth below 1");
  refused(kImage.substr(0, 8) + std::string(64, '\xff'), "a number without an end");
  EXPECT_TRUE(decode_depth_rvl(kImage + "more", "an image", 1));  // after the last pixel
}

}  // namespace
}  // namespace palpate
