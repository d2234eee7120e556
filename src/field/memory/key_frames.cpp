#include "src/field/internal/key_frames.h"

#include <algorithm>
#include <array>
#include <utility>

#include "src/cloud/internal/lens_table.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kWidestImage = 320;  // pixels, of a grid
constexpr int kGridStride = 2;     // of these, between compared points
/// Share of newly seen space from which on a frame is kept.
constexpr double kWorthKeeping = 0.05;
/// Shares of a ray's depth at which the other key frames are queried.
constexpr double kAlongRay[] = {0.4, 0.7, 1.0};
/// Largest number of surfaces made at a frame: the others wait for the next ones.
constexpr int kMaxMadePerFrame = 3;
/// Number of samples of the thickness of a new surface.
constexpr int kNumInside = 8;
/// Smallest number of points of nine that agree: fewer are noise, or an edge where frames differ.
constexpr int kMinMarked = 7;

/// Keeps the least depth that was seen; 0: none.
void see(float& least, float depth) { least = least > 0 ? std::min(least, depth) : depth; }

bool knows(const DepthGrid& grid, const Vec3d& p_C, double tolerance) {
  const int i = grid.index_of(p_C);
  return i >= 0 &&
         p_C.z <= static_cast<double>(grid.depth[static_cast<std::size_t>(i)]) * (1 + tolerance);
}

}  // namespace

FrameEvidence::FrameEvidence(int num_points, const MemoryOptions& options)
    : tolerance_(static_cast<float>(2 * options.step)), thickness_(options.thickness) {
  const auto num = static_cast<std::size_t>(num_points);
  for (auto* depths : {&near_, &beyond_, &inside_}) depths->resize(num);
  for (auto* marks : {&come_, &gone_}) marks->resize(num);
  is_through_.resize(num);
}

void FrameEvidence::look(const DepthGrid& kept, const DepthGrid& now) {
  for (auto* depths : {&near_, &beyond_, &inside_}) std::fill(depths->begin(), depths->end(), 0.0f);
  // Depths of the current frame along the rays of the kept one.
  const Pose X_KN = inverse(kept.X_WC) * now.X_WC, X_NK = inverse(X_KN);
  for (int j = 0; j < now.width * now.height; ++j) {
    if (!(now.depth[static_cast<std::size_t>(j)] > 0)) continue;
    const Vec3d p_K = X_KN * now.point(j);
    const int i = kept.index_of(p_K);
    if (i < 0) continue;
    const auto at = static_cast<std::size_t>(i);
    const float shown = kept.depth[at], z = static_cast<float>(p_K.z);
    if (!(shown > 0)) continue;
    if (z < shown * (1 - tolerance_)) see(near_[at], z);
    if (z > shown * (1 + tolerance_)) see(beyond_[at], z);
  }
  // And the reverse: points of the kept frame through which the current one sees.
  for (int i = 0; i < kept.width * kept.height; ++i) {
    const auto at = static_cast<std::size_t>(i);
    is_through_[at] = kept.depth[at] > 0 && sight(now, X_NK * kept.point(i)) == Sight::through;
  }
  mark(
      kept, [&](std::size_t i) { return near_[i] > 0; }, come_);
  mark(
      kept, [&](std::size_t i) { return is_through_[i] != 0; }, gone_);
  thicken(kept, now);
}

/// Marks points where `says` holds and for enough neighbors too, then those beside such points.
template <class Says>
void FrameEvidence::mark(const DepthGrid& kept, const Says& says, std::vector<Mark>& marks) {
  std::fill(marks.begin(), marks.end(), Mark::none);
  const auto mark_all = [&](Mark mark, int fewest, const auto& speaks) {
    for (int v = 1; v + 1 < kept.height; ++v) {
      for (int u = 1; u + 1 < kept.width; ++u) {
        const int i = v * kept.width + u;
        const auto at = static_cast<std::size_t>(i);
        if (!says(at) || marks[at] != Mark::none) continue;
        int num = 0;
        for (int dv = -kept.width; dv <= kept.width; dv += kept.width) {
          for (int du = -1; du <= 1; ++du) num += speaks(static_cast<std::size_t>(i + dv + du));
        }
        if (num >= fewest) marks[at] = mark;
      }
    }
  };
  mark_all(Mark::several, kMinMarked, says);
  mark_all(Mark::beside, 1, [&](std::size_t i) { return marks[i] == Mark::several; });
}

