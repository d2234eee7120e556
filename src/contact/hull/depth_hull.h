// The field method against several cameras at once, on a CPU.
#pragma once

#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "src/contact/field/field_contact.h"

namespace palpate { inline namespace v0 {

struct CameraSeats;

/// A camera as seen by the elements of a tool.
struct HullCamera {
  /// Fields, the newer one first, with the pose of the tool in the camera.
  MeasureJob seen_free, field, in_front, remembered;
  bool has_in_front = false;  ///< a camera by itself, with a memory
  bool is_remembered = false;
  int number = 0;  ///< index in the cameras given to `measure`
  /// Upper bound of seen-free space if the tool is out of its image, where `field` has no surface.
  /// Infinity: it may see some of the tool.
  float at_most = std::numeric_limits<float>::infinity();
  float progress = 1;  ///< from the older to the newer one
  /// The camera has moved between its frames: each has a pose of its own, and `older` that of the
  /// tool in the older one.
  bool has_moved = false;

  bool may_see() const { return at_most == std::numeric_limits<float>::infinity(); }
  float R_WC[2][3][3] = {};
  MeasureJob older;
};

/// Arguments of a query for each group of clusters.
struct HullJob {
  MeasureJob tool;  ///< without fields; the pose in the world
  HullCamera cameras[kMaxCameras];
  int num_cameras = 0;
  int num_seeing = 0;  ///< cameras that show something now come first
  bool has_memory = false;
  /// A single camera: its `field` stands for `seen_free`, and behind the eye is free space.
  bool is_alone = false;
  /// No camera has measured all around the tool: `field` has to be sampled, too.
  bool may_be_unseen = true;
};

/// As FieldContactKernels.
struct DepthHullKernels {
  void (*measure_group)(const HullJob&, int group, bool with_stiffness, GroupSums* sums);
  void (*describe_group)(const HullJob&, int group, const SphereCuts& to);
};

/// Measures one tool against several cameras.
class DepthHull {
 public:
  DepthHull(const FieldElements& elements, const Vec3d& p_TC, Isa isa);

  /// See ContactQuery::measure; the pose is finite, with a unit quaternion.
  ContactResult measure(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                        const ContactWants& wants, ThreadPool& pool, NoiseMemory& noise);

 private:
  std::optional<MeasureNoise> noise_of_cameras(NoiseMemory& noise) const;
  ContactStatus take(std::span<const SurfaceBlend> cameras, const Pose& X_WT);
  ContactStatus take(const SurfaceBlend& view, const Pose& X_WT, int number);
  void leave_out(const SurfaceBlend& view, const CameraSeats& seats, HullCamera& camera) const;

  const FieldElements* elements_;
  Vec3d p_TC_;  // center of mass
  DepthHullKernels kernels_;
  // Scratch.
  std::unique_ptr<HullJob> job_ = std::make_unique<HullJob>();
  std::vector<GroupSums> group_sums_;
};

}}  // namespace palpate::v0
