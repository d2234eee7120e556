// Pose and wrench in the frame and about the point of OutputOptions.
#pragma once

#include "palpate/run/records.h"
#include "src/math/internal/wrench_transform.h"

namespace palpate { inline namespace v0 {

/// Frames and points that OutputOptions refers to, at one time.
struct OutputFrames {
  Pose X_WT;
  Vec3d p_WC;      ///< center of mass of the tool's spheres
  Pose X_WCamera;  ///< the first one
  Pose X_WB;       ///< base of the device
};

/// Transforms from the world's axes and the tool's center of mass.
class ReportedOutput {
 public:
  ReportedOutput(const OutputOptions& options, const OutputFrames& at)
      : p_WC_(at.p_WC), X_WE_(at.X_WT * options.X_TE) {
    switch (options.wrench_frame.value_or(WrenchFrame::world)) {
      case WrenchFrame::world: break;
      case WrenchFrame::camera: X_WF_ = at.X_WCamera; break;
      case WrenchFrame::tool: X_WF_ = X_WE_; break;
      case WrenchFrame::device: X_WF_ = at.X_WB; break;
      case WrenchFrame::named: X_WF_ = options.X_WN; break;
    }
    switch (options.wrench_point) {
      case WrenchPoint::center_of_mass: point_W_ = at.p_WC; break;
      case WrenchPoint::tcp: point_W_ = X_WE_.translation; break;
      case WrenchPoint::origin: point_W_ = X_WF_.translation; break;
    }
  }

  /// X_FE: pose of the tool's center point.
  Pose pose() const { return inverse(X_WF_) * X_WE_; }
  /// A Wrench or a VolumeWrench in the axes of F.
  template <class Any>
  Any wrench(const Any& F_C_W) const {
    return expressed_in(X_WF_.rotation, moved_to(point_W_, F_C_W, p_WC_));
  }

 private:
  Vec3d p_WC_, point_W_;
  Pose X_WE_, X_WF_;
};

}}  // namespace palpate::v0
