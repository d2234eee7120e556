// From depth frames to surfaces: a timeline of frames, batches of images, or a single Sensor.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/cloud/surface_estimator.h"
#include "palpate/field/depth_field.h"
#include "palpate/gpu/devices.h"

namespace palpate { inline namespace v0 {

// Between depth frames. Frames arrive at 30 Hz and the haptic loop runs at 1 kHz: switching to each
// new frame on arrival would make the force jump thirty times per second.

enum class TimeMode {
  latest,       ///< the newest frame at once: no lag, but steps
  interpolate,  ///< blend from the last frame to the newest: no steps, one frame of lag
  /// Blend toward the predicted surface at the time of the next frame, each pixel moving as it did
  /// between the last two frames. Errors of the prediction are corrected without a step.
  predict,
};
constexpr auto names_of(TimeMode) { return std::array{"latest", "interpolate", "predict"}; }

/// Options of the transition between the surfaces of a stream of frames.
struct TimeOptions {
  TimeMode mode = TimeMode::interpolate;
  DepthAverageOptions average = {};
  MemoryOptions memory = {};
  /// predict: a pixel whose depth changed by more than this share belongs to another surface and is
  /// not moved.
  double max_jump = 0.03;
  /// Expected time between the first frames, s; 0: as the stream reports.
  double first_period = 0;
};
inline void add_settings(SettingTable& t, TimeOptions& o) {
  t.section("time");
  t.add("mode", o.mode, "blend between two depth frames");
  t.add("max_jump", o.max_jump, {0, 10},
        "predict: share of the depth; a pixel that changed more belongs to another "
        "surface");
  t.add("first_period", o.first_period, {0, 3600, "s"},
        "time between the first frames; 0: as the stream reports");
  add_settings(t, o.average);
  add_settings(t, o.memory);
}

/// Role of a surface in a measurement, which says what fields it has beside SurfaceView::field.
/// With other ones nothing is measured: StepStatus::no_surface.
enum class SurfaceRole : std::uint8_t {
  frame,           ///< a frame by itself: no more fields
  with_memory,     ///< of a camera by itself that remembers: in_front
  one_of_several,  ///< joined with others: seen_free, with MemoryOptions in_front and remembered
  key_frame,       ///< seen earlier, from an earlier pose of the camera: remembered
};

/// The surface of one frame: input of queries; non-owning, trivially copyable.
struct SurfaceView {
  PointCloudView cloud = {};
  DepthFieldView field = {};  ///< no levels if there is none
  SurfaceRole role = SurfaceRole::frame;
  /// Field with UnknownSpace::blocked, positive only in space that the camera has seen to be free.
  DepthFieldView seen_free = {};
  /// with_memory: `field` is the background, which may be remembered, and this one the foreground,
  /// with its thickness. A sphere takes the deeper one.
  ///
  /// one_of_several: `field` and `seen_free` are the newest frame alone, and this one is its
  /// surfaces, with their thickness: inside them nothing remembered counts.
  DepthFieldView in_front = {};
  /// Like seen_free, for the last view of now occluded space. It counts only where no camera sees
  /// anything now.
  DepthFieldView remembered = {};
  Pose X_WC = {};  ///< pose of the camera in the world at the capture of the frame
};

/// Optical flow of the newest frame of a camera: motion of the visible surfaces along themselves.
/// Non-owning, in host memory.
struct FlowView {
  const float* pixels = nullptr;  ///< u, v in pixels/s, see DepthFrame::flow; null: unknown
  int width = 0, height = 0;
  Intrinsics intrinsics;  ///< of the whole image, not of a binned one
  double interval = 0;    ///< s, from the frame before to this one
};

/// A blend of two surfaces: the measure is (1 - progress) times that of `from` plus progress times
/// that of `to` (contact/contact.h). So everything that appears or disappears fades in or out, a
/// pixel as well as a wall.
struct SurfaceBlend {
  SurfaceView from, to;
  double progress = 1;
  FlowView flow = {};
};

/// Maximum number of cameras in one measurement. Each has its own blend, and may have its own rate
/// and size.
inline constexpr int kMaxCameras = 16;

/// The points of the newest surfaces of all cameras in one cloud, in W: input of point methods;
/// ignores occlusion. Clouds in host memory. O(points).
PointCloud joined_clouds(std::span<const SurfaceBlend> cameras);

/// Options of a SurfaceTimeline.
struct TimelineOptions {
  SurfaceOptions surface = {};
  /// Each frame gets a depth field. None: clouds alone, for point methods.
  std::optional<DepthFieldOptions> field = DepthFieldOptions{};
  TimeOptions time = {};
  /// Computes depth-change vectors of each frame, for point methods with `Edges`; otherwise
  /// `newest_cloud` alone does.
  bool wants_depth_change = false;
  /// Number of further surfaces in memory: views of `at` stay valid for as many more pushes, so
  /// that one thread can read them while another one pushes.
  int num_spare = 0;
  int binning = 1;  ///< above 1: smaller images, see bin_depth
};

/// Turns a stream of frames into blends of surfaces. All memory is allocated at construction.
class SurfaceTimeline {
 public:
  /// Allocates all memory. Errors: see SurfaceEstimator, DepthField and DepthAverager; max_jump or
  /// first_period negative; prediction or averages with a moving camera; memory with prediction or
  /// without a field; the place is not in this build or on this machine, or has too little memory.
  static Result<SurfaceTimeline> create(const DepthStreamInfo& stream,
                                        const TimelineOptions& options = {},
                                        const Place& place = Place::cpu());
  SurfaceTimeline(SurfaceTimeline&&) noexcept;
  SurfaceTimeline& operator=(SurfaceTimeline&&) noexcept;
  ~SurfaceTimeline();

