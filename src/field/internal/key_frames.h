// Key frames, the memory of a moving camera: frames from earlier poses, as further views of the
// depth hull (docs/decisions/0036-key-frames.md).
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "src/field/timeline/frame_slots.h"

namespace palpate { inline namespace v0 {

/// A grid of depths as a pinhole camera at X_WC has them along the z axis; 0: nothing is known.
struct DepthGrid {
  int width = 0, height = 0;
  Intrinsics intrinsics;  ///< of its points
  Pose X_WC;
  std::vector<float> depth;  ///< m, row by row

  Vec3d point(int i) const { return point(i, depth[static_cast<std::size_t>(i)]); }
  Vec3d point(int i, double z) const {
    const int u = i % width, v = i / width;
    return {(u - intrinsics.cx) / intrinsics.fx * z, (v - intrinsics.cy) / intrinsics.fy * z, z};
  }
  /// The number of the point that sees p_C; -1: none does.
  int index_of(const Vec3d& p_C) const {
    if (!(p_C.z > 0)) return -1;
    const double u = p_C.x / p_C.z * intrinsics.fx + intrinsics.cx + 0.5;
    const double v = p_C.y / p_C.z * intrinsics.fy + intrinsics.cy + 0.5;
    if (!(u >= 0 && v >= 0 && u < width && v < height)) return -1;
    return static_cast<int>(v) * width + static_cast<int>(u);
  }
};

/// Visibility of a point in a frame.
enum class Sight {
  outside,  ///< of the image
  unknown,  ///< nothing was measured there
  hidden,   ///< behind something
  seen,
  through,  ///< what is farther away: there is nothing
};

/// Changes that a newer frame shows at the points of an older one.
class FrameEvidence {
 public:
  FrameEvidence(int num_points, const MemoryOptions& options);

  /// Compares the points of `kept` with the current frame.
  void look(const DepthGrid& kept, const DepthGrid& now);
  /// Depth of a new surface in front of a point of `kept`, as thick as MemoryOptions::thickness
  /// along the rays of `now`; 0: none.
  float come(int i) const;
  /// Depth of the surface behind a point of `kept` that has gone, 0 if unknown; none if it has not.
  std::optional<float> gone(int i) const;
  Sight sight(const DepthGrid& now, const Vec3d& p_N) const;

 private:
  /// Evidence for a change of a point.
  enum class Mark : std::uint8_t { none, several, beside };

  template <class Says>
  static void mark(const DepthGrid& kept, const Says& says, std::vector<Mark>& marks);
  void thicken(const DepthGrid& kept, const DepthGrid& now);

  float tolerance_;
  double thickness_;
  // Per point: depths of the surfaces seen before it and behind it, and of the inside of new
  // surfaces; 0: none.
  std::vector<float> near_, beyond_, inside_;
  std::vector<Mark> come_, gone_;
  std::vector<std::uint8_t> is_through_;
};

/// The kept frames and their surfaces. A frame is kept when enough of the free space that it has
/// seen is known by none of them; without a free seat it replaces the one that adds least. A newer
/// frame removes contradicted points: at once where it sees through a surface, and where a new
/// surface has come before one once that is out of sight.
class KeyFrames {
 public:
  using MakeSlots = std::function<Result<std::unique_ptr<FrameSlots>>(const SlotSettings&)>;
  /// Keeps frames of a timeline that is made with `settings`. Errors: those of `make_slots`.
  static Result<KeyFrames> create(const SlotSettings& settings, const MakeSlots& make_slots);

  /// Takes the next frame, counts in host memory. Makes at most three surfaces. The same bits for
  /// any number of threads; no allocation. O(points of all frames).
  void take(const DepthImageView& frame, ThreadPool& pool);
  /// Views from the state before the last frame to the current one, valid for as long as the views
  /// of a timeline.
  std::span<const SurfaceBlend> views() const { return {views_.data(), num_used_}; }
  /// An error if the last frame could not be taken, or the GPU has failed.
  const Status& status() const { return status_ ? slots_->status() : status_; }

 private:
  struct Seat {
    Seat(std::size_t num_points, const MemoryOptions& options);

    DepthFrame image;           // in half the resolution, with what has changed
    DepthGrid grid;             // some of its points
    std::vector<float> before;  // depth of new surfaces before these; 0: none
    FrameEvidence evidence;
    bool has_changed = false;
    int slot = -1;  // of its surface
  };
  KeyFrames(const SlotSettings& settings, const DepthStreamInfo& stream, int binning,
            std::unique_ptr<FrameSlots> slots, int num_slots);

  void sample(const DepthFrame& image, DepthGrid& grid) const;
  void contradict(Seat& seat) const;
  void change(Seat& seat, int i, float depth) const;
  double share_of_new(const DepthGrid& grid, int stride, const Seat* but,
                      const DepthGrid* also) const;
  Seat* keep();
  void make(Seat& seat, ThreadPool& pool);
  int free_slot() const;

  DepthStreamInfo stream_;
  int binning_;
  double step_;
  std::unique_ptr<FrameSlots> slots_;
  std::vector<std::uint32_t> pixels_;  // of the points of a grid, by number
  std::vector<Seat> seats_;
  std::size_t num_used_ = 0, turn_ = 0;
  std::vector<SurfaceBlend> views_;
  std::vector<std::int64_t> last_shown_;  // of each slot: in views after this frame
  std::int64_t num_frames_ = 0;
  Status status_ = Done{};
  DepthFrame small_;
  DepthGrid now_;
};

}}  // namespace palpate::v0
