// The depth field: one smooth scalar field per frame: distance to the surface in front of it, minus
// the distance to free space behind it. Spheres evaluate it at their centers; its gradient is the
// force direction. It makes contact continuous and conservative.
#pragma once

#include <cstdint>
#include <memory>

#include "palpate/cloud/point_cloud.h"
#include "palpate/core/core.h"
#include "palpate/settings/setting_table.h"

namespace palpate { inline namespace v0 {

// Memory of a camera for space that is now occluded or out of view: so a hand in front of a table
// does not make everything behind it solid.

enum class DepthMemory {
  off,  ///< each frame alone: everything behind its surface is solid
  /// A static camera: each pixel stores the farthest surface since the last contradiction. A
  /// foreground object is MemoryOptions::thickness thick, and behind it is what was seen before. A
  /// moving camera stores key frames: the space they have seen to be free stays free, and their
  /// surfaces stay solid, until a newer frame contradicts them.
  on,
};
constexpr auto names_of(DepthMemory) { return std::array{"off", "on"}; }

/// MemoryOptions::horizon, s: never forget.
inline constexpr double kForEver = 1e6;

/// Options of the memory for occluded space.
struct MemoryOptions {
  DepthMemory kind = DepthMemory::off;
  /// s: space that has been occluded for longer is forgotten. Then everything behind the occluder
  /// is solid, from one frame to the next, also where a tool is.
  double horizon = kForEver;
  double thickness = 0.06;  ///< of a foreground object, m
  /// Share of the depth: a measurement nearer than the memory by more is a foreground, one that is
  /// farther by more contradicts it. Must exceed the camera's noise.
  double step = 0.02;
  /// Moving camera: maximum number of key frames. Fewer with several moving cameras
  /// (kMaxCameras).
  int frames = 8;
};
inline void add_settings(SettingTable& t, MemoryOptions& o) {
  t.add("memory", o.kind,
        "field: remember space that is now occluded; a moving camera also what is out "
        "of view");
  t.add("memory_horizon", o.horizon, {0, kForEver, "s"},
        "memory, static camera: forget space that has been occluded for longer; "
        "1000000: never");
  t.add("memory_thickness", o.thickness, {1e-3, 10, "m"},
        "memory: thickness of foreground objects");
  t.add("memory_step", o.step, {1e-3, 1},
        "memory: share of the depth; nearer by more is a foreground, farther by more a "
        "contradiction");
  t.add("memory_frames", o.frames, {1, 15}, "memory, moving camera: maximum number of key frames");
}

struct TangentPlane;  // of a pixel, see src/cloud/internal/tangent_plane.h

/// Space where the camera measured nothing and hole filling did not reach.
enum class UnknownSpace {
  free,   ///< nothing: contact fades out over about the width of a sphere at the border
  solid,  ///< the surrounding surface continues flat, however wide the hole
  /// Everything is solid unless seen to be free. Not with a thickness.
  blocked,
};
constexpr auto names_of(UnknownSpace) { return std::array{"free", "solid", "blocked"}; }

/// A thickness for which everything behind a surface is solid, m.
inline constexpr double kSolidBehind = 1e6;

/// Policy for space behind surfaces that no camera has seen.
enum class UnseenSpace {
  solid,  ///< the surface continues, however deep
  /// A surface is DepthFieldOptions::thickness thick; deeper, a tool is pushed out of the back, and
  /// beyond twice the thickness there is nothing.
  free,
  fade,  ///< beyond the thickness there is no force, but it counts as volume
};
constexpr auto names_of(UnseenSpace) { return std::array{"solid", "free", "fade"}; }

/// Options of the depth field: the meaning of pixels without depth and of occluded space.
struct DepthFieldOptions {
  UnknownSpace unknown = UnknownSpace::free;
  /// Holes up to about 2^fill_levels pixels wide are filled by interpolation from their borders,
  /// runs of up to 64 pixels between two surfaces by the farther one. 0 fills none.
  int fill_levels = 4;
  UnseenSpace unseen = UnseenSpace::solid;
  /// m, unless `unseen` is solid: up to this depth behind the first surface, along its normal, a
  /// tool is pushed out of the front.
  double thickness = 0.05;
  /// Each frame also stores which space its camera has seen to be free (SurfaceView::seen_free), at
  /// twice the cost. Needed to combine several cameras.
  bool one_of_several = false;
};
/// Options of the field of space that the camera has seen to be free.
inline DepthFieldOptions options_of_seen_free(const DepthFieldOptions& options) {
  DepthFieldOptions seen_free;
  seen_free.unknown = UnknownSpace::blocked;
  seen_free.fill_levels = options.fill_levels;
  return seen_free;
}
inline void add_settings(SettingTable& t, DepthFieldOptions& o) {
  t.section("field");
  t.add("unknown", o.unknown, "field: space without measurement");
  t.add("fill_levels", o.fill_levels, {0, 5}, "field: fill holes up to about 2^this pixels wide");
  t.add("unseen", o.unseen,
        "field: space behind surfaces that no camera sees: solid, or beyond the thickness free or "
        "without force");
  t.add("thickness", o.thickness, {1e-3, 10, "m"},
        "field, with unseen free or fade: depth behind a surface up to which a tool is pushed out "
        "of its front");
}

/// The nearest silhouette of a pixel: where a surface ends in front of something farther away. In
/// the near surface, `side` is negative and the plane is that of the far one; in the far surface,
/// `side` is positive and the plane is that of the near one. At depth z, |side| z is the distance
/// from the pixel's ray to the side wall of the near surface's shadow, m.
struct alignas(16) Silhouette {
  float side = 0;               ///< 0: no silhouette within kSilhouetteReach pixels
  float offset = 0, slope = 0;  ///< the other surface, see DepthFieldLevel::planes
  float unused = 0;
};

/// One resolution. Each pixel has the tangent plane of its surface point, evaluated along the
/// pixel's own ray: at depth z the plane is `offset - z * slope` meters away, with offset = d of
/// the plane n . x = -d and slope = d / (depth of the point). A pixel without surface has slope 0.
/// Pixel (u, v) is number v * stride + u, and kBorder more pixels follow on all sides; all levels
/// have one stride.
struct DepthFieldLevel {
  static constexpr int kBorder = 16;
  /// Search radius of silhouettes, pixels; coarser levels see those farther away.
  static constexpr int kSilhouetteReach = 3;

