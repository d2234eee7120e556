// The contact query by points, for measurements on the CPU or on a GPU.
#pragma once

#include <memory>
#include <utility>

#include "src/contact/blend.h"

namespace palpate { inline namespace v0 {

/// `Measurement` has measure(cloud, pose), and describe(wants) for the last measurement.
template <class Measurement>
class PointContactOf final : public ContactQuery {
 public:
  PointContactOf(std::shared_ptr<const ToolIndex> index, const ContactMethod& method,
                 std::unique_ptr<Measurement> measurement)
      : ContactQuery(std::move(index), method), measurement_(std::move(measurement)) {}

  ContactResult measure_one(const SurfaceView& from, const SurfaceView& to, double alpha,
                            const Pose& X_WT, const ContactWants& wants) const noexcept override {
    if (!is_finite(X_WT)) return unmeasured(StepStatus::non_finite_pose, wants, false);
    const Pose X{X_WT.translation, normalized(X_WT.rotation)};
    ContactResult older;
    if (alpha < 1) older.penetration = measurement_->measure(from.cloud, X);
    const ContactResult newer{measurement_->measure(to.cloud, X), {}, {}};
    measurement_->describe(wants);
    return alpha < 1 ? blend(older, newer, alpha) : newer;
  }

 private:
  std::unique_ptr<Measurement> measurement_;  // scratch
};

}}  // namespace palpate::v0
