#include "src/io/internal/ros_image.h"

#include <optional>
#include <string>

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kWord = 4;           // bytes
constexpr int kMaxShift = 3 * 10;          // of a 32-bit number
constexpr std::size_t kSizes = 2 * kWord;  // before the first number

std::uint32_t word_at(std::string_view data, std::size_t at) {
  std::uint32_t word = 0;
  for (std::size_t i = 0; i < kWord; ++i) {
    word |= static_cast<std::uint32_t>(static_cast<unsigned char>(data[at + i])) << (8 * i);
  }
  return word;
}

class Numbers {
 public:
  explicit Numbers(std::string_view data) : data_(data) {}

  /// None: the data have ended, or it is too large.
  std::optional<std::uint32_t> next() {
    std::uint32_t value = 0;
    for (int shift = 0; shift <= kMaxShift; shift += 3) {
      if (left_ == 0) {
        if (at_ + kWord > data_.size()) return std::nullopt;
        word_ = word_at(data_, at_);
        at_ += kWord;
        left_ = 8;
      }
      const std::uint32_t nibble = word_ >> 28;
      word_ <<= 4;
      --left_;
      value |= (nibble & 7u) << shift;
      if ((nibble & 8u) == 0) return value;
    }
    return std::nullopt;
  }

 private:
  std::string_view data_;
  std::size_t at_ = 0;
  std::uint32_t word_ = 0;
  int left_ = 0;  // nibbles of the word
};

/// False: the numbers are not of so many pixels.
bool fill(Numbers& numbers, std::vector<std::uint16_t>& pixels) {
  std::int64_t value = 0;
  std::size_t at = 0;
  while (at < pixels.size()) {
    const auto zeros = numbers.next();
    if (!zeros || *zeros > pixels.size() - at) return false;
    at += *zeros;  // they are zero
    const auto others = numbers.next();
    if (!others || *others > pixels.size() - at || (*zeros == 0 && *others == 0)) return false;
    for (std::uint32_t i = 0; i < *others; ++i) {
      const auto difference = numbers.next();
      if (!difference) return false;
      const auto half = static_cast<std::int64_t>(*difference >> 1);
      value += (*difference & 1u) != 0 ? -half - 1 : half;
      if (value < 1 || value > 65535) return false;
      pixels[at++] = static_cast<std::uint16_t>(value);
    }
  }
  return true;
}

}  // namespace

Result<DepthFrame> decode_depth_rvl(std::string_view data, std::string_view what, double unit) {
  const Error damaged{Errc::bad_input, std::string(what) + " (RVL) is damaged"};
  if (data.size() < kSizes) return damaged;
  const std::uint32_t width = word_at(data, 0), height = word_at(data, kWord);
  if (width < 1 || height < 1 || width > kMaxImageWidth || height > kMaxImageHeight) {
    return Error{Errc::bad_input, std::string(what) + " (RVL) says that it is " +
                                      std::to_string(width) + " x " + std::to_string(height) +
                                      " pixels"};
  }
  DepthFrame frame;
  frame.width = static_cast<int>(width);
  frame.height = static_cast<int>(height);
  frame.unit = unit;
  frame.pixels.resize(std::size_t{width} * height);
  Numbers numbers(data.substr(kSizes));
  if (!fill(numbers, frame.pixels)) return damaged;
  return frame;
}

}}  // namespace palpate::v0
