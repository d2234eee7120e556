#include "src/contact/hull/depth_hull.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "src/contact/blend.h"
#include "src/contact/hull/camera_seats.h"
#include "src/core/internal/select_isa.h"

namespace palpate { inline namespace v0 {
PALPATE_DECLARE_KERNELS(void measure_hull_group(const HullJob&, int group, bool with_stiffness,
                                                GroupSums* sums);
                        void describe_hull_group(const HullJob&, int group, const SphereCuts& to);
                        constexpr DepthHullKernels kDepthHull{measure_hull_group,
                                                              describe_hull_group};)

namespace {

constexpr DepthHullKernels kKernels[] = PALPATE_BY_ISA(kDepthHull);

/// True if the camera has measured all pixels of elements at most `reach` from p_C, also the widest
/// ones, which deep elements sample. There its two fields are equal, if all is solid behind
/// surfaces.
bool has_measured_around(const MeasureJob& seen_free, const Vec3d& p_C, double reach) {
  constexpr int kReach = 6;  // pixels around one that a sphere is seen in, of the widest level
  const DepthFieldView& field = seen_free.fields[0];
  const int width = field.levels[0].width, height = field.levels[0].height;
  if (!(p_C.z - reach > static_cast<double>(kMinDepth))) return false;
  const PixelWindow window = needed_window(field.intrinsics, width, height, p_C, reach)
                                 .grown(kReach << (field.num_levels - 1));
  if (window.left < 0 || window.top < 0 || window.right > width || window.bottom > height) {
    return false;
  }
  constexpr int kTile = DepthFieldView::kTileSize;
  for (int v = window.top / kTile; v <= (window.bottom - 1) / kTile; ++v) {
    for (int u = window.left / kTile; u <= (window.right - 1) / kTile; ++u) {
      for (int f = 0; f < seen_free.num_fields; ++f) {
        const DepthTile& tile = seen_free.fields[f].tiles[v * field.tiles_wide + u];
        if (!(tile.nearest > kMinDepth)) return false;
      }
    }
  }
  return true;
}

/// Returns the upper bound of a camera's field, with all unmeasured space blocked, for a ball so
/// far out of its image that none of its levels has a silhouette there. Infinity: it is not.
float out_of_image(const DepthFieldView& field, const Vec3d& p_C, double reach) {
  constexpr double kMargin = 1e-3;  // m, for what rounding does
  if (p_C.z + reach < 0) return static_cast<float>(p_C.z + reach + kMargin);
  const double z = p_C.z - reach;
  if (!(z > static_cast<double>(kMinDepth))) return std::numeric_limits<float>::infinity();
  const double border =
      (1 - static_cast<double>(DepthFieldLevel::kFirst)) * (1 << (field.num_levels - 1));  // pixels
  const auto is_beyond = [&](double x, double focal, double center, int size) {
    // Planes through the eye and the borders, far out.
    const double low = (-border - center) / focal, high = (size + border - center) / focal;
    return x - low * p_C.z < -reach * std::hypot(1, low) ||
           x - high * p_C.z > reach * std::hypot(1, high);
  };
  const auto& [fx, fy, cx, cy] = field.intrinsics;
  if (!is_beyond(p_C.x, fx, cx, field.levels[0].width) &&
      !is_beyond(p_C.y, fy, cy, field.levels[0].height)) {
    return std::numeric_limits<float>::infinity();
  }
  // Unmeasured space is blocked from there on.
  return static_cast<float>(kMinDepth - z + kMargin);
}

/// True if a field in host memory has no surface beyond its image.
bool is_free_beyond(const DepthFieldView& field) {
  const DepthFieldLevel& level = field.levels[0];
  const int at = static_cast<int>(DepthFieldLevel::kFirst);
  return level.planes[2 * (at * level.stride + at) + 1] == 0;
}

}  // namespace

DepthHull::DepthHull(const FieldElements& elements, const Vec3d& p_TC, Isa isa)
    : elements_(&elements),
      p_TC_(p_TC),
      kernels_(select_isa(kKernels, isa)),
      group_sums_(static_cast<std::size_t>(elements.clusters.num_groups())) {}

// Adds the cameras that show something to the job.
ContactStatus DepthHull::take(std::span<const SurfaceBlend> cameras, const Pose& X_WT) {
  HullJob& job = *job_;
  job.tool = measure_job(*elements_);
  job.tool.frame = frame_of({}, X_WT, p_TC_);
  job.num_cameras = 0;
  job.is_alone = is_alone(cameras);
  job.has_memory = false;
  job.may_be_unseen = !job.is_alone;
  for (const bool sees : {true, false}) {
    for (std::size_t k = 0; k < cameras.size(); ++k) {
      const SurfaceView& surface = cameras[k].to;
      if (surface.field.num_levels == 0) continue;  // no frame yet: it abstains
      if (is_seen(surface, job.is_alone) != sees) continue;
      const ContactStatus status = take(cameras[k], X_WT, static_cast<int>(k));
      if (status.is_unmeasured()) return status;
    }
    if (sees) job.num_seeing = job.num_cameras;
  }
  return job.num_seeing > 0 ? StepStatus::ok : StepStatus::no_surface;
}

ContactStatus DepthHull::take(const SurfaceBlend& view, const Pose& X_WT, int number) {
  HullJob& job = *job_;
  const SurfaceView &from = view.from, &to = view.to;
  const double progress = view.progress;
  if (!has_fields(to, job.is_alone)) return StepStatus::no_surface;
  const CameraSeats seats(view, X_WT, job.is_alone);
  if (seats.is_outside_window(view, p_TC_, elements_->reach)) return StepStatus::outside_window;
  HullCamera& camera = job.cameras[job.num_cameras++];
  camera.number = number;
  camera.is_remembered = !job.is_alone && is_remembered(to);
  camera.has_in_front = job.is_alone && has_in_front(to);
  job.has_memory |= camera.is_remembered;
  MeasureJob tool = measure_job(*elements_);
  tool.num_fields = seats.num_moments;
  tool.frame = frame_of(to.field.intrinsics, seats.X_CT[0], p_TC_);
  const auto show = [&](MeasureJob& fields, DepthFieldView SurfaceView::*field) {
    fields = tool;
    fields.fields[0] = to.*field;
    fields.fields[1] = from.*field;
  };
  const bool sees = is_seen(to, job.is_alone);
  show(camera.field, &SurfaceView::field);
  show(camera.seen_free, job.is_alone ? &SurfaceView::field
                         : sees       ? &SurfaceView::seen_free
                                      : &SurfaceView::remembered);
  // A surface without thickness is solid as far as its camera sees.
  show(camera.in_front, has_in_front(to) ? &SurfaceView::in_front : &SurfaceView::field);
  show(camera.remembered, is_remembered(to) ? &SurfaceView::remembered : &SurfaceView::field);
  camera.progress = static_cast<float>(progress);
  camera.has_moved = seats.has_moved;
  camera.older = tool;
  if (seats.has_moved) camera.older.frame = frame_of(to.field.intrinsics, seats.X_CT[1], p_TC_);
  seats.write_rotations(camera.R_WC);
  leave_out(view, seats, camera);
  const bool is_solid_behind = to.field.thickness >= static_cast<float>(kSolidBehind);
  if (job.may_be_unseen && sees && !seats.has_moved && is_solid_behind &&
      has_measured_around(camera.seen_free, seats.X_CT[0] * p_TC_, elements_->reach)) {
    job.may_be_unseen = false;
  }
  return StepStatus::ok;
}

/// Sets the bound by which a camera may be skipped.
void DepthHull::leave_out(const SurfaceBlend& view, const CameraSeats& seats,
                          HullCamera& camera) const {
  camera.at_most = std::numeric_limits<float>::infinity();
  if (job_->is_alone) return;
  float most = -camera.at_most;
  for (int f = 0; f < seats.num_moments; ++f) {
    const DepthFieldView& field = (f == 0 ? view.to : view.from).field;
    most = std::max(most, is_free_beyond(field)
                              ? out_of_image(field, seats.X_CT[f] * p_TC_, elements_->reach)
                              : camera.at_most);
  }
  camera.at_most = most;
}

// Adds the noise of all cameras, which do not know of each other. Both frames of a blend count.
std::optional<MeasureNoise> DepthHull::noise_of_cameras(NoiseMemory& noise) const {
  MeasureNoise sum;
  for (int k = 0; k < job_->num_cameras; ++k) {
    const HullCamera& camera = job_->cameras[k];
    for (int f = 0; f < camera.field.num_fields; ++f) {
      if (camera.field.fields[f].noise == nullptr) return std::nullopt;
    }
    const DepthFieldView& field = camera.field.fields[0];
    const FieldFrame& frame = camera.field.frame;
    NoiseCamera view{.fx = frame.fx, .fy = frame.fy, .cx = frame.cx, .cy = frame.cy};
    std::memcpy(view.R_WC, camera.R_WC[0], sizeof view.R_WC);
    MeasureNoise of_frame;
    noise.add(k, view, field, of_frame);
    const double newer = camera.field.num_fields == 2 ? static_cast<double>(camera.progress) : 1;
    sum.add(of_frame, std::hypot(newer, 1 - newer));
  }
  return sum;
}

ContactResult DepthHull::measure(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                                 const ContactWants& wants, ThreadPool& pool, NoiseMemory& noise) {
  const ContactStatus status = take(cameras, X_WT);
  if (status.is_unmeasured()) {
    ContactResult result = unmeasured(StepStatus::ok, wants, true);
    result.penetration.status = status;
    return result;
  }
  const int num_groups = elements_->clusters.num_groups();
  if (wants.noise) job_->tool.noise = noise.rows();
  pool.parallel_for(num_groups, [&](int group) {
    kernels_.measure_group(*job_, group, wants.stiffness,
                           &group_sums_[static_cast<std::size_t>(group)]);
  });
  GroupSums sums;
  for (const GroupSums& group : group_sums_) {
    sums.measure.add(group.measure);
    if (wants.stiffness) sums.stiffness.add(group.stiffness);
  }
  ContactResult result{sums.measure.penetration(), {}, {}};
  if (wants.stiffness) {
    result.stiffness = sums.stiffness.stiffness();
    result.moments = sums.stiffness.moments();
  }
  keep_bounds(result);
  if (wants.noise) result.noise = noise_of_cameras(noise);
  if (!wants.has_spheres()) return result;
  std::fill(wants.states.begin(), wants.states.end(), SphereState::outside);
  std::fill(wants.planes.begin(), wants.planes.end(), Plane<float>{});
  std::fill(wants.deciders.begin(), wants.deciders.end(), kNoCamera);
  std::fill(wants.unseen.begin(), wants.unseen.end(), 0);
  const SphereCuts cuts = cuts_of(wants, p_TC_);
  pool.parallel_for(num_groups, [&](int group) { kernels_.describe_group(*job_, group, cuts); });
  return result;
}

}}  // namespace palpate::v0
