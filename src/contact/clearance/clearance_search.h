// The search for the sphere of a tool that is nearest to what cameras have seen.
//
//   clearance = min over the spheres of (phi(c) - r)
//
// phi is the signed distance to the solid of a camera: to its nearest pixel's ray from outside,
// minus the distance to the nearest free one from inside. With several cameras it is the greatest
// of those of seen-free space, as in the depth hull (docs/decisions/0029-depth-hull.md), and no
// less than the least of those of `field`. A branch and bound over squares of pixels, for as many
// spheres at once as a vector has lanes.
#pragma once

#include <cstdint>

#include "palpate/core/core.h"
#include "src/contact/clearance/clearance_image.h"
#include "src/contact/field/field_bound.h"
#include "src/contact/index/sphere_clusters.h"

namespace palpate { inline namespace v0 {

/// The spheres of a tool (SphereClusters) in the memory of the device that searches.
struct ClusterView {
  const float *x = nullptr, *y = nullptr, *z = nullptr, *radius = nullptr;  ///< of each slot
  const std::int32_t* sphere_id = nullptr;
  const Cluster *clusters = nullptr, *groups = nullptr;
  std::int32_t num_spheres = 0, num_clusters = 0, num_groups = 0;
};
inline ClusterView view_of(const SphereClusters& c) {
  return {c.x.data(),         c.y.data(),        c.z.data(),      c.radius.data(),
          c.sphere_id.data(), c.clusters.data(), c.groups.data(), c.num_loose_spheres,
          c.num_clusters(),   c.num_groups()};
}

/// A camera of a search, and the pose of the tool in it.
struct ClearanceCamera {
  const ClearanceImage* field = nullptr;
  const ClearanceImage* seen_free = nullptr;  ///< null: one camera by itself
  float R_CT[3][3] = {};
  float p_CT[3] = {};
};

/// The kind of space that the nearest sphere is near to.
enum class ClearanceKind : std::uint8_t {
  nothing,  ///< nearer than the limit
  solid,    ///< a pixel's solid space, seen from outside
  open,     ///< a pixel's free space, seen from inside
  border,   ///< a plane through the border of an image
  deep,     ///< no free space nearer than the limit
};

/// The nearest sphere.
struct ClearanceHit {
  float value = 0;           ///< m
  std::int32_t sphere = -1;  ///< -1: none
  std::int32_t pixel = -1;   ///< row * width + column; of a border: its number
  std::int16_t camera = -1;
  bool is_of_field = false;  ///< the image is that of `field`
  ClearanceKind kind = ClearanceKind::nothing;
};

/// Arguments of a search.
struct ClearanceJob {
  ClusterView spheres;
  const ClearanceCamera* cameras = nullptr;
  int num_cameras = 0;
  float limit = 0;    ///< m: values below it are looked for
  float deepest = 0;  ///< m: depths beyond it are not told apart
  /// Any sphere with a value below `enough` ends the search, m.
  float enough = -1e9f;
  /// Hits of all spheres by their numbers, if not null; then there is no nearest one.
  /// A sphere without a hit keeps the entry that is there.
  ClearanceHit* each = nullptr;
};

struct PoseScreen;

struct ClearanceKernels {
  void (*find_nearest)(const ClearanceJob& job, ClearanceHit& hit);
  void (*screen_poses)(PoseScreen& screen);
};

/// An instruction set that the processor lacks is lowered. All give the same hits.
ClearanceKernels clearance_kernels(Isa isa);

}}  // namespace palpate::v0
