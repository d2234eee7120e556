// Forward kinematics of some configurations at once, compiled once per instruction set.
#include "src/math/internal/lane_poses.h"
#include "src/robot/place_links.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {

namespace {

LanePose load_link(const PlacedLink& from, int first) {
  const auto row = [&](int k) { return load(&from.numbers[k][first]); };
  return {{row(0), row(1), row(2)}, {row(3), row(4), row(5), row(6)}};
}

void store_link(PlacedLink& to, int first, const LanePose& X) {
  const VecD rows[] = {X.translation.x, X.translation.y, X.translation.z, X.rotation.x,
                       X.rotation.y,    X.rotation.z,    X.rotation.w};
  for (int k = 0; k < 7; ++k) store(&to.numbers[k][first], rows[k]);
}

}  // namespace

// Places the links of all lanes, from the root on.
void place_links(const PlaceJob& job) {
  for (int first = 0; first < job.num; first += kDoubles) {
    store_link(job.X_BL[job.root], first, splat(Pose{}));
    for (std::size_t j = 0; j < job.num_joints; ++j) {
      const RobotJoint& joint = job.joints[j];
      const JointMoves& moves = job.moves[j];
      LanePose X = load_link(job.X_BL[joint.parent], first) * splat(joint.X_PJ);
      const VecD by = load(&moves.by[0][first]);
      const LaneVector along{moves.axis.x * by, moves.axis.y * by, moves.axis.z * by};
      if (joint.kind == RobotJoint::Kind::turning) {
        const LaneRotation turn{along.x, along.y, along.z, load(&moves.by[1][first])};
        X.rotation = normalized(X.rotation * turn);
      } else if (joint.kind == RobotJoint::Kind::sliding) {
        X.translation = X * along;
      }
      store_link(job.X_BL[joint.child], first, X);
    }
    const int count = job.num - first < kDoubles ? job.num - first : kDoubles;
    for (std::size_t l = 0; l < job.num_limbs; ++l) {
      const LanePose X = splat(job.X_WB) * load_link(job.X_BL[job.limbs[l]], first);
      const LaneVector& t = X.translation;
      const LaneRotation& q = X.rotation;
      for (int i = 0; i < count; ++i) {
        Pose& to = job.X_WL[static_cast<std::size_t>(first + i) * job.num_limbs + l];
        to.translation.x = t.x[i];
        to.translation.y = t.y[i];
        to.translation.z = t.z[i];
        to.rotation.x = q.x[i];
        to.rotation.y = q.y[i];
        to.rotation.z = q.z[i];
        to.rotation.w = q.w[i];
      }
    }
  }
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
