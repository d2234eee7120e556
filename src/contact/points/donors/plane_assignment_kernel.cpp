// The plane stage, compiled once per instruction set.
#include <algorithm>
#include <bit>

#include "src/contact/points/donors/assignment_rule.h"
#include "src/contact/points/donors/plane_assignment.h"
#include "src/core/internal/simd.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {
namespace {

// Values in a row of RowSums.
constexpr int kRow = 16;

// cap_volume on vectors; the same text as math/geometry.h with selects.
inline VecF cap_volume_v(VecF radius, VecF distance) {
  const VecF h = min(max(radius - distance, VecF{}), radius + radius);
  return static_cast<float>(kPi / 3.0) * h * h * (3.0f * radius - h);
}

// Centers of donors to choose from, and their indices.
struct CandidateList {
  int num;
  const float *x, *y, *z;
  const std::int32_t* donor;
};

CandidateList list_of(const Candidates& c) { return {c.num, c.x, c.y, c.z, c.donor}; }

// Keeps those of `from` that may be nearest to some center in the box. `to` may not overlap `from`;
// its squared distances are scratch.
void prune_candidates(const CandidateList& from, const Cluster& box, Candidates& to) {
  VecF least = splat(1e30f);
  for (int i = 0; i < from.num; i += kLanes) {
    const VecF dx = load(from.x + i) - box.center.x, dy = load(from.y + i) - box.center.y,
               dz = load(from.z + i) - box.center.z;
    const VecI in_range = lane_ids() < splat(static_cast<std::int32_t>(from.num - i));
    const VecF squared = select(in_range, squared_length(dx, dy, dz), splat(1e30f));
    store(to.squared_distance + i, squared);
    least = min(least, squared);
  }
  float nearest = least[0];
  for (int lane = 1; lane < kLanes; ++lane) nearest = std::min(nearest, least[lane]);
  int best = 0;
  while (to.squared_distance[best] != nearest) ++best;

  const NearestToMiddle nearest_one{from.x[best], from.y[best], from.z[best], nearest};
  to.num = 0;
  for (int i = 0; i < from.num; i += kLanes) {
    const VecF bx = load(from.x + i), by = load(from.y + i), bz = load(from.z + i);
    const VecF squared = load(to.squared_distance + i);
    const std::uint32_t bits = mask_bits(may_be_nearest(bx, by, bz, squared, nearest_one, box));
    if (bits == 0) continue;
    compress_store(to.x + to.num, bx, bits);
    compress_store(to.y + to.num, by, bits);
    compress_store(to.z + to.num, bz, bits);
    VecI donor;
    std::memcpy(&donor, from.donor + i, sizeof donor);
    compress_store(to.donor + to.num, donor, bits);
    to.num += std::popcount(bits);
  }
}

// True if some sphere of the cluster may reach behind one of the candidates' planes.
bool is_reached(const BoundaryPlanes& boundary, const Candidates& candidates,
                const Cluster& cluster) {
  const float limit = reach_with_slack(cluster);
  for (int i = 0; i < candidates.num; ++i) {
    const std::int32_t b = candidates.donor[i];
    const float distance = boundary.nx[b] * cluster.center.x + boundary.ny[b] * cluster.center.y +
                           boundary.nz[b] * cluster.center.z - boundary.offset[b];
    if (distance < limit) return true;
  }
  return false;
}

// Marks the spheres of clusters [first, last) as not behind any plane.
void leave_outside(const PlaneAssignment& job, int first, int last) {
  const std::size_t begin = static_cast<std::size_t>(first) * SphereClusters::kSize;
  const std::size_t end = static_cast<std::size_t>(last) * SphereClusters::kSize;
  std::fill(job.assigned_volume + begin, job.assigned_volume + end, 0.0f);
  std::fill(job.donor + begin, job.donor + end, PlaneAssignment::kNone);
}

// Returns the nearest boundary sphere by center distance in double, ties to the lowest sphere id
// (boundary spheres are in ascending order).
std::int32_t nearest_exactly(const PlaneAssignment& job, std::int32_t sphere_id,
                             const Candidates& candidates) {
  const Vec3d c = to_double(job.spheres[sphere_id].center);
  std::int32_t best = candidates.donor[0];
  double least = 1e300;
  for (int i = 0; i < candidates.num; ++i) {
    const std::int32_t other = job.boundary.sphere_id[candidates.donor[i]];
    const Vec3d d = to_double(job.spheres[other].center) - c;
    const double squared = dot(d, d);
    if (squared < least) least = squared, best = candidates.donor[i];
  }
  return best;
}

// Returns V_s of one sphere behind a plane, in double.
double exact_volume(const PlaneAssignment& job, std::int32_t sphere_id, std::int32_t donor) {
  const Sphere& sphere = job.spheres[sphere_id];
  const Plane<double>& plane = job.boundary.plane[donor];
  return cap_volume(static_cast<double>(sphere.radius),
                    dot(plane.normal, to_double(sphere.center)) - plane.offset);
}

// Returns the boundary sphere whose plane each lane takes: the nearest one of the candidates.
VecI nearest_candidates(const PlaneAssignment& job, std::size_t slot,
                        const Candidates& candidates) {
  const SphereClusters& c = *job.clusters;
  const VecF x = load(&c.x[slot]), y = load(&c.y[slot]), z = load(&c.z[slot]);
  VecF least = splat(1e30f), second = splat(1e30f);
  VecI best = splat(candidates.donor[0]);
  for (int i = 0; i < candidates.num; ++i) {
    const VecF dx = x - candidates.x[i], dy = y - candidates.y[i], dz = z - candidates.z[i];
    const VecF squared = squared_length(dx, dy, dz);
    const VecI closer = squared < least;
    second = min(second, max(squared, least));
    least = min(squared, least);
    best = closer ? splat(candidates.donor[i]) : best;
  }
  // Close calls, decided in double.
  std::uint32_t close = mask_bits(is_close_call(least, second));
  for (; close != 0; close &= close - 1) {
    const int lane = std::countr_zero(close);
    const std::int32_t id = c.sphere_id[slot + static_cast<std::size_t>(lane)];
    if (id >= 0) best[lane] = nearest_exactly(job, id, candidates);
  }
  return best;
}

// Weights of boundary spheres b, b + 1, ... for a sphere at (x, y, z).
template <Priority kPriority>
inline VecF weights_of(const PlaneAssignment& job, int b, float x, float y, float z) {
  const BoundaryPlanes& boundary = job.boundary;
  const VecF count = load(boundary.count + b);
  if constexpr (kPriority == Priority::count) return count;
  const VecF dx = load(boundary.x + b) - x, dy = load(boundary.y + b) - y,
             dz = load(boundary.z + b) - z;
  VecF weight;
  if constexpr (kPriority == Priority::square) {
    weight = 1.0f / squared_length(dx, dy, dz);
  } else if constexpr (kPriority == Priority::gaussian) {
    weight = gaussian_weight(squared_length(dx, dy, dz), job.doublings_per_square);
  } else {
    weight = 1.0f / sqrt(squared_length(dx, dy, dz));
    if constexpr (kPriority == Priority::agreement) {
      weight = agreement_weight(
          load(boundary.nx + b) * dx + load(boundary.ny + b) * dy + load(boundary.nz + b) * dz,
          weight);
    }
  }
  return select(count > 0.0f, weight, VecF{});
}

template <Priority kPriority, bool kWithPresence>
MeasureSums average_planes(const PlaneAssignment& job, int group) {
  const SphereClusters& c = *job.clusters;
  const BoundaryPlanes& boundary = job.boundary;
  MeasureSums sums;
  const int first = group * SphereClusters::kClustersPerGroup;
  const int last = std::min(first + SphereClusters::kClustersPerGroup, c.num_clusters());
  for (int cluster = first; cluster < last; ++cluster) {
    const std::size_t begin = static_cast<std::size_t>(cluster) * SphereClusters::kSize;
    const Cluster& ball = c.clusters[static_cast<std::size_t>(cluster)];
    // A cluster in front of every plane adds nothing.
    bool reached = false;
    for (int b = 0; b < boundary.num && !reached; b += kLanes) {
      const VecF distance = load(boundary.nx + b) * ball.center.x +
                            load(boundary.ny + b) * ball.center.y +
                            load(boundary.nz + b) * ball.center.z - load(boundary.offset + b);
      const VecF limit = splat(reach_with_slack(ball));
      reached = mask_bits((distance < limit) & (load(boundary.count + b) > 0.0f)) != 0;
    }
    if (!reached) {
      std::fill_n(job.assigned_volume + begin, SphereClusters::kSize, 0.0f);
      continue;
    }
    for (std::size_t slot = begin; slot < begin + SphereClusters::kSize; ++slot) {
      job.assigned_volume[slot] = 0;
      if (job.touched[slot] != PlaneAssignment::kNone || c.sphere_id[slot] < 0) continue;
      const float x = c.x[slot], y = c.y[slot], z = c.z[slot];
      const VecF radius = splat(c.radius[slot]);
      RowSums weight_sum, volume_sum, force[3];
      for (int row = 0; row < boundary.num; row += kRow) {
#pragma GCC unroll 4
        for (int part = 0; part < RowSums::kParts; ++part) {
          const int b = row + part * kLanes;
          VecF weight = weights_of<kPriority>(job, b, x, y, z);
          if (kWithPresence) weight *= load(boundary.presence + b);
          const VecF nx = load(boundary.nx + b), ny = load(boundary.ny + b),
                     nz = load(boundary.nz + b);
          const VecF weighted_volume =
              weight * cap_volume_v(radius, nx * x + ny * y + nz * z - load(boundary.offset + b));
          weight_sum.add(part, weight);
          volume_sum.add(part, weighted_volume);
          force[0].add(part, weighted_volume * nx);
          force[1].add(part, weighted_volume * ny);
          force[2].add(part, weighted_volume * nz);
        }
      }
      const double scale = static_cast<double>(job.volume_scale[slot]) * (1.0 / weight_sum.total());
      const double volume = volume_sum.total() * scale;
      if (!(volume > 0)) continue;
      const Vec3d F{force[0].total() * scale, force[1].total() * scale, force[2].total() * scale};
      const Vec3d arm = Vec3d{x, y, z} - job.origin;
      job.assigned_volume[slot] = static_cast<float>(volume);
      sums.volume += volume;
      sums.force += F;
      sums.torque += cross(arm, F);
      ++sums.num_inside;
    }
  }
  return sums;
}

template <Priority kPriority>
MeasureSums average_planes(const PlaneAssignment& job, int group) {
  return job.boundary.presence == nullptr ? average_planes<kPriority, false>(job, group)
                                          : average_planes<kPriority, true>(job, group);
}

}  // namespace

