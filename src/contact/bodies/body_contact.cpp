#include "palpate/contact/body_contact.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

#include "src/contact/backends.h"
#include "src/contact/bodies/body_pair.h"
#include "src/contact/bodies/solid_contact.h"

namespace palpate { inline namespace v0 {
namespace {

/// Two nodes whose balls overlap, with the second center in the frame of the first.
struct NodePair {
  std::int32_t a, b;
  Vec3d b_center_A;
};

/// Every step of the descent goes down one level in one of the trees and leaves at most three
/// siblings waiting.
constexpr int kMaxWaitingPairs = 2 * (InnerSphereTree::kMaxWaiting - 1) + 1;

/// Calls visit(leaf of A, leaf of B, their pair in frame A) for every pair of leaves that overlap,
/// in an order that follows from the trees alone. A ball contains all leaves below it with some
/// slack for rounding, so that balls apart mean leaves apart: pruning loses no pair.
template <class Visit>
void for_each_overlap(const InnerSphereTree& tree_a, const InnerSphereTree& tree_b,
                      const Pose& X_AB, Visit visit) {
  const std::span<const IstNode> nodes_a = tree_a.nodes(), nodes_b = tree_b.nodes();
  const Mat3d R_AB = rotation_matrix(X_AB.rotation);
  const auto center_A = [&](const IstNode& b) {
    return R_AB * to_double(b.bound.center) + X_AB.translation;
  };
  std::array<NodePair, kMaxWaitingPairs> waiting;
  int num_waiting = 0;
  const auto consider = [&](std::int32_t index_a, std::int32_t index_b, const Vec3d& b_center_A) {
    const IstNode &a = nodes_a[index_a], &b = nodes_b[index_b];
    const SpherePair pair(double(a.bound.radius), double(b.bound.radius),
                          to_double(a.bound.center) - b_center_A);
    if (!pair.overlaps()) return;
    if (a.num_children == 0 && b.num_children == 0) {
      visit(a, b, pair);
    } else {
      waiting[num_waiting++] = {index_a, index_b, b_center_A};
    }
  };
  consider(0, 0, center_A(nodes_b[0]));
  while (num_waiting > 0) {
    const NodePair pair = waiting[--num_waiting];
    const IstNode &a = nodes_a[pair.a], &b = nodes_b[pair.b];
    // Descends into the larger ball: its children separate most.
    if (b.num_children == 0 || (a.num_children > 0 && a.bound.radius >= b.bound.radius)) {
      for (std::int32_t i = a.first_child; i < a.first_child + a.num_children; ++i)
        consider(i, pair.b, pair.b_center_A);
    } else {
      for (std::int32_t i = b.first_child; i < b.first_child + b.num_children; ++i)
        consider(pair.a, i, center_A(nodes_b[i]));
    }
  }
}

int num_touched(const std::vector<std::uint8_t>& touched) {
  return std::accumulate(touched.begin(), touched.end(), 0);
}

/// x^3/3 + x^4/4 + ... = -log(1 - x) - x - x^2/2 for 0 <= x < 1.
double log_tail(double x) {
  if (x > 0.1) return -std::log1p(-x) - x - x * x / 2;
  double sum = 0;
  for (int n = 16; n >= 3; --n) sum = sum * x + 1.0 / n;
  return sum * x * x * x;
}

}  // namespace

// With s = a + b, d = a - b and t = s - distance, the integral of the lens is
// pi/12 (s t^3 - t^4/4 - 3 d^2 s^2 log_tail(t/s)): no large terms cancel when t is small. From
// where the smaller ball is inside, the volume stays the same.
double lens_potential(double a, double b, double distance) {
  const double s = a + b, d = std::abs(a - b), t = s - std::max(distance, d);
  if (!(t > 0)) return 0;
  const double tail = d > 0 ? 3 * d * d * s * s * log_tail(t / s) : 0;
  const double lens = kPi / 12 * (s * t * t * t - t * t * t * t / 4 - tail);
  return distance >= d ? lens : lens + sphere_volume(std::min(a, b)) * (d - distance);
}

BodyContact::BodyContact(const Tool& a, const Tool& b)
    : a_(&a), b_(&b), touched_a_(a.spheres().size()), touched_b_(b.spheres().size()) {}

bool is_non_finite(const Pose& X_WA, const Pose& X_WB, BodyPenetration& result) {
  if (!is_finite(X_WA)) result.on_a.status = StepStatus::non_finite_pose;
  if (!is_finite(X_WB)) result.on_b.status = StepStatus::non_finite_pose;
  return result.on_a.status.bits != 0 || result.on_b.status.bits != 0;
}

BodyPenetration body_penetration(const BodySums& sums, const Tool& a, const Tool& b,
                                 const Pose& X_WA, const Pose& X_WB) {
  // The same forces on B, opposite and about its own center of mass.
  const Vec3d C_A = a.sphere_mass().center_of_mass;
  const Vec3d C_B_A = relative_pose(X_WA, X_WB) * b.sphere_mass().center_of_mass;
  const Vec3d torque_B_A = -(sums.torque_A + cross(C_A - C_B_A, sums.force_A));
  const Quaternion R_WA = normalized(X_WA.rotation);
  BodyPenetration result;
  result.on_a.volume = result.on_b.volume = sums.volume;
  result.on_a.measure_W = {rotate(R_WA, sums.force_A), rotate(R_WA, sums.torque_A)};
  result.on_b.measure_W = {-result.on_a.measure_W.force, rotate(R_WA, torque_B_A)};
  result.on_a.num_boundary_spheres = sums.num_touched_a;
  result.on_b.num_boundary_spheres = sums.num_touched_b;
  result.num_pairs = sums.num_pairs;
  return result;
}

void BodyContact::start(const Pose& X_WA, const Pose& X_WB, bool) noexcept {
  X_WA_ = X_WA;
  X_WB_ = X_WB;
}

BodyPenetration BodyContact::finish() noexcept {
  if (BodyPenetration nothing; is_non_finite(X_WA_, X_WB_, nothing)) return nothing;
  std::fill(touched_a_.begin(), touched_a_.end(), std::uint8_t{0});
  std::fill(touched_b_.begin(), touched_b_.end(), std::uint8_t{0});
  const Vec3d C_A = a_->sphere_mass().center_of_mass;
  BodySums sums;
  for_each_overlap(a_->tree(), b_->tree(), relative_pose(X_WA_, X_WB_),
                   [&](const IstNode& a, const IstNode& b, const SpherePair& pair) {
                     const SharedLens lens(pair);
                     sums.volume += lens.volume;
                     sums.force_A += lens.force;
                     sums.torque_A += cross(to_double(a.bound.center) - C_A, lens.force);
                     ++sums.num_pairs;
                     touched_a_[static_cast<std::size_t>(a.sphere_id)] = 1;
                     touched_b_[static_cast<std::size_t>(b.sphere_id)] = 1;
                   });
  sums.num_touched_a = num_touched(touched_a_);
  sums.num_touched_b = num_touched(touched_b_);
  return body_penetration(sums, *a_, *b_, X_WA_, X_WB_);
}

double BodyContact::potential(const Pose& X_WA, const Pose& X_WB) const noexcept {
  if (!is_finite(X_WA) || !is_finite(X_WB)) return 0;
  double sum = 0;
  for_each_overlap(a_->tree(), b_->tree(), relative_pose(X_WA, X_WB),
                   [&](const IstNode&, const IstNode&, const SpherePair& pair) {
                     sum += lens_potential(pair.radius_a, pair.radius_b, pair.distance());
                   });
  return sum;
}

Result<std::unique_ptr<BodyPairQuery>> make_body_pair_query(const Place& place, const Tool& a,
                                                            const Tool& b,
                                                            const BodyPairOptions& options) {
  return make_body_pair_query(place, ToolIndex::create(a), ToolIndex::create(b), options);
}

Result<std::unique_ptr<BodyPairQuery>> make_body_pair_query(const Place& place,
                                                            std::shared_ptr<const ToolIndex> a,
                                                            std::shared_ptr<const ToolIndex> b,
                                                            const BodyPairOptions& options) {
  const bool by_field = options.method == BodyMethod::field;
  if (place.backend == Backend::cpu) {
    if (by_field) {
      return std::unique_ptr<BodyPairQuery>(
          new SolidContact(std::move(a), std::move(b), options.isa));
    }
    return std::unique_ptr<BodyPairQuery>(new BodyContact(a->tool(), b->tool()));
  }
#if defined(PALPATE_CUDA)
  return by_field ? make_solid_contact_cuda(std::move(a), std::move(b), place.gpu)
                  : make_body_contact_cuda(std::move(a), std::move(b), place.gpu);
#else
  return find_gpus().error();
#endif
}

}}  // namespace palpate::v0