/// Extends the new surfaces behind the points where they are seen, by the thickness.
void FrameEvidence::thicken(const DepthGrid& kept, const DepthGrid& now) {
  const auto has_come = [](Mark mark) { return mark != Mark::none; };
  if (std::none_of(come_.begin(), come_.end(), has_come)) return;
  const Pose X_KN = inverse(kept.X_WC) * now.X_WC;
  for (int j = 0; j < now.width * now.height; ++j) {
    if (!(now.depth[static_cast<std::size_t>(j)] > 0)) continue;
    const Vec3d p_N = now.point(j), p_K = X_KN * p_N;
    const int front = kept.index_of(p_K);
    if (front < 0 || come_[static_cast<std::size_t>(front)] == Mark::none) continue;
    if (p_K.z > near_[static_cast<std::size_t>(front)] * (1 + tolerance_)) continue;
    for (int k = 1; k <= kNumInside; ++k) {
      const Vec3d inside = X_KN * ((1 + thickness_ * k / (kNumInside * norm(p_N))) * p_N);
      const int i = kept.index_of(inside);
      if (i < 0) continue;
      const auto at = static_cast<std::size_t>(i);
      const auto z = static_cast<float>(inside.z);
      if (z < kept.depth[at] * (1 - tolerance_)) see(inside_[at], z);
    }
  }
}

float FrameEvidence::come(int i) const {
  const auto at = static_cast<std::size_t>(i);
  if (come_[at] == Mark::none && inside_[at] == 0) return 0;
  float least = near_[at];
  if (inside_[at] > 0) see(least, inside_[at]);
  return least;
}

std::optional<float> FrameEvidence::gone(int i) const {
  const auto at = static_cast<std::size_t>(i);
  if (gone_[at] == Mark::none) return {};
  return beyond_[at];
}

Sight FrameEvidence::sight(const DepthGrid& now, const Vec3d& p_N) const {
  const int j = now.index_of(p_N);
  if (j < 0) return Sight::outside;
  const double seen = now.depth[static_cast<std::size_t>(j)];
  const double tolerance = tolerance_;
  if (!(seen > 0)) return Sight::unknown;
  return seen > p_N.z * (1 + tolerance)   ? Sight::through
         : seen < p_N.z * (1 - tolerance) ? Sight::hidden
                                          : Sight::seen;
}

KeyFrames::Seat::Seat(std::size_t num_points, const MemoryOptions& options)
    : before(num_points), evidence(static_cast<int>(num_points), options) {}

Result<KeyFrames> KeyFrames::create(const SlotSettings& settings, const MakeSlots& make_slots) {
  const DepthStreamInfo& whole = settings.stream;
  const int binning = std::clamp((whole.width + kWidestImage - 1) / kWidestImage, 1, kMaxBinning);
  SlotSettings kept;
  kept.stream = binned(whole, binning);
  kept.stream.is_moving = false;  // a frame by itself
  kept.learns_noise = false;
  kept.surface = settings.surface;
  kept.field = settings.field;
  kept.field->one_of_several = true;
  kept.time.mode = TimeMode::latest;
  kept.wants_depth_change = false;
  // In use, those that are being made, and those that views of spare surfaces show.
  const int num_slots =
      settings.time.memory.frames + kMaxMadePerFrame * (settings.num_spare + 1) + 1;
  kept.num_spare = num_slots - kept.num_slots();
  auto slots = make_slots(kept);
  if (!slots) return slots.error();
  return KeyFrames(settings, kept.stream, binning, *std::move(slots), num_slots);
}

