#include "src/contact/batch/field_batch.h"

#include <algorithm>
#include <string>
#include <utility>

#include "src/contact/batch/batch_pose.h"

namespace palpate::inline v0 {

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
  MeasureJob job{};
  int surface = -1;     // in the job
  bool has_all = true;  // is its field of the whole image?
  GroupSums of_group[2]{};

  void measure(std::size_t pose);
  ContactResult ask(std::size_t pose, BatchPose& at);
  void put(std::size_t pose, const BatchPose& at, ContactResult& result) const;
};

ContactResult FieldBatch::Worker::ask(std::size_t pose, BatchPose& at) {
  const bool with_stiffness = answers.stiffness != nullptr;
  const auto nothing = [&](StepStatus why) {
    ContactResult result;
    result.penetration.status = why;
    if (with_stiffness) result.stiffness.emplace();
    return result;
  };
  const auto* const numbers =
      poses.surface_of_pose.empty() ? nullptr : poses.surface_of_pose.data();
  const int asked = surface_of(numbers, surfaces.size(), static_cast<int>(pose));
  if (asked < 0) return nothing(StepStatus::no_surface);
  const DepthFieldView& field = job.fields[0];
  if (asked != surface) {
    job.fields[0] = surfaces[asked].field;
    has_all = field.asked.has_all(field.levels[0].width, field.levels[0].height);
    surface = asked;
  }
  if (field.num_levels == 0) return nothing(StepStatus::no_surface);
  at = pose_in_camera(poses.X_WT[pose], poses.X_WC.empty() ? nullptr : &poses.X_WC[asked]);
  if (!at.is_finite) return nothing(StepStatus::non_finite_pose);
  if (!has_all && !is_known_around(field, at.X_CT * query.p_TC_, query.elements_->reach)) {
    return nothing(StepStatus::outside_window);
  }
  job.frame = frame_of(field.intrinsics, at.X_CT, query.p_TC_);
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
  return result;
}

void FieldBatch::Worker::put(std::size_t pose, const BatchPose& at, ContactResult& result) const {
  Penetration& measured = result.penetration;
  if (!poses.X_WC.empty()) {
    measured.measure_W = {at.R_WC * measured.measure_W.force, at.R_WC * measured.measure_W.torque};
    if (result.stiffness) rotate_stiffness(at.R_WC, *result.stiffness);
  }
  if (answers.volume != nullptr) answers.volume[pose] = measured.volume;
  if (answers.potential != nullptr) answers.potential[pose] = measured.potential;
  for (int axis = 0; axis < 3; ++axis) {
    const std::size_t i = 3 * pose + static_cast<std::size_t>(axis);
    if (answers.force != nullptr) answers.force[i] = measured.measure_W.force[axis];
    if (answers.torque != nullptr) answers.torque[i] = measured.measure_W.torque[axis];
  }
  if (answers.stiffness != nullptr) {
    std::copy_n(&result.stiffness->m[0][0], 36, answers.stiffness + 36 * pose);
  }
  if (answers.status != nullptr) answers.status[pose] = measured.status.bits;
}

void FieldBatch::Worker::measure(std::size_t pose) {
  BatchPose at;
  ContactResult result = ask(pose, at);
  put(pose, at, result);
}

FieldBatch::FieldBatch(std::shared_ptr<const ToolIndex> index, const FieldMethod& method,
                       const ExecutionOptions& capacities)
    : index_(std::move(index)),
      elements_(&index_->parts().elements(method.volumes)),
      p_TC_(index_->tool().sphere_mass().centre_of_mass),
      kernels_(field_contact_kernels(capacities.isa)),
      pool_(capacities.pool != nullptr ? capacities.pool : &own_pool_) {}

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
  constexpr std::size_t kPosesPerTask = 64;
  const std::size_t num = poses.X_WT.size();
  pool_->parallel_for(static_cast<int>((num + kPosesPerTask - 1) / kPosesPerTask), [&](int task) {
    Worker worker{*this, surfaces, poses, answers, measure_job(*elements_)};
    const std::size_t first = static_cast<std::size_t>(task) * kPosesPerTask;
    for (std::size_t i = first; i < std::min(num, first + kPosesPerTask); ++i) {
      worker.measure(i);
    }
  });
  return Done{};
}

}  // namespace palpate::inline v0