  const float* planes = nullptr;  ///< offset, slope, offset, slope, ...
  /// Two per pixel: as near surface, and as far surface. Valid only around pixels near
  /// silhouettes.
  const Silhouette* silhouettes = nullptr;
  const std::uint8_t* near_silhouette = nullptr;  ///< 1: one of the 3 x 3 pixels has a silhouette
  int width = 0, height = 0;
  int stride = 0;
  float scale = 1;  ///< pixels of this level per pixel of the depth image: 2^-level
  /// Width of the border around the image to which its outermost surface extends, with
  /// UnknownSpace::free, pixels. So queries up to half a pixel beyond the image see no end of it.
  static constexpr int kGoesOn = 5;
  /// Largest column and row that may be queried: image width and height minus kFirst, which is the
  /// smallest. Beyond them everything is constant: there is no silhouette nearby.
  float last_u = 0, last_v = 0;
  static constexpr float kFirst = -5 - kGoesOn;
};

/// Bound for a square of kTileSize pixels: at depth z, each of their planes is at least
/// min_slope * (nearest - z) away, if that is positive.
struct DepthTile {
  float nearest = 0;    ///< least depth of their surface points, m
  float min_slope = 0;  ///< least slope of their planes
};

/// Input of queries; non-owning, trivially copyable. Level k has pixels 2^k wide.
struct DepthFieldView {
  static constexpr int kMaxLevels = 6, kTileSize = 16;

  DepthFieldLevel levels[kMaxLevels];
  int num_levels = 0;  ///< 0: no field
  /// The window in which the field is valid (src/field/internal/needed_window.h): there all levels
  /// equal those of a field of the whole image; elsewhere they may be anything.
  PixelWindow requested;
  const DepthTile* tiles = nullptr;  ///< row-major; pixels beyond the image count to the outermost
  int tiles_wide = 0, tiles_high = 0;
  /// Pixels of level 0 that were not measured and show the farther one of two surfaces beside them:
  /// a bit each from the lowest one on, filled_stride words in a row. Null: none, or not known.
  const std::uint32_t* filled_behind = nullptr;
  int filled_stride = 0;
  Intrinsics intrinsics;
  /// See DepthFieldOptions; kSolidBehind: UnseenSpace::solid, negative: UnseenSpace::fade.
  float thickness = 0;
  const FrameNoise* noise = nullptr;  ///< random noise of the depth; null: unknown
  int gpu = kHostMemory;              ///< whose memory the arrays are in
  /// Two views with the same stamp show the same values, except for stamp 0.
  std::uint64_t stamp = 0;

  /// The policy for occluded space.
  UnseenSpace unseen() const {
    if (thickness < 0) return UnseenSpace::fade;
    return thickness < static_cast<float>(kSolidBehind) ? UnseenSpace::free : UnseenSpace::solid;
  }
};

/// A depth field of one image size. Owns its buffers; `update` allocates nothing.
class DepthField {
 public:
  /// Allocates all buffers. Errors: a size out of 8..4096, options out of range. All instruction
  /// sets give the same bits; an unsupported one falls back to a lower one.
  static Result<DepthField> create(int width, int height, const DepthFieldOptions& options = {},
                                   Isa isa = best_isa());
  DepthField(DepthField&&) noexcept;
  DepthField& operator=(DepthField&&) noexcept;
  ~DepthField();

  /// Recomputes the field from an organized pinhole cloud of the size given at construction, for
  /// queries inside `requested`. Same bits for any number of threads and any window. O(pixels of
  /// the window and about 2^kMaxLevels * 6 around it).
  void update(const PointCloudView& cloud, ThreadPool& pool, const PixelWindow& requested = {});
  /// The same from the planes of all points, row-major; a point without plane has slope 0.
  void update(const TangentPlane* planes, const Intrinsics& intrinsics, ThreadPool& pool,
              const PixelWindow& requested = {});
  /// The points of a cloud that an update for `requested` reads.
  PixelWindow points_for(const PixelWindow& requested) const;

  /// Valid until the next update; no levels before the first one.
  const DepthFieldView& view() const;

 private:
  struct Impl;
  explicit DepthField(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}}  // namespace palpate::v0