KeyFrames::KeyFrames(const SlotSettings& settings, const DepthStreamInfo& stream, int binning,
                     std::unique_ptr<FrameSlots> slots, int num_slots)
    : stream_(stream),
      binning_(binning),
      step_(settings.time.memory.step),
      slots_(std::move(slots)),
      last_shown_(static_cast<std::size_t>(num_slots), -1) {
  const CameraModel model{stream.width, stream.height, stream.intrinsics, {}};
  std::vector<std::uint32_t> table;
  if (stream.distortion != Distortion{}) {
    table = lens_table(model, {stream.width, stream.height, stream.intrinsics, stream.distortion});
  }
  now_.width = stream.width / kGridStride;
  now_.height = stream.height / kGridStride;
  const auto [fx, fy, cx, cy] = stream.intrinsics;
  now_.intrinsics = {fx / kGridStride, fy / kGridStride, cx / kGridStride, cy / kGridStride};
  const auto num = static_cast<std::size_t>(now_.width) * static_cast<std::size_t>(now_.height);
  now_.depth.resize(num);
  for (int v = 0; v < now_.height * kGridStride; ++v) {
    for (int u = 0; u < now_.width * kGridStride; ++u) {
      const auto pixel = static_cast<std::uint32_t>(v * stream.width + u);
      pixels_.push_back(table.empty() ? pixel : table[pixel]);
    }
  }
  small_.pixels.resize(static_cast<std::size_t>(stream.width) *
                       static_cast<std::size_t>(stream.height));
  const auto num_seats = static_cast<std::size_t>(settings.time.memory.frames);
  views_.resize(num_seats);
  for (std::size_t k = 0; k < num_seats; ++k) {
    seats_.emplace_back(num, settings.time.memory);
    seats_.back().image = small_;
    seats_.back().grid = now_;
  }
}

void KeyFrames::sample(const DepthFrame& image, DepthGrid& grid) const {
  const auto row = static_cast<std::size_t>(grid.width * kGridStride);
  grid.X_WC = image.X_WC;
  for (std::size_t i = 0; i < grid.depth.size(); ++i) {
    const auto width = static_cast<std::size_t>(grid.width);
    const std::uint32_t pixel = pixels_[i / width * kGridStride * row + i % width * kGridStride];
    // A binned image has 0 where nothing was measured.
    const std::uint16_t count = pixel < image.pixels.size() ? image.pixels[pixel] : 0;
    grid.depth[i] = static_cast<float>(count * image.unit);
  }
}

/// Changes a point of a frame, and the pixels that it stands for.
void KeyFrames::change(Seat& seat, int i, float depth) const {
  DepthGrid& grid = seat.grid;
  grid.depth[static_cast<std::size_t>(i)] = depth;
  const double counts = static_cast<double>(depth) / seat.image.unit;
  const auto row = static_cast<std::size_t>(grid.width * kGridStride);
  for (int y = 0; y < kGridStride; ++y) {
    for (int x = 0; x < kGridStride; ++x) {
      const auto at = static_cast<std::size_t>(i / grid.width * kGridStride + y) * row +
                      static_cast<std::size_t>(i % grid.width * kGridStride + x);
      const std::uint32_t pixel = pixels_[at];
      if (pixel >= seat.image.pixels.size()) continue;
      seat.image.pixels[pixel] =
          static_cast<std::uint16_t>(std::min(counts + 0.5, double{kFarCount}));
    }
  }
  seat.has_changed = true;
}

/// Removes from a kept frame what the newest frame contradicts.
void KeyFrames::contradict(Seat& seat) const {
  DepthGrid& grid = seat.grid;
  seat.evidence.look(grid, now_);
  const Pose X_NK = inverse(now_.X_WC) * grid.X_WC;
  for (int i = 0; i < grid.width * grid.height; ++i) {
    float& before = seat.before[static_cast<std::size_t>(i)];
    if (const float come = seat.evidence.come(i); come > 0) {
      before = come;
      continue;
    }
    if (before > 0) {
      const Sight sight = seat.evidence.sight(now_, X_NK * grid.point(i, before));
      if (sight == Sight::through) before = 0;
      // It was still there when last seen.
      if (sight == Sight::outside) change(seat, i, std::exchange(before, 0.0f));
    } else if (const std::optional<float> beyond = seat.evidence.gone(i)) {
      change(seat, i, *beyond);
    }
  }
}

