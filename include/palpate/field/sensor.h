// From depth frames to surfaces: one after the other in time, many at once, or by a Sensor.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/cloud/surface_estimator.h"
#include "palpate/field/depth_field.h"
#include "palpate/gpu/devices.h"

namespace palpate::inline v0 {

// What lies between depth frames. Frames come at 30 Hz and the hand feels at 1 kHz: whoever
// switches to a new frame when it arrives makes a step in the force, thirty times a second.

enum class TimeMode {
  latest,       ///< the newest frame at once: no lag, but steps
  interpolate,  ///< from the last frame to the newest one: no steps, but one frame of lag
  /// Towards where the newest frame's surface will be when the next one comes, each pixel moving as
  /// it did between the last two frames. What was predicted wrongly is corrected on the way.
  predict,
};
constexpr auto names_of(TimeMode) { return std::array{"latest", "interpolate", "predict"}; }

struct TimeOptions {
  TimeMode mode = TimeMode::interpolate;
  DepthAverageOptions average;
  MemoryOptions memory;
  /// predict: a pixel whose depth changed by more than this share shows another surface and is not
  /// moved.
  double max_jump = 0.03;
  /// Expected time between the first frames, s; 0: as the stream says.
  double first_period = 0;
};
inline void add_settings(SettingTable& t, TimeOptions& o) {
  t.section("time");
  t.add("mode", o.mode, "what is felt until the next depth frame comes");
  t.add("max_jump", o.max_jump, {0, 10},
        "predict: share of the depth; a pixel that changed more shows another surface");
  t.add("first_period", o.first_period, {0, 3600, "s"},
        "between the first frames; 0: as the stream says");
  add_settings(t, o.average);
  add_settings(t, o.memory);
}

/// What queries look at; not owning, trivially copyable.
struct SurfaceView {
  PointCloudView cloud;
  DepthFieldView field;  ///< no levels if there is none
  /// The frame with UnknownSpace::blocked, positive only in space that the camera has seen to be
  /// free; with DepthFieldOptions::one_of_several.
  DepthFieldView seen_free = {};
  /// With MemoryOptions, of a camera by itself: `field` shows what is behind, which may be
  /// remembered, and this one what has come before it, with its thickness. A sphere is as deep as
  /// the one says that has it deeper.
  ///
  /// And of one of several cameras: `field` and `seen_free` show the newest frame alone, and this
  /// one the surfaces in it, with their thickness: there nothing counts that is only remembered.
  DepthFieldView in_front = {};
  /// With MemoryOptions, of one of several cameras: as seen_free, of what the camera has seen last
  /// behind what hides it now. It counts where no camera sees anything now. A surface with this and
  /// `field` alone is one that was seen long ago, from where the camera was then.
  DepthFieldView remembered = {};
  Pose X_WC = {};  ///< of the camera in the world, when the frame was captured
};

/// A moment between two surfaces: the measure is (1 - progress) times that of `from` and progress
/// times that of `to` (contact/contact.h). So whatever appears or vanishes fades in or out,
/// be it a pixel or a wall.
struct SurfaceBlend {
  SurfaceView from, to;
  double progress = 1;
};

/// So many cameras can be measured against at once. Each has its own moments: they need neither one
/// rate nor one size.
inline constexpr int kMostCameras = 16;

/// The points of the newest surfaces of all cameras, in W, in one cloud: what methods of points
/// measure several cameras by, whatever lies in front of whom. Clouds in host memory; O(points).
PointCloud joined_clouds(std::span<const SurfaceBlend> cameras);

class FrameSlots;  // how the surfaces of frames are made, see src/field/frame_slots.h
struct SlotSettings;

/// Frames in, moments out. All memory is allocated at construction.
class SurfaceTimeline {
 public:
  /// With `field` each frame gets a depth field. Depth-change vectors only if they are wanted, or
  /// with `newest_cloud`. Errors: see SurfaceEstimator, DepthField and
  /// DepthAverager; max_jump or first_period negative; prediction or averages with a camera that
  /// moves; a memory with prediction or without a field; the place is not in this build
  /// or on this machine, or has too little memory. With `num_spare` more surfaces in memory the
  /// views of `at` outlive so many pushes more: a thread can look at them while another one pushes.
  /// With `binning` above 1 surfaces are those of smaller images, see depth_binning.h.
  static Result<SurfaceTimeline> create(const DepthStreamInfo& stream,
                                        const SurfaceOptions& surface,
                                        const std::optional<DepthFieldOptions>& field,
                                        const TimeOptions& options, const Place& place = {},
                                        int num_spare = 0, bool wants_depth_change = true,
                                        int binning = 1);
  SurfaceTimeline(SurfaceTimeline&&) noexcept;
  SurfaceTimeline& operator=(SurfaceTimeline&&) noexcept;
  ~SurfaceTimeline();

  /// Of the images that surfaces are made of: the frames', or smaller ones. Windows are in theirs.
  const DepthStreamInfo& stream() const;

