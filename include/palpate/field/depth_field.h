// One scalar field per depth frame that does not depend on the tool: in front of the surface the
// distance to it, behind it minus the distance to free space. A sphere asks it at its centre, and
// its gradient is where the force points. What makes contact continuous and conservative.
#pragma once

#include <cstdint>
#include <memory>

#include "palpate/cloud/point_cloud.h"
#include "palpate/core/core.h"
#include "palpate/settings/setting_table.h"

namespace palpate::inline v0 {

// What a camera remembers of what is hidden now, or out of its sight: a hand before a table does
// not make everything behind it solid.

enum class DepthMemory {
  off,  ///< every frame by itself: all that lies behind its surface is solid
  /// Each pixel keeps the farthest surface that it has seen since that was last contradicted. What
  /// comes before it is as thick as MemoryOptions::thickness, and behind that is what was seen. A
  /// camera that moves keeps frames from where it was: space that they have seen to be free is free
  /// until a newer frame contradicts that, and what they show is felt.
  on,
};
constexpr auto names_of(DepthMemory) { return std::array{"off", "on"}; }

/// "Remembering for ever": MemoryOptions::horizon, s.
inline constexpr double kForEver = 1e6;

struct MemoryOptions {
  DepthMemory kind = DepthMemory::off;
  /// What has been hidden for longer is forgotten, s: then all behind what hides it is solid, from
  /// one frame to the next, also where a tool is.
  double horizon = kForEver;
  double thickness = 0.06;  ///< of what comes before what is remembered, m
  /// Share of the depth: what is nearer than what is remembered by more comes before it, and what
  /// is farther by more contradicts it. Wider than the camera's noise.
  double step = 0.02;
  /// Of a camera that moves: it keeps no more frames. Fewer where several cameras do
  /// (kMostCameras).
  int frames = 8;
};
inline void add_settings(SettingTable& t, MemoryOptions& o) {
  t.add("memory", o.kind,
        "by the field: what lies behind something that has come before it stays known, and by a "
        "camera that moves what it has seen before");
  t.add("memory_horizon", o.horizon, {0, kForEver, "s"},
        "memory, a camera that stands still: what has been hidden for longer is forgotten; "
        "1000000: nothing is");
  t.add("memory_thickness", o.thickness, {1e-3, 10, "m"},
        "memory: of what has come before what is remembered");
  t.add("memory_step", o.step, {1e-3, 1},
        "memory: share of the depth; what is nearer by more has come before what is remembered, "
        "what is farther by more contradicts it");
  t.add("memory_frames", o.frames, {1, 15},
        "memory, a camera that moves: keeps no more frames from where it was");
}

struct TangentPlane;  // of a pixel, see src/field/field_pixels.h

/// What lies where the camera measured nothing and hole filling did not reach.
enum class UnknownSpace {
  free,   ///< nothing: contact fades out over the width of a sphere at the border
  solid,  ///< the surface goes on from what is around it, flat, however wide the hole
  /// Everything, from the camera on: free is only what was seen to be free. Not with a thickness.
  blocked,
};
constexpr auto names_of(UnknownSpace) { return std::array{"free", "solid", "blocked"}; }

/// Thick enough for everything behind a surface to be solid, metres.
inline constexpr double kSolidBehind = 1e6;

/// What lies behind surfaces where no camera has seen anything: the policy.
enum class UnseenSpace {
  solid,  ///< the surface goes on, however deep
  /// A surface is as thick as DepthFieldOptions::thickness, from where on a tool is pushed out of
  /// the back; from twice as far on there is nothing.
  free,
  fade,  ///< what lies deeper than the thickness is pushed no more, but counts as volume
};
constexpr auto names_of(UnseenSpace) { return std::array{"solid", "free", "fade"}; }

struct DepthFieldOptions {
  UnknownSpace unknown = UnknownSpace::free;
  /// Holes up to about 2^fill_levels pixels across are closed by surface interpolated from around
  /// them; 0 closes none.
  int fill_levels = 4;
  UnseenSpace unseen = UnseenSpace::solid;
  /// Unless it is solid: how far behind the first surface along its normal a tool is pushed back
  /// out of the front, m.
  double thickness = 0.05;
  /// Each frame also tells what its camera has seen to be free (SurfaceView::seen_free), at as much
  /// cost again: what several cameras are joined by.
  bool one_of_several = false;
};
/// Of the field that tells what its camera has seen to be free.
inline DepthFieldOptions options_of_seen_free(const DepthFieldOptions& options) {
  DepthFieldOptions seen_free;
  seen_free.unknown = UnknownSpace::blocked;
  seen_free.fill_levels = options.fill_levels;
  return seen_free;
}
inline void add_settings(SettingTable& t, DepthFieldOptions& o) {
  t.section("field");
  t.add("unknown", o.unknown, "by the field: what lies where nothing was measured");
  t.add("fill_levels", o.fill_levels, {0, 5},
        "by the field: close holes up to about 2^this pixels wide");
  t.add("unseen", o.unseen,
        "by the field: what lies behind surfaces, where no camera has seen anything, is solid; or, "
        "deeper than thickness, free, or pushed no more");
  t.add("thickness", o.thickness, {1e-3, 10, "m"},
        "by the field, with unseen free or fade: how far behind a surface a tool is pushed out of "
        "its front");
}

/// How a pixel sees the nearest place where a surface ends in front of something farther away. For
/// a pixel of the near surface `side` is negative and the plane that of the far one; for a pixel of
/// the far surface it is positive and the plane that of the near one. At depth z, |side| z is the
/// distance from the pixel's ray to the side wall of the near surface's shadow, in metres.
struct alignas(16) Silhouette {
  float side = 0;               ///< 0: there is none within kSilhouetteReach pixels
  float offset = 0, slope = 0;  ///< the other surface, as DepthFieldLevel::planes
  float unused = 0;
};

/// One resolution. Each pixel has the tangent plane of its surface point as it is met along the
/// pixel's own ray: at depth z it is `offset - z * slope` metres away, with offset = d of the plane
/// n . x = -d and slope = d / (depth of the point). A pixel without surface has slope 0. Pixel (u,
/// v) is number v * stride + u, and kBorder more pixels follow on all sides; all levels have one
/// stride.
struct DepthFieldLevel {
  static constexpr int kBorder = 10;
  /// So many pixels away silhouettes are known; from farther away wider pixels see them.
  static constexpr int kSilhouetteReach = 3;

