#include "src/contact/batch/field_batch.h"

#include <algorithm>
#include <bit>
#include <string>
#include <utility>

#include "src/contact/batch/batch_pose.h"
#include "src/contact/noise/rotate_noise.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kMaxPosesPerTask = 4096, kMinPosesPerTask = 64;
/// Smallest number of poses per surface for which an overview saves more than it costs.
constexpr std::size_t kPosesPerOverview = 32;

}  // namespace

/// The tiles of a field, joined to 8 x 8 blocks at most: enough to see that a tool is far in front
/// of all that is near it in the image.
struct FieldBatch::Overview {
  static constexpr int kBlocks = 8;

  void look_at(const DepthFieldView& field) {
    shift_u = shift_over(field.tiles_wide);
    shift_v = shift_over(field.tiles_high);
    for (DepthTile& block : blocks) block = {1e30f, 1};
    for (int v = 0; v < field.tiles_high; ++v) {
      for (int u = 0; u < field.tiles_wide; ++u) {
        const DepthTile& tile = field.tiles[v * field.tiles_wide + u];
        DepthTile& block = blocks[(v >> shift_v) * kBlocks + (u >> shift_u)];
        block = {std::min(block.nearest, tile.nearest), std::min(block.min_slope, tile.min_slope)};
      }
    }
  }

  /// True if no sphere in the ball touches anything.
  bool is_in_front(const BallWindow& window, float largest_radius) const {
    if (!window.is_before_camera()) return false;
    for (int v = window.top >> shift_v; v <= window.bottom >> shift_v; ++v) {
      for (int u = window.left >> shift_u; u <= window.right >> shift_u; ++u) {
        if (!is_behind(blocks[v * kBlocks + u], window.farthest, largest_radius)) return false;
      }
    }
    return true;
  }

 private:
  static int shift_over(int num_tiles) {
    const auto blocks_desired = static_cast<unsigned>((num_tiles + kBlocks - 1) / kBlocks);
    return static_cast<int>(std::bit_width(blocks_desired - 1));
  }

  int shift_u = 0, shift_v = 0;
  DepthTile blocks[kBlocks * kBlocks];
};

Status check_batch(const SurfaceBatch& surfaces, const PoseBatch& poses) {
  const auto refuse = [](const std::string& message) {
    return Error{Errc::invalid_argument, message};
  };
  const std::size_t num = poses.X_WT.size(), num_numbers = poses.surface_of_pose.size();
  const auto num_surfaces = static_cast<std::size_t>(surfaces.size());
  if (num_numbers == 0 && num > 0 && num_surfaces != 1 && num_surfaces != num) {
    return refuse("a batch of " + std::to_string(num) + " poses was given " +
                  std::to_string(num_surfaces) +
                  " surfaces; say in surface_of_pose which one each is measured against");
  }
  if (num_numbers != 0 && num_numbers != num) {
    return refuse("a batch of " + std::to_string(num) + " poses was given surface_of_pose of " +
                  std::to_string(num_numbers) + "; give one number for each pose");
  }
  if (!poses.X_WC.empty() && poses.X_WC.size() != num_surfaces) {
    return refuse("a batch against " + std::to_string(num_surfaces) + " surfaces was given " +
                  std::to_string(poses.X_WC.size()) +
                  " poses X_WC of cameras; give one for each surface, or none");
  }
  if (!surfaces.is_even()) {  // others are of frames without a memory
    for (int k = 0; k < surfaces.size(); ++k) {
      if (surfaces[k].in_front.num_levels == 0) continue;
      return refuse("surface " + std::to_string(k) +
                    " of a batch is one of a camera with a memory (SurfaceView::in_front), which "
                    "batches do not look at; measure it by ContactQuery::measure, or make it "
                    "without TimeOptions::memory");
    }
  }
  return Done{};
}

/// Measures poses one after the other.
struct FieldBatch::Worker {
  const FieldBatch& query;
  const SurfaceBatch& surfaces;
  const PoseBatch& poses;
  const BatchAnswers& answers;
  bool has_overviews;
  MeasureJob job{};
  int surface = -1;                    // in the job
  bool has_all = true;                 // is its field of the whole image?
  std::optional<NoiseMemory> noise{};  // if somebody asks for it
  GroupSums of_group[2]{};

  void measure(std::size_t first, std::size_t last);
  bool is_in_front(std::size_t pose, std::uint64_t& place);
  bool look_at(int requested);
  int surface_number_of(std::size_t pose) const;
  ContactResult evaluate(std::size_t pose, BatchPose& at);
  void put(std::size_t pose, const BatchPose& at, ContactResult& result) const;
  void put_nothing(std::size_t pose) const;
};

int FieldBatch::Worker::surface_number_of(std::size_t pose) const {
  const auto* const numbers =
      poses.surface_of_pose.empty() ? nullptr : poses.surface_of_pose.data();
  return surface_of(numbers, surfaces.size(), static_cast<int>(pose));
}

