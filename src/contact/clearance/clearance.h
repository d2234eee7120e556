// The clearance of a tool in the surfaces of a scene, on a CPU.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "palpate/contact/contact.h"
#include "src/contact/clearance/body_distance.h"
#include "src/contact/clearance/pose_screen.h"

namespace palpate { inline namespace v0 {

/// Checks that surfaces of a scene can be searched. Errors: a surface without field, on another GPU
/// than this (kHostMemory: on any), for a window only, of several with a memory, or one of several
/// that was not made for that.
Status check_searched(std::span<const SurfaceView> surfaces, int gpu);

/// An image that is searched: its field, and whether it is of seen-free space.
struct SearchedImage {
  const DepthFieldView* view = nullptr;
  bool is_blocked = false;
};
/// The images of a surface: that of `field`, and of `seen_free` or `in_front` if it has one.
inline std::array<SearchedImage, 2> images_of(const SurfaceView& surface, bool is_alone) {
  if (!is_alone) return {{{&surface.field, false}, {&surface.seen_free, true}}};
  const bool has_two = surface.in_front.num_levels > 0;
  return {{{&surface.field, false}, {has_two ? &surface.in_front : nullptr, false}}};
}

/// A scene ready for searches. One thread updates it, then any number read.
class ClearanceScene {
 public:
  /// Takes surfaces and bodies in host memory; images with the stamp of one that is there are kept.
  /// Errors: see check_searched.
  Status update(std::span<const SurfaceView> surfaces, std::span<const SearchedBody> bodies,
                ThreadPool& pool);

  /// Places the poses of a screen before the cameras, and looks at their balls.
  void place(PoseScreen& screen, const ClearanceKernels& kernels) const noexcept;

  std::span<const SeenByCamera> cameras() const { return cameras_; }
  std::span<const SearchedBody> bodies() const { return bodies_; }
  int num_surfaces() const { return num_surfaces_; }

 private:
  int num_surfaces_ = 0;
  std::vector<ClearanceFrame> frames_;  // two of each surface
  std::vector<float> thickness_;        // of each frame
  std::vector<SeenByCamera> cameras_;
  std::vector<SearchedBody> bodies_;
};

/// Returns the cameras that are searched: with a memory, two for a surface. `images`: two of each
/// surface, or null.
std::vector<SeenByCamera> seen_by(std::span<const SurfaceView> surfaces,
                                  std::span<const ClearanceImage* const> images);

/// Searches for the spheres of one tool. Any number of threads at a time.
class ClearanceQuery {
 public:
  ClearanceQuery(const ToolIndex& index, Isa isa);

  const ClearanceTool& tool() const { return tool_; }

  /// The least clearance to a scene at a finite pose, number `i` of those that were placed in it,
  /// between -limit and limit (m). `below`: one that is not below it may be told to be saturated.
  /// No allocation. O(spheres) where nothing is near.
  Clearance measure(const ClearanceScene& scene, const PoseScreen& screen, int i, double limit,
                    double below) const noexcept;
  /// The soft minimum over spheres, cameras and bodies instead of the least: see
  /// SceneAnswers::clearance_smoothing. `each` grows to the number of spheres.
  Clearance measure_softly(const ClearanceScene& scene, const PoseScreen& screen, int i,
                           double limit, double smoothing, std::vector<ClearanceHit>& each) const;
  /// True if `measure` is below the margin, m.
  bool is_within(const ClearanceScene& scene, const PoseScreen& screen, int i,
                 double margin) const noexcept;

 private:
  ClearanceHit search(ClearanceJob job, const PoseScreen& screen, int i) const noexcept;
  void add_bodies(const ClearanceScene& scene, const Pose& X_WT, Clearance& least) const noexcept;

  ClearanceTool tool_;
  ClearanceJob job_;  // without cameras
  ClearanceKernels kernels_;
};

}}  // namespace palpate::v0
