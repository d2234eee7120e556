// libpng reports errors by longjmp. The functions that call setjmp here hold nothing with a
// destructor; memory is owned by their callers.
#include <png.h>

#include <bit>
#include <cmath>
#include <csetjmp>
#include <cstring>
#include <new>
#include <optional>
#include <string>
#include <utility>

#include "palpate/io/formats.h"
#include "src/io/internal/atomic_file.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kMaxFileBytes = std::size_t(128) << 20;

struct Message {
  char text[128] = "";
};

[[noreturn]] void on_error(png_structp png, png_const_charp text) {
  auto* message = static_cast<Message*>(png_get_error_ptr(png));
  std::strncpy(message->text, text, sizeof(message->text) - 1);
  png_longjmp(png, 1);
}

void on_warning(png_structp, png_const_charp) {}

/// A reader over bytes in memory.
class Reader {
 public:
  explicit Reader(std::string_view content)
      : rest_(content),
        png_(png_create_read_struct(PNG_LIBPNG_VER_STRING, &message_, on_error, on_warning)) {
    if (png_ != nullptr) info_ = png_create_info_struct(png_);
    if (info_ == nullptr) throw std::bad_alloc();
    png_set_read_fn(png_, this, on_read);
    png_set_chunk_cache_max(png_, 1);  // texts and the like are left out, packed ones unread
  }
  ~Reader() { png_destroy_read_struct(&png_, &info_, nullptr); }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  const char* message() const { return message_.text; }

  bool read_header() {
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    png_read_info(png_, info_);
    return true;
  }

  png_uint_32 width() const { return png_get_image_width(png_, info_); }
  png_uint_32 height() const { return png_get_image_height(png_, info_); }
  bool is_gray16() const {
    return png_get_bit_depth(png_, info_) == 16 &&
           png_get_color_type(png_, info_) == PNG_COLOR_TYPE_GRAY;
  }

  bool is_label8() const {
    const auto type = png_get_color_type(png_, info_);
    return png_get_bit_depth(png_, info_) == 8 &&
           (type == PNG_COLOR_TYPE_GRAY || type == PNG_COLOR_TYPE_PALETTE);
  }

  bool read_pixels(png_bytepp rows) {
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    if constexpr (std::endian::native == std::endian::little) png_set_swap(png_);
    png_read_image(png_, rows);
    png_read_end(png_, nullptr);
    return true;
  }

 private:
  static void on_read(png_structp png, png_bytep target, std::size_t count) {
    auto* self = static_cast<Reader*>(png_get_io_ptr(png));
    if (count > self->rest_.size()) png_error(png, "the file ends early");
    std::memcpy(target, self->rest_.data(), count);
    self->rest_.remove_prefix(count);
  }

  Message message_;
  std::string_view rest_;
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
};

/// A writer into a string of enough capacity, so that nothing is allocated below libpng.
class Writer {
 public:
  Writer() : png_(png_create_write_struct(PNG_LIBPNG_VER_STRING, &message_, on_error, on_warning)) {
    if (png_ != nullptr) info_ = png_create_info_struct(png_);
    if (info_ == nullptr) throw std::bad_alloc();
    png_set_write_fn(png_, this, on_write, nullptr);
  }
  ~Writer() { png_destroy_write_struct(&png_, &info_); }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;

  const char* message() const { return message_.text; }
  std::string& content() { return content_; }

  bool write(int width, int height, png_bytepp rows) {
    constexpr int kFastCompression = 3;
    content_.reserve(static_cast<std::size_t>(width) * height * 2 * 102 / 100 + 65536);
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    png_set_IHDR(png_, info_, static_cast<png_uint_32>(width), static_cast<png_uint_32>(height), 16,
                 PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    png_set_compression_level(png_, kFastCompression);
    png_set_filter(png_, PNG_FILTER_TYPE_BASE, PNG_FILTER_SUB);
    png_write_info(png_, info_);
    if constexpr (std::endian::native == std::endian::little) png_set_swap(png_);
    png_write_image(png_, rows);
    png_write_end(png_, nullptr);
    return true;
  }

 private:
  static void on_write(png_structp png, png_bytep bytes, std::size_t count) {
    auto* self = static_cast<Writer*>(png_get_io_ptr(png));
    if (self->content_.capacity() - self->content_.size() < count)
      png_error(png, "the compressed image is larger than expected");
    self->content_.append(reinterpret_cast<const char*>(bytes), count);
  }

  Message message_;
  std::string content_;
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
};

std::vector<png_bytep> rows_of(std::vector<std::uint16_t>& pixels, int width, int height) {
  std::vector<png_bytep> rows;
  for (int v = 0; v < height; ++v)
    rows.push_back(
        reinterpret_cast<png_bytep>(pixels.data() + static_cast<std::size_t>(v) * width));
  return rows;
}

std::optional<std::string> check_size(const Reader& reader) {
  if (reader.width() > kMaxImageWidth || reader.height() > kMaxImageHeight)
    return "claims " + std::to_string(reader.width()) + " x " + std::to_string(reader.height()) +
           " pixels, more than 4096 x 4096; give a smaller image";
  return std::nullopt;
}

}  // namespace