/// Takes a surface into the job. Returns true if it has a field.
bool FieldBatch::Worker::look_at(int requested) {
  const DepthFieldView& field = job.fields[0];
  if (requested != surface) {
    job.fields[0] = surfaces[requested].field;
    has_all = field.requested.has_all(field.levels[0].width, field.levels[0].height);
    surface = requested;
  }
  return field.num_levels > 0;
}

ContactResult FieldBatch::Worker::evaluate(std::size_t pose, BatchPose& at) {
  const bool with_stiffness = answers.stiffness != nullptr;
  const auto nothing = [&](StepStatus why) {
    ContactResult result;
    result.penetration.status = why;
    if (with_stiffness) result.stiffness.emplace();
    if (noise) result.noise.emplace();
    return result;
  };
  const int requested = surface_number_of(pose);
  if (requested < 0 || !look_at(requested)) return nothing(StepStatus::no_surface);
  const DepthFieldView& field = job.fields[0];
  at = pose_in_camera(poses.X_WT[pose], poses.X_WC.empty() ? nullptr : &poses.X_WC[requested]);
  if (!at.is_finite) return nothing(StepStatus::non_finite_pose);
  if (!has_all && !is_known_around(field, at.X_CT * query.p_TC_, query.elements_->reach)) {
    return nothing(StepStatus::outside_window);
  }
  job.frame = frame_of(field.intrinsics, at.X_CT, query.p_TC_);
  if (noise) job.noise = noise->rows();
  FieldSums sums;
  std::optional<StiffnessSums> of_all;
  if (with_stiffness) of_all.emplace();
  for (int group = 0; group < job.clusters->num_groups(); ++group) {
    query.kernels_.measure_group(job, group, with_stiffness, of_group);
    sums.add(of_group[0].measure);
    if (with_stiffness) of_all->add(of_group[0].stiffness);
  }
  ContactResult result;
  result.penetration = sums.penetration();
  if (with_stiffness) result.stiffness = of_all->stiffness();
  keep_bounds(result);
  if (noise) result.noise = noise->of_field(field, job.frame);
  return result;
}

void FieldBatch::Worker::put(std::size_t pose, const BatchPose& at, ContactResult& result) const {
  Penetration& measured = result.penetration;
  if (!poses.X_WC.empty() && result.noise) rotate_noise(at.R_WC, *result.noise);
  if (!poses.X_WC.empty() && measured.volume > 0) {
    measured.measure_W = {at.R_WC * measured.measure_W.force, at.R_WC * measured.measure_W.torque};
    if (result.stiffness) rotate_blocks(at.R_WC, result.stiffness->m);
  }
  put_answers(pose, result, answers);
}

void FieldBatch::Worker::put_nothing(std::size_t pose) const {
  ContactResult nothing;
  nothing.stiffness = StiffnessSums{}.stiffness();
  if (job.fields[0].noise != nullptr) nothing.noise.emplace();
  put_answers(pose, nothing, answers);
}

/// True if a pose is so far in front that nothing is touched. Otherwise `place` is the sort key by
/// surface and tile. The tool is taken as a ball around its origin: that needs no rotation.
bool FieldBatch::Worker::is_in_front(std::size_t pose, std::uint64_t& place) {
  place = 0;
  const int requested = surface_number_of(pose);
  if (requested < 0) return false;
  place = static_cast<std::uint64_t>(requested) << 16;
  if (!has_overviews || !look_at(requested) || !has_all) return false;
  const Pose& X_WT = poses.X_WT[pose];
  const Quaternion& q = X_WT.rotation;
  Vec3d p_C = X_WT.translation;
  if (!poses.X_WC.empty()) p_C = inverse(poses.X_WC[static_cast<std::size_t>(requested)]) * p_C;
  const double total = p_C.x + p_C.y + p_C.z + q.x + q.y + q.z + q.w;
  if (total - total != 0) return false;
  const DepthFieldView& field = job.fields[0];
  FieldFrame& frame = job.frame;
  frame.fx = static_cast<float>(field.intrinsics.fx);
  frame.fy = static_cast<float>(field.intrinsics.fy);
  frame.cx = static_cast<float>(field.intrinsics.cx);
  frame.cy = static_cast<float>(field.intrinsics.cy);
  for (int axis = 0; axis < 3; ++axis) frame.p_WC[axis] = static_cast<float>(p_C[axis]);
  const BallWindow window = window_of(frame, {{}, {}, query.reach_}, query.largest_radius_,
                                      field.tiles_wide, field.tiles_high);
  place |= static_cast<std::uint64_t>(window.top * field.tiles_wide + window.left);
  const Overview& overview = query.overviews_[static_cast<std::size_t>(requested)];
  return overview.is_in_front(window, query.largest_radius_);
}