  /// The stream of the processed images: the input, or binned. Windows refer to it.
  const DepthStreamInfo& stream() const;

  /// Adds the frame that became current at `time` (s, increasing). A field is computed for queries
  /// inside `requested` (see SurfaceView::field), and there is no cloud unless `requested` is the
  /// whole image; a GPU always computes the whole image. No allocation. Same bits for any number of
  /// threads, on every backend and for any window. Waits for the GPU.
  SurfaceStats push(const DepthImageView& frame, double time, ThreadPool& pool,
                    const PixelWindow& requested = {});
  /// The blend at `time` (s), not before the last frame. It waits for late frames (progress 1).
  /// Views stay valid until the next push, or longer with spare surfaces. O(1).
  SurfaceBlend at(double time) const;
  /// With memory of a moving camera: its key frames, as additional views for queries
  /// (ContactQuery::measure), each from its state before the last frame to its state now. They have
  /// the progress of `at`, and the same lifetime.
  std::span<const SurfaceBlend> key_frames() const;

  /// A copy in host memory of the newest frame's points, not predicted, with depth-change vectors
  /// if computed on the CPU; before the first push, without points. Computes what `push` omitted;
  /// queries with `field` may run concurrently.
  PointCloud newest_cloud(ThreadPool& pool);
  /// Expected time to the next frame, s: the first one's, then a running mean.
  double period() const;
  /// An error once the GPU has failed: then surfaces stay as they were.
  const Status& status() const;