/// Share of a frame's seen space that is new: unknown to all kept frames but `but`, and to `also`.
double KeyFrames::share_of_new(const DepthGrid& grid, int stride, const Seat* but,
                               const DepthGrid* also) const {
  struct Other {
    const DepthGrid* grid;
    Pose X_OC;
  };
  std::array<Other, kMaxCameras + 1> others;
  std::size_t num_others = 0;
  const auto look_up = [&](const DepthGrid& other) {
    others[num_others++] = {&other, inverse(other.X_WC) * grid.X_WC};
  };
  if (also != nullptr) look_up(*also);
  for (std::size_t k = 0; k < num_used_; ++k) {
    if (&seats_[k] != but) look_up(seats_[k].grid);
  }
  int num = 0, num_new = 0;
  for (int v = stride / 2; v < grid.height; v += stride) {
    for (int u = stride / 2; u < grid.width; u += stride) {
      const int i = v * grid.width + u;
      if (!(grid.depth[static_cast<std::size_t>(i)] > 0)) continue;
      for (const double along : kAlongRay) {
        const Vec3d p_C = along * grid.point(i);
        ++num;
        num_new += std::none_of(others.begin(), others.begin() + num_others, [&](const Other& o) {
          return knows(*o.grid, o.X_OC * p_C, 2 * step_);
        });
      }
    }
  }
  return num > 0 ? static_cast<double>(num_new) / num : 0;
}

/// Keeps the newest frame if it adds enough: in a free seat, or that of the one that adds least.
KeyFrames::Seat* KeyFrames::keep() {
  if (!(share_of_new(now_, 4, nullptr, nullptr) > kWorthKeeping)) return nullptr;
  Seat* to = nullptr;
  if (num_used_ < seats_.size()) {
    to = &seats_[num_used_++];
  } else {
    double least = 2;
    for (Seat& seat : seats_) {
      const double adds = share_of_new(seat.grid, 8, &seat, &now_);
      if (adds < least) to = &seat;
      least = std::min(least, adds);
    }
  }
  to->image = small_;
  to->grid = now_;
  std::fill(to->before.begin(), to->before.end(), 0.0f);
  return to;
}

/// Returns the slot that no view in use shows: the one shown longest ago.
int KeyFrames::free_slot() const {
  return static_cast<int>(std::min_element(last_shown_.begin(), last_shown_.end()) -
                          last_shown_.begin());
}

void KeyFrames::make(Seat& seat, ThreadPool& pool) {
  seat.slot = free_slot();
  seat.has_changed = false;
  slots_->take(seat.slot, seat.image, {}, {}, 0, pool);
  const SurfaceView& made = slots_->surfaces(seat.slot);
  SurfaceView& shown = views_[static_cast<std::size_t>(&seat - seats_.data())].to;
  shown = {};
  shown.field = made.field;
  shown.role = SurfaceRole::key_frame;
  shown.remembered = made.seen_free;
  shown.X_WC = seat.image.X_WC;
  last_shown_[static_cast<std::size_t>(seat.slot)] = num_frames_;
}

void KeyFrames::take(const DepthImageView& frame, ThreadPool& pool) {
  status_ = Done{};
  if (frame.counts == nullptr || frame.gpu != kHostMemory) {
    status_ = Error{Errc::invalid_argument,
                    "the memory of a moving camera needs 16-bit depth images in host memory; use "
                    "them, or turn the memory off"};
    return;
  }
  if (!is_finite(frame.X_WC)) return;
  bin_depth(frame, binning_, small_);
  small_.X_WC = frame.X_WC;
  sample(small_, now_);
  pool.parallel_for(static_cast<int>(num_used_),
                    [&](int k) { contradict(seats_[static_cast<std::size_t>(k)]); });
  for (std::size_t k = 0; k < num_used_; ++k) {
    views_[k].from = views_[k].to;
    last_shown_[static_cast<std::size_t>(seats_[k].slot)] = num_frames_;
  }
  int num_made = 0;
  if (Seat* const kept = keep()) {
    make(*kept, pool);
    ++num_made;
  }
  for (std::size_t i = 0; i < num_used_ && num_made < kMaxMadePerFrame; ++i) {
    Seat& seat = seats_[(turn_ + i) % num_used_];
    if (!seat.has_changed) continue;
    make(seat, pool);
    if (++num_made == kMaxMadePerFrame) turn_ = (turn_ + i + 1) % num_used_;
  }
  ++num_frames_;
}

}}  // namespace palpate::v0