/// Measures poses in the order of the places that they see, which lie together in memory.
void FieldBatch::Worker::measure(std::size_t first, std::size_t last) {
  std::uint64_t order[kMaxPosesPerTask];
  std::size_t num = 0;
  for (std::size_t pose = first; pose < last; ++pose) {
    std::uint64_t place = 0;
    if (is_in_front(pose, place)) {
      put_nothing(pose);
    } else {
      order[num++] = place * kMaxPosesPerTask + (pose - first);
    }
  }
  std::sort(order, order + num);
  for (std::size_t i = 0; i < num; ++i) {
    const std::size_t pose = first + order[i] % kMaxPosesPerTask;
    const std::size_t soon = first + order[std::min(i + 4, num - 1)] % kMaxPosesPerTask;
    __builtin_prefetch(&poses.X_WT[soon]);
    BatchPose at;
    ContactResult result = evaluate(pose, at);
    put(pose, at, result);
  }
}

FieldBatch::FieldBatch(std::shared_ptr<const ToolIndex> index, const FieldMethod& method,
                       const ExecutionOptions& execution)
    : index_(std::move(index)),
      elements_(&parts_of(*index_).elements(method.volumes)),
      p_TC_(index_->tool().sphere_mass().center_of_mass),
      kernels_(field_contact_kernels(execution.isa)),
      isa_(execution.isa),
      largest_radius_(
          *std::max_element(elements_->largest_radius.begin(), elements_->largest_radius.end())),
      reach_(static_cast<float>(1.0001 * (norm(p_TC_) + elements_->reach) +
                                static_cast<double>(largest_radius_))),
      pool_(execution.pool != nullptr ? execution.pool : &own_pool_) {}

FieldBatch::~FieldBatch() = default;

Status FieldBatch::reserve(int num_surfaces, int) const {
  const auto num = static_cast<std::size_t>(num_surfaces);
  if (overviews_.size() < num) overviews_.resize(num);
  return Done{};
}

Status FieldBatch::measure(const SurfaceBatch& surfaces, const PoseBatch& poses,
                           const BatchAnswers& answers, std::optional<CallerStream>) const {
  if (const Status status = check_batch(surfaces, poses); !status) return status;
  const auto refuse = [](int gpu, const char* what) {
    return Error{Errc::invalid_argument, std::string(what) + " in the memory of GPU " +
                                             std::to_string(gpu) +
                                             " was given to a batch on the CPU; create the contact "
                                             "with Place::cuda(" +
                                             std::to_string(gpu) + ") or copy it to host memory"};
  };
  if (poses.gpu != kHostMemory) return refuse(poses.gpu, "an array of poses");
  if (answers.gpu != kHostMemory) return refuse(answers.gpu, "an array for answers");
  for (int i = 0; i < surfaces.size(); ++i) {
    const DepthFieldView& field = surfaces[i].field;
    if (field.num_levels > 0 && field.gpu != kHostMemory) return refuse(field.gpu, "a surface");
    if (surfaces.is_even()) break;
  }
  const std::size_t num = poses.X_WT.size(),
                    num_surfaces = static_cast<std::size_t>(surfaces.size());
  const bool has_overviews = num >= kPosesPerOverview * num_surfaces;
  (void)reserve(surfaces.size(), 0);
  pool_->parallel_for(has_overviews ? surfaces.size() : 0, [&](int i) {
    const DepthFieldView field = surfaces[i].field;
    if (field.num_levels > 0) overviews_[static_cast<std::size_t>(i)].look_at(field);
  });
  // Tasks enough that no thread waits long for the last one.
  const std::size_t share = num / (8 * static_cast<std::size_t>(pool_->num_threads()));
  const std::size_t of_task = std::clamp<std::size_t>(share, kMinPosesPerTask, kMaxPosesPerTask);
  pool_->parallel_for(static_cast<int>((num + of_task - 1) / of_task), [&](int task) {
    Worker worker{*this, surfaces, poses, answers, has_overviews, measure_job(*elements_)};
    if (answers.want_noise()) worker.noise.emplace(elements_->clusters.num_groups(), isa_);
    const std::size_t first = static_cast<std::size_t>(task) * of_task;
    worker.measure(first, std::min(num, first + of_task));
  });
  return Done{};
}

void put_answers(std::size_t pose, const ContactResult& result, const BatchAnswers& answers) {
  const Penetration& measured = result.penetration;
  const auto put = [&](double* to, const Vec3d& v) {
    for (int axis = 0; axis < 3 && to != nullptr; ++axis) {
      to[3 * pose + static_cast<std::size_t>(axis)] = v[axis];
    }
  };
  if (answers.volume != nullptr) answers.volume[pose] = measured.volume;
  if (answers.potential != nullptr) answers.potential[pose] = measured.potential;
  put(answers.force, measured.measure_W.force);
  put(answers.torque, measured.measure_W.torque);
  if (answers.stiffness != nullptr) {
    const Stiffness k = result.stiffness.value_or(Stiffness{});
    std::copy_n(&k.m[0][0], 36, answers.stiffness + 36 * pose);
  }
  if (answers.status != nullptr) answers.status[pose] = measured.status.bits;
  if (!answers.want_noise()) return;
  const MeasureNoise noise = result.noise.value_or(unknown_noise());
  if (answers.volume_std != nullptr) answers.volume_std[pose] = noise.volume_std();
  put(answers.force_std, noise.force_std());
  put(answers.torque_std, noise.torque_std());
}

}}  // namespace palpate::v0
