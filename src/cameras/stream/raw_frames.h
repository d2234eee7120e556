// Parts that cameras of all makers share: choice of modes, copies of rows, times to wait.
#pragma once

#include <atomic>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/cameras/cameras.h"
#include "palpate/cloud/depth_source.h"

namespace palpate { inline namespace v0 {

inline constexpr int kWaitMilliseconds = 100;  // period of the check for cancellation

struct ImageMode {
  int width = 0, height = 0;
  int rate = 0;  ///< Hz
};
/// Chooses a mode: of the requested size, else the largest one up to `usual`; of these the rate
/// nearest to the requested one, else to 30 Hz; the first one of equals. None: no such size.
std::optional<std::size_t> choose_mode(std::span<const ImageMode> modes, const CameraUri& uri,
                                       ImageSize usual);
/// "640x480 at 30 Hz, ..."; "none" without any.
std::string listed(std::span<const ImageMode> modes);

/// Copies an image whose rows begin every `stride` bytes.
void copy_rows(const void* data, std::ptrdiff_t stride, int width, int height, DepthFrame& frame);

/// Scales intrinsics and distortion from the size `of` to the size that `info` has.
void scale_camera(ImageSize of, DepthStreamInfo& info);

/// Notes of a raw stream. Any threads.
class RawNotes {
 public:
  void add(std::string text) {
    const std::lock_guard lock(mutex_);
    notes_.push_back(std::move(text));
  }
  std::vector<std::string> take() {
    const std::lock_guard lock(mutex_);
    return std::exchange(notes_, {});
  }

 private:
  std::mutex mutex_;
  std::vector<std::string> notes_;
};
/// The parts that the sources of all makers share.
class MakersSource : public DepthSource {
 public:
  const DepthStreamInfo& info() const final { return info_; }
  void cancel() noexcept final { is_cancelled_ = true; }
  std::vector<std::string> take_notes() final { return notes_.take(); }

 protected:
  /// Refuses to wait any longer for a frame that was expected at `begin` (monotonic_now).
  Status check_silence(double begin) const;

  DepthStreamInfo info_;
  RawNotes notes_;
  std::atomic<bool> is_cancelled_ = false;
};

/// Note on a lens whose distortion is of a model that is not removed.
inline constexpr char kUnknownLens[] =
    "has a lens whose distortion is of a model that is not known here, such as the inverse "
    "Brown-Conrady of an SR300: it is not removed, and towards the edge of the image positions are "
    "wrong, by 5 cm at 1 m for an SR300; pass ?distortion=k1,k2,p1,p2,k3, or keep to the middle";

/// The number in "1", at most three digits; 0 of an empty text.
std::optional<int> camera_number(const std::string& target);

/// Returns the kind of sensor by a maker's name of the camera: "Intel RealSense D435" is active
/// stereo. None: unknown.
SensorKind sensor_of_model(std::string_view name);

/// Lists models of cameras, each once: "Intel RealSense D435, Intel RealSense SR305"; without any
/// returns `otherwise`.
std::string listed_models(std::vector<std::string> models, std::string_view otherwise);

/// "2.59.1" of 25901.
std::string dotted_version(int number);

}}  // namespace palpate::v0