  const float* planes = nullptr;  ///< offset, slope, offset, slope, ...
  /// Two a pixel: of the pixel as a near surface, and as a far one. Written only around pixels that
  /// are near silhouettes.
  const Silhouette* silhouettes = nullptr;
  const std::uint8_t* near_silhouette = nullptr;  ///< 1: one of the nine pixels around has any
  int width = 0, height = 0;
  int stride = 0;
  float scale = 1;  ///< pixels of this level per pixel of the depth image: 2^-level
  /// Greatest column and row that can be asked, the image's width and height here plus 5; the least
  /// is kFirst. Beyond them everything is constant: no silhouette is that near.
  float last_u = 0, last_v = 0;
  static constexpr float kFirst = -5;
};

/// A bound for a square of kTileSize pixels: at depth z, each of their planes is at least
/// least_slope * (nearest - z) away as long as that is positive.
struct DepthTile {
  float nearest = 0;      ///< least depth of their surface points, m
  float least_slope = 0;  ///< least slope of their planes
};

/// What queries see; not owning, trivially copyable. Level k has pixels 2^k wide.
struct DepthFieldView {
  static constexpr int kMaxLevels = 6, kTileSize = 16;

  DepthFieldLevel levels[kMaxLevels];
  int num_levels = 0;  ///< 0: no field
  /// Where the field may be asked (src/field/internal/asked_window.h): there all levels have the
  /// values that they have in a field of the whole image; elsewhere they may be anything.
  PixelWindow asked;
  const DepthTile* tiles = nullptr;  ///< row by row; pixels beyond the image count to the outermost
  int tiles_wide = 0, tiles_high = 0;
  Intrinsics intrinsics;
  /// As DepthFieldOptions; kSolidBehind: UnseenSpace::solid, negative: UnseenSpace::fade.
  float thickness = 0;
  int gpu = kHostMemory;  ///< whose memory the arrays are in
  /// Two views with one stamp show the same values, unless it is 0.
  std::uint64_t stamp = 0;

  UnseenSpace unseen() const {
    if (thickness < 0) return UnseenSpace::fade;
    return thickness < static_cast<float>(kSolidBehind) ? UnseenSpace::free : UnseenSpace::solid;
  }
};

/// Owns the images for one image size; `update` allocates nothing.
class DepthField {
 public:
  /// Errors: a size out of 8..4096, options out of range. All instruction sets give the same bits;
  /// one that the processor lacks is lowered.
  static Result<DepthField> create(int width, int height, const DepthFieldOptions& options = {},
                                   Isa isa = best_isa());
  DepthField(DepthField&&) noexcept;
  DepthField& operator=(DepthField&&) noexcept;
  ~DepthField();

  /// Rebuilds the field from an organised pinhole cloud of the size given at construction, for
  /// queries inside of `asked`. The same bits for any number of threads and any window. O(pixels of
  /// the window and about 2^kMaxLevels * 6 around).
  void update(const PointCloudView& cloud, ThreadPool& pool, const PixelWindow& asked = {});
  /// The same from the planes of all its points, row by row, where none has one the slope is 0.
  void update(const TangentPlane* planes, const Intrinsics& intrinsics, ThreadPool& pool,
              const PixelWindow& asked = {});
  /// The points of a cloud that an update for `asked` looks at.
  PixelWindow points_for(const PixelWindow& asked) const;

  /// Valid until the next update; no levels before the first one.
  const DepthFieldView& view() const;

 private:
  struct Impl;
  explicit DepthField(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate::inline v0
