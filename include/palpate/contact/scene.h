// One question for planners and learners: where are these tools in this scene? A scene is what all
// cameras have seen and all CAD bodies; a query takes one or many poses of one or many tools, and
// returns the contact, the clearance, or yes or no.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "palpate/contact/body_contact.h"
#include "palpate/contact/contact.h"

namespace palpate { inline namespace v0 {

/// A fixed rigid body of a scene, at a pose X_WB. Copies share the data of their shape.
class Body {
 public:
  /// `shape` must outlive it. A shape without a stored distance field computes one when it is first
  /// measured, in about a second.
  explicit Body(const Tool& shape, const Pose& X_WB = {})
      : placed_{ToolIndex::create(shape), X_WB} {}
  explicit Body(const Tool&&, const Pose& = {}) = delete;
  explicit Body(PlacedBody placed) : placed_(std::move(placed)) {}

  /// The same shape at another pose.
  Body at(const Pose& X_WB) const { return Body({placed_.shape, X_WB}); }
  const PlacedBody& placed() const { return placed_; }

 private:
  PlacedBody placed_;
};

/// The depth hull of all cameras, and all bodies: one of either at least. Non-owning surfaces.
struct Scene {
  std::vector<SurfaceView> surfaces = {};  ///< of at most kMaxCameras cameras, each with its X_WC
  std::vector<Body> bodies = {};
  /// Replaces the policy of the surfaces for occluded space (DepthFieldOptions::unseen).
  std::optional<UnseenSpace> unseen = std::nullopt;
  double thickness = 0.05;  ///< m, for UnseenSpace::free and fade
};

/// Poses of a query.
struct ScenePoses {
  std::span<const Pose> X_WT = {};                   ///< P
  std::span<const std::int32_t> tool_of_pose = {};   ///< P indices; empty: the only tool
  std::span<const std::int32_t> group_of_pose = {};  ///< P indices, as configurations; empty: none
  int num_groups = 0;
  int gpu = kHostMemory;  ///< memory of X_WT; indices are in host memory
};

/// Clearance saturates at this distance, m.
inline constexpr double kClearanceLimit = 0.1;

/// Row-major arrays of the caller, all in the memory `contact.gpu`; null: not computed. Unmeasured
/// poses have zeros. Groups and spheres are answered in host memory alone.
struct SceneAnswers {
  /// The sum of the contact with the cameras and with each body.
  BatchAnswers contact = {};
  double* unseen = nullptr;  ///< P: share of the tool's volume in space that no camera has seen
  /// P, m: least of phi(c) - r over the spheres, negative inside: phi is the signed distance of the
  /// center to the hull of what was seen, or to a body. Between -limit and limit.
  double* clearance = nullptr;
  std::int32_t* nearest = nullptr;  ///< P: its sphere; -1: saturated, far or deep: see the sign
  std::int32_t* decided = nullptr;  ///< P: its camera, or cameras + body; -1: saturated
  /// P x 6: its derivative by translation and rotation about the tool's center of mass C, in W.
  double* clearance_gradient = nullptr;
  double clearance_limit = kClearanceLimit;  ///< m, above 0
  /// m: above 0 `clearance` and its gradient are those of a smooth minimum over all spheres,
  /// cameras and bodies, -s ln(sum exp(-c_i / s)). It is never above the least and below it by at
  /// most s ln of their number. Costs two to ten times as much.
  double clearance_smoothing = 0;
  /// For each group, num_groups: least clearance, the pose that has it (-1: none), sum of volumes.
  double* group_clearance = nullptr;
  std::int32_t* group_pose = nullptr;
  double* group_volume = nullptr;
  /// Tells the clearance of the nearest pose of each group; others may be told to be saturated.
  /// Faster on a CPU. Without effect with smoothing.
  bool only_least_of_groups = false;
  /// Per sphere, P x max_spheres, of the cameras: depth of the deepest point, m; volume of the cap,
  /// m3; direction of the force in W (x 3); and the camera that determined it (kNoCamera: none).
  float* sphere_depth = nullptr;
  float* sphere_volume = nullptr;
  float* sphere_direction = nullptr;
  std::int8_t* sphere_decided = nullptr;
  std::size_t max_spheres = 0;  ///< length of a row: spheres of the largest tool
};

/// Measures tools against scenes. One thread at a time.
class SceneContact {
 public:
  /// `tools` must outlive it. `num_threads`: of a CPU; 0: one per core. Errors: no tool; the place
  /// is not in this build or on this machine.
  static Result<SceneContact> create(std::span<const Tool* const> tools,
                                     const ContactMethod& method = FieldMethod{},
                                     const Place& place = Place::cpu(), int num_threads = 0);
  SceneContact(SceneContact&&) noexcept;
  SceneContact& operator=(SceneContact&&) noexcept;
  ~SceneContact();

  /// One measurement of the first tool, as ContactQuery::measure against the cameras of the scene,
  /// plus that against each body. `in_bodies`: null, or gets the bodies' share of the volume, m3.
  ContactResult measure(const Scene& scene, const Pose& X_WT, const ContactWants& wants = {},
                        double* in_bodies = nullptr) const;
  /// Many poses. The result of a pose has the same bits whatever else is asked, for any number of
  /// threads. Allocates for a new scene. Errors: an empty scene; more than kMaxCameras; surfaces in
  /// different places; several that were not made to be joined; an index of a tool or group out of
  /// range; clearance or standard deviations with a point method, or clearance of joined surfaces
  /// with memory; arrays where the contact does not read or write.
  ///
  /// On a GPU poses and answers may lie there. Work is done in `stream`, in order with what the
  /// caller does there; another stream, or another scene, waits for it. If all arrays are on the
  /// GPU, without indices, and scene and tools were asked before, the call only enqueues it, and a
  /// CUDA graph may capture it; else it waits. A graph is valid until this contact is asked about
  /// another scene, or cameras at other poses: let its replays finish before. Standard deviations:
  /// see BatchQuery::measure.
  Status measure(const Scene& scene, const ScenePoses& poses, const SceneAnswers& answers,
                 std::optional<CallerStream> stream = {}) const;
  /// Writes 1 for each pose whose clearance is below `margin` (m), else 0; with groups for each
  /// group of which a pose is. A pose that is not finite counts as hit. `hits` lie in the memory of
  /// the poses. Errors as above.
  Status any(const Scene& scene, const ScenePoses& poses, double margin, std::uint8_t* hits,
             std::optional<CallerStream> stream = {}) const;

  /// Spheres of the largest tool.
  std::size_t max_spheres() const;

 private:
  friend struct SceneContactMaker;
  struct Impl;
  explicit SceneContact(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}}  // namespace palpate::v0
