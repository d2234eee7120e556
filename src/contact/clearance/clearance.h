// The clearance of a tool in the surfaces of a scene, on a CPU.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/contact/contact.h"
#include "src/contact/clearance/clearance_image.h"
#include "src/contact/clearance/clearance_search.h"

namespace palpate { inline namespace v0 {

/// The least clearance at a pose.
struct Clearance {
  double value = 0;           ///< m, negative inside
  std::int32_t sphere = -1;   ///< -1: saturated
  std::int32_t decider = -1;  ///< camera, or number of cameras + body; -1: saturated
  double gradient[6] = {};    ///< by translation and rotation about C, in W
};

/// The surfaces of a scene, ready for searches. One thread updates it, then any number read.
class ClearanceScene {
 public:
  /// Takes surfaces in host memory; those with the stamp of an image that is there are kept.
  /// Errors: a surface without field, on a GPU, with a memory, for a window only, or one of several
  /// that was not made for that.
  Status update(std::span<const SurfaceView> surfaces, ThreadPool& pool);

  int num_cameras() const { return static_cast<int>(cameras_.size()); }

 private:
  friend class ClearanceQuery;
  struct Camera {
    ClearanceFrame field, seen_free;
    bool is_joined = false;
    Pose X_WC, X_CW;
    float thickness = 0;
  };
  std::vector<Camera> cameras_;
};

/// Searches for the spheres of one tool. Any number of threads at a time.
class ClearanceQuery {
 public:
  ClearanceQuery(const ToolIndex& index, Isa isa);

  /// The least clearance to the cameras of a scene at a finite pose, between -limit and limit (m).
  /// No allocation. O(spheres) where nothing is near.
  Clearance measure(const ClearanceScene& scene, const Pose& X_WT, double limit,
                    bool wants_gradient) const noexcept;
  /// True if `measure` is below the margin, m.
  bool is_within(const ClearanceScene& scene, const Pose& X_WT, double margin) const noexcept;

 private:
  struct Cameras;

  const Tool* tool_;
  const SphereClusters* spheres_;
  ClearanceKernels kernels_;
  double reach_ = 0;  // of the tool from its origin, m
};

}}  // namespace palpate::v0