  /// Takes the frame that became current at `time` (s, later than the one before). With a field it
  /// is made for queries inside of `asked`, which SurfaceView::field says, and there is no cloud
  /// unless that is the whole image; a GPU always makes the whole one. No allocation; the same bits
  /// for any number of threads, at every place and for any window. Waits for the GPU.
  SurfaceStats push(const DepthImageView& frame, double time, ThreadPool& pool,
                    const PixelWindow& asked = {});
  /// Before the first frame: its averages go on from DepthAverager::state. Error: they have none,
  /// or it is not one of such images.
  Status go_on_from(std::string_view state);
  /// What the hand feels at `time`, which does not lie before the last frame. Late frames are
  /// waited for. The views stay valid until the next push, or longer with spare surfaces. O(1).
  SurfaceBlend at(double time) const;
  /// With a memory of a camera that moves: what it remembers, as further views for queries
  /// (ContactQuery::measure), each from what it was before the last frame to what it is now. They
  /// are at the progress of `at`, and valid as long.
  std::span<const SurfaceBlend> key_frames() const;

  /// A copy in host memory of the newest frame's points as they were seen, not predicted, with
  /// depth-change vectors if they are found on the CPU; before the first push, without any points.
  /// Makes what `push` did without; queries by field may go on meanwhile.
  PointCloud newest_cloud(ThreadPool& pool);
  /// Expected time to the next frame, s: the first one's, then a running mean.
  double period() const;
  /// An error once the GPU has failed: then surfaces stay as they were.
  const Status& status() const;

 private:
  friend Result<SurfaceTimeline> make_timeline(std::unique_ptr<FrameSlots> slots,
                                               const SlotSettings& settings);
  struct Impl;
  explicit SurfaceTimeline(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Surfaces that poses are measured against (contact/contact.h), not owning: views in host
/// memory, which may show arrays anywhere, or depth fields of one camera model whose arrays lie at
/// equal distances in memory, as Sensor::update_batch makes them.
class SurfaceBatch {
 public:
  SurfaceBatch() = default;
  /// `one` must outlive it; so must views.
  SurfaceBatch(const SurfaceView& one) : SurfaceBatch(std::span(&one, 1)) {}
  SurfaceBatch(std::span<const SurfaceView> views)
      : views_(views.data()), size_(static_cast<int>(views.size())) {}
  SurfaceBatch(const std::vector<SurfaceView>& views) : SurfaceBatch(std::span(views)) {}
  /// `num` fields without clouds. Distances from one to the next: in pixels of planes, silhouettes
  /// and near_silhouette, and in tiles.
  SurfaceBatch(const DepthFieldView& first, int num, std::ptrdiff_t pixels_apart,
               std::ptrdiff_t tiles_apart)
      : size_(num), pixels_apart_(pixels_apart), tiles_apart_(tiles_apart) {
    first_.field = first;
  }

  int size() const { return size_; }
  bool is_even() const { return views_ == nullptr && size_ > 0; }
  std::ptrdiff_t pixels_apart() const { return pixels_apart_; }
  std::ptrdiff_t tiles_apart() const { return tiles_apart_; }

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
};

/// A depth camera. World W is its frame C: x right, y down, z forward.
struct Camera {
  int width = 0, height = 0;  ///< pixels
  Intrinsics intrinsics;
  Distortion distortion = {};  ///< of its lens: images are straightened, at any place
};

struct SensorOptions {
  SurfaceOptions surface;
  DepthFieldOptions field;
  int num_surfaces = 1;  ///< so many of the newest ones stay valid
  int num_threads = 0;   ///< on a CPU; 0: one per core
};

/// Makes a surface of each image: a cloud with normals for the methods of points, and a depth field
/// for FieldMethod. Images are looked at one by one; for what lies between two of them see
/// ContactQuery::measure and SurfaceTimeline. One thread at a time.
class Sensor {
 public:
  /// Allocates all memory. Errors: see SurfaceEstimator and DepthField; fewer than one surface or
  /// more than 64; the place is not in this build or on this machine, or has too little memory.
  static Result<Sensor> create(const Camera& camera, const Place& place = Place::cpu(),
                               const SensorOptions& options = {});
  Sensor(Sensor&&) noexcept;
  Sensor& operator=(Sensor&&) noexcept;
  ~Sensor();

  /// The surface of an image, valid for the next num_surfaces - 1 updates; on a GPU its arrays are
  /// there. An image that cannot be taken (see status) gives a surface that is none: whoever is
  /// measured against it gets StepStatus::no_surface. O(pixels): about 5 ms of one core or 0.2 ms
  /// of a GPU for 640 x 480. No allocation; the same bits for any number of threads, at every
  /// place.
  SurfaceView update(const DepthImageView& image);

  /// The fields of `num` images of this camera's model, one after the other in memory, of which
  /// `first` shows the first; without clouds, valid until the next batch. On a CPU each image is
  /// made by one thread. On a GPU a few launches make all; if the images are there and a stream is
  /// given, the call only asks for the work, and after one with as many images it may be captured
  /// in a CUDA graph. Takes memory when it meets more images than before: about 95 bytes for each
  /// pixel of a large image, 190 for each of 64 x 64. The values are those of `update`, to the bit.
  /// A batch that cannot be taken (see status) is empty.
  SurfaceBatch update_batch(const DepthImageView& first, int num,
                            std::optional<CallerStream> stream = {});
  /// So that the first batch need not. Errors: there is too little memory; it says what fits.
  Status reserve_batch(int num_images);

  /// An error if the last image or batch was not taken: another size than the camera's, no values,
  /// in the memory of another place; or the GPU has failed, which lasts.
  const Status& status() const;
  const Place& place() const;

 private:
  struct Impl;
  explicit Sensor(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate::inline v0
