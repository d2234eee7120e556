// The search for the nearest sphere on a processor, compiled once per instruction set.
//
// The text is that of nearest_sphere.h, which is written for vectors: their lanes are the spheres
// of a part of a cluster here (4, 8 or 16 of them), and a whole cluster on a GPU, where a warp is a
// vector (clearance_cuda.cu). All of them find the same sphere and the same pixel:
//
//   least over the spheres of (phi(c) - r)
//
// They agree because bounds of squares are lowered by more than rounding changes them, each
// distance to a pixel is computed from the same numbers in the same order, and of equal values the
// first sphere and the first pixel count. So clearances have the same bits on every processor, and
// a test compares all instruction sets with every pixel in double.
#include "src/contact/clearance/nearest_sphere.h"
#include "src/contact/clearance/pose_screen.h"
#include "src/math/internal/lane_poses.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {

namespace {

// Not finite if a pose is not.
VecD sum_of(const LanePose& X) {
  const LaneVector& t = X.translation;
  const LaneRotation& q = X.rotation;
  return t.x + t.y + t.z + q.x + q.y + q.z + q.w;
}

// Places all poses before a camera.
void place_poses(PoseScreen& screen, int camera) {
  const LanePose X_CW = splat(screen.cameras[camera].X_CW);
  PoseScreen::Placed& to = screen.placed[camera];
  for (int first = 0; first < screen.num; first += kDoubles) {
    LanePose X_WT = load(screen.X_WT + first, screen.num - first);
    store(&screen.finite[first], sum_of(X_WT));
    X_WT.rotation = normalized(X_WT.rotation);
    const LanePose X_CT = X_CW * X_WT;
    const LaneMatrix R = rotation_matrix(X_CT.rotation);
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) {
        store(&to.R_CT[row][column][first], R.m[row][column]);
      }
    }
    store(&to.p_CT[0][first], X_CT.translation.x);
    store(&to.p_CT[1][first], X_CT.translation.y);
    store(&to.p_CT[2][first], X_CT.translation.z);
  }
}

// Largest change that a plane makes at any depth up to this, m: plane_change, rounded up.
VecF plane_change_to(const Image& image, VecF depth) {
  const VecF by_noise = static_cast<float>(1.001 * kPlaneChange) * max(splat(1.0f), depth * depth);
  return by_noise + 0.711f * greater(image.per_fx, image.per_fy) * depth;
}

}  // namespace

// Bounds the clearance of poses by the balls around their tools, before each camera by itself.
void screen_poses(PoseScreen& screen) {
  for (int k = 0; k < screen.num_cameras; ++k) place_poses(screen, k);
  float ball[4][PoseScreen::kMaxPoses], reach[PoseScreen::kMaxPoses];
  for (int i = 0; i < PoseScreen::kMaxPoses; ++i) {
    const ClearanceTool& tool = *screen.tools[i < screen.num ? i : 0];
    ball[0][i] = tool.ball.center.x;
    ball[1][i] = tool.ball.center.y;
    ball[2][i] = tool.ball.center.z;
    ball[3][i] = tool.ball.reach;
    reach[i] = static_cast<float>(tool.reach);
  }
  for (int first = 0; first < screen.num; first += kLanes) {
    const VecF x = load(&ball[0][first]), y = load(&ball[1][first]), z = load(&ball[2][first]);
    const VecF radius = load(&ball[3][first]);
    const VecF farther = load(&reach[first]) + abs(splat(screen.limit));
    VecF change{};
    for (int k = 0; k < screen.num_cameras; ++k) {
      const VecF depth = 1.02f * (abs(load(&screen.placed[k].p_CT[2][first])) + farther);
      change = max(change, plane_change_to(screen.cameras[k].field, depth));
    }
    store(&screen.change[first], change);
    const VecF most = screen.is_margin ? screen.limit + change : splat(screen.limit);
    VecF least = most;
    for (int k = 0; k < screen.num_cameras; ++k) {
      const PoseScreen::Placed& at = screen.placed[k];
      const auto row = [&](int i) {
        const auto entry = [&](int j) { return load(&at.R_CT[i][j][first]); };
        return entry(0) * x + entry(1) * y + entry(2) * z + load(&at.p_CT[i][first]);
      };
      const CameraPoint<VecF> p{row(0), row(1), row(2)};
      least = min(least, bound_around(screen.cameras[k].field, p, radius, most));
    }
    const VecF finite = load(&screen.finite[first]);
    const VecI is_known = finite - finite == VecF{};
    least = select(is_known, least, splat(-kFarAway));
    store(&screen.least[first], screen.cameras[0].is_joined != 0 ? splat(-kFarAway) : least);
  }
}

// Writes the nearest sphere of a job, or the hits of all spheres.
void find_nearest(const ClearanceJob& job, ClearanceHit& hit) { search_clusters(job, hit); }

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