 private:
  friend class FrameSlots;  // of this module: makes timelines
  struct Impl;
  explicit SurfaceTimeline(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Surfaces for batches (contact/contact.h), non-owning: views in host memory, whose arrays may be
/// anywhere, or depth fields of one camera model at equal distances in memory, from
/// Sensor::update_batch.
class SurfaceBatch {
 public:
  SurfaceBatch() = default;
  /// `one` must outlive it; the same holds for `views`.
  SurfaceBatch(const SurfaceView& one) : SurfaceBatch(std::span(&one, 1)) {}
  SurfaceBatch(std::span<const SurfaceView> views)
      : views_(views.data()), size_(static_cast<int>(views.size())) {}
  SurfaceBatch(const std::vector<SurfaceView>& views) : SurfaceBatch(std::span(views)) {}
  /// `num` fields without clouds. Distances between two fields: in pixels for planes, silhouettes
  /// and near_silhouette, and in tiles. `noises`: of each field, in the memory of its GPU; null:
  /// that of the first, of all.
  SurfaceBatch(const DepthFieldView& first, int num, std::ptrdiff_t pixels_apart,
               std::ptrdiff_t tiles_apart, const FrameNoise* noises = nullptr)
      : size_(num), pixels_apart_(pixels_apart), tiles_apart_(tiles_apart), noises_(noises) {
    first_.field = first;
  }

  /// Number of surfaces.
  int size() const { return size_; }
  /// True for fields at equal distances in memory.
  bool is_even() const { return views_ == nullptr && size_ > 0; }
  std::ptrdiff_t pixels_apart() const { return pixels_apart_; }
  std::ptrdiff_t tiles_apart() const { return tiles_apart_; }
  const FrameNoise* noises() const { return noises_; }

  SurfaceView operator[](int number) const {
    if (views_ != nullptr) return views_[number];
    SurfaceView surface = first_;
    const std::ptrdiff_t pixels = number * pixels_apart_;
    for (int k = 0; k < surface.field.num_levels; ++k) {
      DepthFieldLevel& level = surface.field.levels[k];
      level.planes += 2 * pixels;
      level.silhouettes += 2 * pixels;
      level.near_silhouette += pixels;
    }
    surface.field.tiles += number * tiles_apart_;
    return surface;
  }

 private:
  const SurfaceView* views_ = nullptr;
  SurfaceView first_;
  int size_ = 0;
  std::ptrdiff_t pixels_apart_ = 0, tiles_apart_ = 0;
  const FrameNoise* noises_ = nullptr;
};

/// A depth camera. Frame C: x right, y down, z forward; W = C unless images have an X_WC.
struct Camera {
  int width = 0, height = 0;  ///< pixels
  Intrinsics intrinsics;
  Distortion distortion = {};  ///< lens distortion: images are undistorted, on any backend
};

/// Options of a Sensor.
struct SensorOptions {
  SurfaceOptions surface = {};
  DepthFieldOptions field = {};
  int num_surfaces = 1;             ///< number of newest surfaces that stay valid
  int num_threads = 0;              ///< on a CPU; 0: one per core
  bool wants_depth_change = false;  ///< computes depth-change vectors, for methods with `Edges`
};

/// Computes a surface for each image: a cloud with normals for point methods, and a depth field for
/// FieldMethod. Images are independent; for blends of two, see ContactQuery::measure and
/// SurfaceTimeline. One thread at a time.
class Sensor {
 public:
  /// Allocates all memory. Errors: see SurfaceEstimator and DepthField; fewer than one surface or
  /// more than 64; the place is not in this build or on this machine, or has too little memory.
  static Result<Sensor> create(const Camera& camera, const Place& place = Place::cpu(),
                               const SensorOptions& options = {});
  Sensor(Sensor&&) noexcept;
  Sensor& operator=(Sensor&&) noexcept;
  ~Sensor();

  /// The surface of an image, valid for the next num_surfaces - 1 updates; on a GPU its
  /// arrays are in GPU memory. An invalid image (see status) gives an empty surface:
  /// measurements against it set StepStatus::no_surface. O(pixels): about 5 ms of one core or
  /// 0.2 ms of a GPU for 640 x 480. No allocation. Same bits for any number of threads, on
  /// every backend.
  SurfaceView update(const DepthImageView& image);

  /// The fields of `num` images of this camera model, consecutive in memory, starting at `first`;
  /// without clouds, valid until the next batch. On a CPU one thread computes each image. On a GPU
  /// a few launches compute all; with images in GPU memory and a stream, the call only enqueues
  /// the work, and after a call with as many images a CUDA graph may capture it. Allocates when
  /// there are more images than before: about 95 bytes per pixel of a large image, 190 per pixel
  /// of 64 x 64. Values equal those of `update`, to the bit. An invalid batch (see status) is
  /// empty.
  SurfaceBatch update_batch(const DepthImageView& first, int num,
                            std::optional<CallerStream> stream = {});
  /// Allocates for the first batch beforehand. Error: too little memory; it says what fits.
  Status reserve_batch(int num_images);

  /// An error if the last image or batch was rejected: wrong size, no values, memory of another
  /// place; or if the GPU has failed, which is permanent.
  const Status& status() const;
  const Place& place() const;

 private:
  struct Impl;
  explicit Sensor(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}}  // namespace palpate::v0
