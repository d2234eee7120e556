#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <optional>
#include <span>
#include <string>
#include <unordered_set>
#include <utility>
#include <vector>

#include "palpate/io/formats.h"
#include "src/io/internal/atomic_file.h"
#include "src/io/internal/frame_list.h"

namespace palpate { inline namespace v0 {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLookedAt = 10'000;  // frames whose size is known before they are read

Error bad(const fs::path& path, const std::string& what) {
  return {Errc::bad_input, path.string() + " " + what};
}

struct ImageSize {
  std::uint32_t width = 0, height = 0;

  friend bool operator==(const ImageSize&, const ImageSize&) = default;
};

/// From the first bytes of a PNG: signature, length and name of the chunk IHDR, width, height, bits
/// per channel, color type.
Result<ImageSize> read_size(const fs::path& path) {
  constexpr std::string_view kStart("\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR", 16);
  constexpr std::string_view kGray16("\x10\0", 2);
  std::array<char, 26> bytes{};
  std::error_code ignored;
  const auto kind = fs::status(path, ignored).type();
  if (kind == fs::file_type::not_found)
    return Error{Errc::not_found, "no such frame: " + path.string() + "; check the list"};
  if (kind != fs::file_type::regular && kind != fs::file_type::none)
    return bad(path, "is not a file but is named as a frame; rename or remove it");
  std::ifstream file(path, std::ios::binary);
  if (!file)
    return Error{Errc::io_failure, "cannot read " + path.string() + ": " + std::strerror(errno) +
                                       "; check its permissions"};
  file.read(bytes.data(), bytes.size());
  if (file.bad())
    return Error{Errc::io_failure, "cannot read " + path.string() + "; check the disk"};
  const std::string_view header(bytes.data(), static_cast<std::size_t>(file.gcount()));
  if (header.size() < bytes.size() || !header.starts_with(kStart) || !header.ends_with(kGray16))
    return bad(path, "is not a 16-bit grayscale PNG; save depth with 16 bits and one channel");
  const auto big_endian = [&](std::size_t at) {
    std::uint32_t value = 0;
    for (std::size_t k = at; k < at + 4; ++k)
      value = value << 8 | static_cast<unsigned char>(header[k]);
    return value;
  };
  const ImageSize size{big_endian(16), big_endian(20)};
  if (size.width < 1 || size.height < 1 || size.width > kMaxImageWidth ||
      size.height > kMaxImageHeight)
    return bad(path, "has no pixels or more than 4096 x 4096; give another image");
  return size;
}

/// Returns the file with the flow of a frame.
fs::path flow_file(const fs::path& folder, const fs::path& frame) {
  return (folder / frame.filename()).replace_extension(".flo");
}

/// True if any of the frames has a flow file: there may be millions, too many to look up each.
bool has_flow(const fs::path& folder, const std::vector<FrameEntry>& entries) {
  std::error_code error;
  std::unordered_set<std::string> names;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    if (it->path().extension() == ".flo") names.insert(it->path().stem().string());
  }
  return std::ranges::any_of(entries, [&](const FrameEntry& entry) {
    return names.contains(fs::path(entry.path).stem().string());
  });
}

/// Middlebury's format, little-endian: "PIEH", width, height, then u and v of each pixel as floats.
Result<std::vector<float>> load_flow(const fs::path& path, int width, int height) {
  const auto content = read_file(path);
  if (!content) return content.error();
  constexpr std::size_t kHeader = 12;
  std::array<std::int32_t, 2> size{};
  const bool is_flow = content->size() >= kHeader && content->starts_with("PIEH");
  if (is_flow) std::memcpy(size.data(), content->data() + 4, sizeof size);
  const std::size_t num = 2 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  if (size[0] != width || size[1] != height || content->size() != kHeader + num * sizeof(float)) {
    return bad(path, "is not an optical flow of " + std::to_string(width) + " x " +
                         std::to_string(height) + " pixels in Middlebury's format; write it anew");
  }
  std::vector<float> flow(num);
  std::memcpy(flow.data(), content->data() + kHeader, num * sizeof(float));
  return flow;
}

class FolderSource : public DepthSource {
 public:
  /// `flow`: a folder; empty: none.
  FolderSource(std::vector<FrameEntry> entries, DepthStreamInfo info, fs::path flow)
      : entries_(std::move(entries)), info_(std::move(info)), flow_(std::move(flow)) {}

  const DepthStreamInfo& info() const override { return info_; }

  Result<bool> next(DepthFrame& frame) override {
    if (next_ == entries_.size()) return false;
    const FrameEntry& entry = entries_[next_++];
    auto loaded = load_depth_png(entry.path, info_.unit);
    if (!loaded) return loaded.error();
    if (loaded->width != info_.width || loaded->height != info_.height)
      return bad(entry.path, "is not of the size of the first frame; give frames of one camera");
    frame = *std::move(loaded);
    frame.timestamp = entry.time;
    if (!info_.has_flow) return true;
    const fs::path path = flow_file(flow_, entry.path);
    std::error_code ignored;
    if (!fs::exists(path, ignored)) return true;
    auto flow = load_flow(path, frame.width, frame.height);
    if (!flow) return flow.error();
    frame.flow = *std::move(flow);
    return true;
  }

 private:
  std::vector<FrameEntry> entries_;
  DepthStreamInfo info_;
  fs::path flow_;
  std::size_t next_ = 0;
};

std::optional<Error> check(const DepthFolderOptions& options) {
  const auto positive = [](double value) { return value > 0 && std::isfinite(value); };
  const Intrinsics& camera = options.intrinsics;
  if (positive(options.unit) && positive(options.rate) && positive(camera.fx) &&
      positive(camera.fy) && std::isfinite(camera.cx) && std::isfinite(camera.cy))
    return std::nullopt;
  return Error{Errc::invalid_argument,
               "a depth folder needs a positive unit, rate, fx and fy; give the camera's "
               "intrinsics in pixels"};
}

}  // namespace

Result<std::unique_ptr<DepthSource>> open_depth_folder(const fs::path& folder,
                                                       const DepthFolderOptions& options) {
  if (auto error = check(options)) return *std::move(error);
  const auto list = list_frames(folder, options.rate);
  if (!list) return list.error();
  return open_depth_folder(folder, *list, options);
}

Result<std::unique_ptr<DepthSource>> open_depth_folder(const fs::path& folder,
                                                       const FrameList& list,
                                                       const DepthFolderOptions& options) {
  const std::vector<FrameEntry>& entries = list.entries;
  const auto size = read_size(entries.front().path);
  if (!size) return size.error();
  for (const FrameEntry& entry : std::span(entries).first(std::min(entries.size(), kLookedAt))) {
    const auto other = read_size(entry.path);
    if (!other) return other.error();
    if (!(*other == *size))
      return bad(entry.path, "is not of the same size as " + entries.front().path +
                                 "; put only frames of one camera into a folder");
  }
  DepthStreamInfo info{static_cast<int>(size->width),
                       static_cast<int>(size->height),
                       options.intrinsics,
                       options.unit,
                       list.rate,
                       static_cast<int>(entries.size()),
                       folder.string()};
  info.has_flow = !options.flow.empty();
  if (info.has_flow && !has_flow(options.flow, entries)) {
    return bad(options.flow, "has no optical flow of these frames: NAME.flo goes with NAME.png");
  }
  return std::unique_ptr<DepthSource>(
      std::make_unique<FolderSource>(entries, std::move(info), options.flow));
}

}}  // namespace palpate::v0