namespace {

bool is_png(std::string_view content) { return content.starts_with("\x89PNG\r\n\x1a\n"); }

Status check_unit(double unit) {
  if (unit > 0 && std::isfinite(unit)) return Done{};
  return Error{Errc::invalid_argument, "the depth unit must be positive meters per count"};
}

}  // namespace

Result<DepthFrame> load_depth_png(const std::filesystem::path& path, double unit) {
  if (const Status status = check_unit(unit); !status) return status.error();
  const auto content = read_file(path, kMaxFileBytes);
  if (!content) return content.error();
  if (!is_png(*content)) {
    return Error{Errc::bad_input, path.string() +
                                      " is not a PNG file; depth images are 16-bit grayscale PNG "
                                      "files, and organized point clouds are read as .pcd files"};
  }
  return decode_depth_png(*content, path.string(), unit);
}

Result<DepthFrame> decode_depth_png(std::string_view content, const std::string& name,
                                    double unit) {
  if (const Status status = check_unit(unit); !status) return status.error();
  const auto bad = [&](const std::string& what) {
    return Error{Errc::bad_input, name + " " + what};
  };
  const auto not_a_png = [&](const Reader& reader) {
    return bad(std::string("is not a good PNG: ") + reader.message() + "; copy or record it again");
  };
  Reader reader(content);
  if (!reader.read_header()) return not_a_png(reader);
  if (!reader.is_gray16()) {
    return bad("is not a 16-bit grayscale PNG; save depth with 16 bits and one channel");
  }
  if (const auto trouble = check_size(reader)) return bad(*trouble);
  DepthFrame frame;
  frame.width = static_cast<int>(reader.width());
  frame.height = static_cast<int>(reader.height());
  frame.unit = unit;
  frame.pixels.resize(static_cast<std::size_t>(frame.width) * frame.height);
  std::vector<png_bytep> rows = rows_of(frame.pixels, frame.width, frame.height);
  if (!reader.read_pixels(rows.data())) return not_a_png(reader);
  return frame;
}

Result<LabelImage> load_label_png(const std::filesystem::path& path) {
  const auto content = read_file(path, kMaxFileBytes);
  if (!content) return content.error();
  const auto bad = [&](const std::string& what) {
    return Error{Errc::bad_input, path.string() + " " + what};
  };
  if (!is_png(*content)) {
    return bad("is not a PNG file; label images are grayscale or palette PNG files of 8 bits");
  }
  Reader reader(*content);
  LabelImage image;
  if (reader.read_header()) {
    if (!reader.is_label8()) {
      return bad(
          "is not a PNG of labels; save it with 8 bits and one channel, grayscale or with a "
          "palette");
    }
    if (const auto trouble = check_size(reader)) return bad(*trouble);
    image.width = static_cast<int>(reader.width());
    image.height = static_cast<int>(reader.height());
    const auto wide = static_cast<std::size_t>(image.width);
    image.labels.resize(wide * static_cast<std::size_t>(image.height));
    std::vector<png_bytep> rows;
    for (std::size_t at = 0; at < image.labels.size(); at += wide) {
      rows.push_back(image.labels.data() + at);
    }
    if (reader.read_pixels(rows.data())) return image;
  }
  return bad(std::string("is not a good PNG: ") + reader.message() + "; make it again");
}

Status save_depth_png(const DepthFrame& frame, const std::filesystem::path& path) {
  const auto content = encode_depth_png(frame, path.string());
  if (!content) return content.error();
  return write_file_atomically(path, *content);
}

Result<std::string> encode_depth_png(const DepthFrame& frame, const std::string& name) {
  if (frame.width < 1 || frame.height < 1 || frame.width > kMaxImageWidth ||
      frame.height > kMaxImageHeight ||
      frame.pixels.size() != static_cast<std::size_t>(frame.width) * frame.height)
    return Error{Errc::invalid_argument, "cannot write " + name +
                                             ": the frame has no pixels, too many, or not width "
                                             "times height of them"};
  Writer writer;
  // libpng takes rows it could write to, but does not.
  auto& pixels = const_cast<std::vector<std::uint16_t>&>(frame.pixels);
  std::vector<png_bytep> rows = rows_of(pixels, frame.width, frame.height);
  if (!writer.write(frame.width, frame.height, rows.data()))
    return Error{Errc::io_failure, "cannot write " + name + ": " + writer.message()};
  return std::move(writer.content());
}

}}  // namespace palpate::v0
