#include "src/contact/field/field_contact.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "src/contact/blend.h"
#include "src/contact/hull/depth_hull.h"
#include "src/core/internal/select_isa.h"

namespace palpate { inline namespace v0 {
PALPATE_DECLARE_KERNELS(void measure_group(const MeasureJob&, int group, bool with_stiffness,
                                           GroupSums* sums);
                        void describe_group(const MeasureJob&, int group, const SphereCuts& to);
                        double unseen_in_group(const MeasureJob&, int group, std::uint8_t* spheres);
                        constexpr FieldContactKernels kFieldContact{measure_group, describe_group,
                                                                    unseen_in_group};)

namespace {

constexpr FieldContactKernels kKernels[] = PALPATE_BY_ISA(kFieldContact);

bool is_in_host_memory(const SurfaceView& surface) {
  const auto is_here = [](const DepthFieldView& field) {
    return field.num_levels == 0 || field.gpu == kHostMemory;
  };
  return is_here(surface.field) && is_here(surface.seen_free) && is_here(surface.in_front) &&
         is_here(surface.remembered);
}

}  // namespace

FieldContactKernels field_contact_kernels(Isa isa) { return select_isa(kKernels, isa); }

FieldContact::FieldContact(std::shared_ptr<const ToolIndex> index, const FieldMethod& method,
                           const ExecutionOptions& execution)
    : ContactQuery(std::move(index), method),
      elements_(&parts_of(*this->index()).elements(method.volumes)),
      p_TC_(this->index()->tool().sphere_mass().center_of_mass),
      kernels_(field_contact_kernels(execution.isa)),
      pool_(execution.pool != nullptr ? execution.pool : &own_pool_),
      noise_(elements_->clusters.num_groups(), execution.isa),
      group_sums_(2 * static_cast<std::size_t>(elements_->clusters.num_groups())),
      unseen_(static_cast<std::size_t>(elements_->clusters.num_groups())),
      hull_(std::make_unique<DepthHull>(*elements_, p_TC_, execution.isa)) {
  if (execution.reserves_noise) noise_.rows();
}

FieldContact::~FieldContact() = default;

ContactResult FieldContact::measure_hull(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                                         const ContactWants& wants) const noexcept {
  const auto is_readable = [](const SurfaceBlend& camera) {
    return is_in_host_memory(camera.to) && (camera.progress >= 1 || is_in_host_memory(camera.from));
  };
  if (!std::ranges::all_of(cameras, is_readable)) {
    return unmeasured(StepStatus::no_surface, wants, true);
  }
  return hull_->measure(cameras, X_WT, wants, *pool_, noise_);
}

MeasureJob FieldContact::job(std::span<const DepthFieldView> fields, const Pose& X_WT) const {
  MeasureJob requested = measure_job(*elements_);
  requested.num_fields = static_cast<int>(fields.size());
  requested.frame = frame_of(fields.front().intrinsics, X_WT, p_TC_);
  std::copy(fields.begin(), fields.end(), requested.fields);
  return requested;
}

ContactResult FieldContact::measure_one(const SurfaceView& from, const SurfaceView& to,
                                        double alpha, const Pose& X_WT,
                                        const ContactWants& wants) const noexcept {
  if (!is_finite(X_WT)) return unmeasured(StepStatus::non_finite_pose, wants, true);
  if (!is_in_host_memory(to) || (alpha < 1 && !is_in_host_memory(from))) {
    return unmeasured(StepStatus::no_surface, wants, true);
  }
  const Pose X{X_WT.translation, normalized(X_WT.rotation)};
  if (is_outside_window(from, to, alpha, X * p_TC_, elements_->reach)) {
    return unmeasured(StepStatus::outside_window, wants, true);
  }
  describe(to.field, X, wants);
  const DepthFieldView fields[] = {to.field, from.field};
  ContactResult results[2];
  if (alpha >= 1) {
    evaluate({fields, 1}, X, wants, results);
  } else if (have_one_grid(to.field, from.field) && !wants.noise) {
    evaluate(fields, X, wants, results);
  } else {
    evaluate({fields, 1}, X, wants, results);
    evaluate({fields + 1, 1}, X, wants, results + 1);
  }
  return alpha >= 1 ? results[0] : blend(results[1], results[0], alpha);
}

double FieldContact::unseen_by_one(const SurfaceView& surface, const Pose& X_CT,
                                   std::span<std::uint8_t> unseen) const noexcept {
  if (surface.field.num_levels == 0) return 0;
  const DepthFieldView fields[] = {surface.field, surface.in_front};
  const std::size_t num = surface.role == SurfaceRole::with_memory ? 2 : 1;
  const MeasureJob requested = job({fields, num}, X_CT);
  pool_->parallel_for(requested.clusters->num_groups(), [&](int group) {
    unseen_[static_cast<std::size_t>(group)] =
        kernels_.unseen_in_group(requested, group, unseen.data());
  });
  return std::accumulate(unseen_.begin(), unseen_.end(), 0.0);
}

void FieldContact::evaluate(std::span<const DepthFieldView> fields, const Pose& X_WT,
                            const ContactWants& wants, ContactResult* results) const {
  const bool with_stiffness = wants.stiffness;
  if (fields.front().num_levels == 0) {
    const ContactWants numbers{.stiffness = with_stiffness, .noise = wants.noise};
    std::fill_n(results, fields.size(), unmeasured(StepStatus::no_surface, numbers, true));
    return;
  }
  MeasureJob requested = job(fields, X_WT);
  if (wants.noise) requested.noise = noise_.rows();
  pool_->parallel_for(requested.clusters->num_groups(), [&](int group) {
    kernels_.measure_group(requested, group, with_stiffness,
                           &group_sums_[2 * static_cast<std::size_t>(group)]);
  });
  for (std::size_t k = 0; k < fields.size(); ++k) {
    FieldSums sums;
    StiffnessSums stiffness;
    for (std::size_t i = k; i < group_sums_.size(); i += 2) {
      sums.add(group_sums_[i].measure);
      if (with_stiffness) stiffness.add(group_sums_[i].stiffness);
    }
    results[k].penetration = sums.penetration();
    if (with_stiffness) {
      results[k].stiffness = stiffness.stiffness();
      results[k].moments = stiffness.moments();
    }
    keep_bounds(results[k]);
  }
  if (wants.noise) results->noise = noise_.of_field(fields.front(), requested.frame);
}

void FieldContact::describe(const DepthFieldView& field, const Pose& X_WT,
                            const ContactWants& wants) const {
  if (wants.states.empty() && wants.planes.empty()) return;
  std::fill(wants.states.begin(), wants.states.end(), SphereState::outside);
  std::fill(wants.planes.begin(), wants.planes.end(), Plane<float>{});
  if (field.num_levels == 0) return;
  const SphereCuts cuts = cuts_of(wants, p_TC_);
  const MeasureJob requested = job({&field, 1}, X_WT);
  pool_->parallel_for(requested.clusters->num_groups(),
                      [&](int group) { kernels_.describe_group(requested, group, cuts); });
}

}}  // namespace palpate::v0