MeasureSums assign_nearest(const PlaneAssignment& job, int group, AssignmentScratch& scratch) {
  const SphereClusters& c = *job.clusters;
  const BoundaryPlanes& boundary = job.boundary;
  MeasureSums sums;
  Candidates& of_cluster = scratch.of_cluster;
  const Cluster& group_box = c.groups[static_cast<std::size_t>(group)];
  const CandidateList donors{job.num_donors, boundary.x + job.first_donor,
                             boundary.y + job.first_donor, boundary.z + job.first_donor,
                             job.numbers + job.first_donor};
  prune_candidates(donors, group_box, scratch.of_group);
  const int first = group * SphereClusters::kClustersPerGroup;
  const int last = std::min(first + SphereClusters::kClustersPerGroup, c.num_clusters());
  if (!is_reached(boundary, scratch.of_group, group_box)) {
    leave_outside(job, first, last);
    return sums;
  }
  for (int cluster = first; cluster < last; ++cluster) {
    const Cluster& box = c.clusters[static_cast<std::size_t>(cluster)];
    prune_candidates(list_of(scratch.of_group), box, of_cluster);
    if (!is_reached(boundary, of_cluster, box)) {
      leave_outside(job, cluster, cluster + 1);
      continue;
    }
    RowSums volume_sum, force[3], torque[3];
    const std::size_t begin = static_cast<std::size_t>(cluster) * SphereClusters::kSize;
    for (int i = 0; i < SphereClusters::kSize; i += kLanes) {
      const std::size_t slot = begin + static_cast<std::size_t>(i);
      const int part = i % kRow / kLanes;
      VecI wants;
      std::memcpy(&wants, job.touched + slot, sizeof wants);
      wants = wants == PlaneAssignment::kNone;
      const VecI donor = nearest_candidates(job, slot, of_cluster);
      std::memcpy(job.donor + slot, &donor, sizeof donor);

      const VecF x = load(&c.x[slot]), y = load(&c.y[slot]), z = load(&c.z[slot]);
      const VecF radius = load(&c.radius[slot]);
      const VecF nx = gather(boundary.nx, donor), ny = gather(boundary.ny, donor),
                 nz = gather(boundary.nz, donor);
      const VecF distance = nx * x + ny * y + nz * z - gather(boundary.offset, donor);
      // Spheres wholly behind or in front of the plane; those it cuts are computed in double.
      const VecF unsure = cut_distance(x, y, z, radius);
      VecF volume = select(wants & (distance < 0.0f), load(&c.volume[slot]), VecF{});
      const VecI cut = wants & (distance < unsure) & (distance > -unsure);
      for (std::uint32_t bits = mask_bits(cut); bits != 0; bits &= bits - 1) {
        const int lane = std::countr_zero(bits);
        volume[lane] = static_cast<float>(
            exact_volume(job, c.sphere_id[slot + static_cast<std::size_t>(lane)], donor[lane]));
      }
      volume *= load(job.volume_scale + slot);
      store(job.assigned_volume + slot, volume);
      sums.num_inside += std::popcount(mask_bits(volume > 0.0f));

      const VecF fx = volume * nx, fy = volume * ny, fz = volume * nz;
      const VecF ax = x - static_cast<float>(job.origin.x),
                 ay = y - static_cast<float>(job.origin.y),
                 az = z - static_cast<float>(job.origin.z);
      volume_sum.add(part, volume);
      force[0].add(part, fx);
      force[1].add(part, fy);
      force[2].add(part, fz);
      torque[0].add(part, ay * fz - az * fy);
      torque[1].add(part, az * fx - ax * fz);
      torque[2].add(part, ax * fy - ay * fx);
    }
    sums.volume += volume_sum.total();
    for (int axis = 0; axis < 3; ++axis) {
      sums.force[axis] += force[axis].total();
      sums.torque[axis] += torque[axis].total();
    }
  }
  return sums;
}

MeasureSums assign_weighted(const PlaneAssignment& job, int group) {
  switch (job.priority) {
    case Priority::count: return average_planes<Priority::count>(job, group);
    case Priority::square: return average_planes<Priority::square>(job, group);
    case Priority::gaussian: return average_planes<Priority::gaussian>(job, group);
    case Priority::agreement: return average_planes<Priority::agreement>(job, group);
    case Priority::path:
    case Priority::distance: break;
  }
  return average_planes<Priority::distance>(job, group);
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
