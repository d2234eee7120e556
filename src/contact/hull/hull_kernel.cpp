// Elements against the depth hull of several cameras, compiled once per instruction set.
// hull_eyes.h has the samples of one camera, hull_joins.h the order in which they are joined,
// hull_rules.h the formulas.
//
// Words of the hull, in all its files. The *moments* of a camera are the one or two frames that it
// is blended from: 0 is the newer one, 1 the older one, and `moments[f]` is a value at moment f. A
// *seat* is the pose of the tool in the camera: both moments share seat 0, unless the camera has
// moved between them; then moment f has seat f. The *eye* is the point from which a camera sees,
// and `before` the distance of an element before it, less kMinDepth: where that is not positive,
// the camera sees nothing. `Eye` and HullEye are a whole camera, ready to be sampled. At each
// moment a camera has up to four fields (SurfaceView), signed distances to surfaces. `field` is
// that of the surfaces that it shows, with unmeasured space as UnknownSpace has it. *Seen free* is
// the space of which the camera has measured that nothing is there; `seen_free` is positive in it
// only. *Remembered* is the same of space that is hidden now, as the camera saw it last. A key
// frame, seen from an earlier pose, has only this one and `field`. *In front* are surfaces that
// hide something: inside them, down to their thickness, nothing remembered counts. With several
// cameras these are all surfaces that each one sees now; of a camera that `is_alone` they are those
// that have come before the remembered background, which is then its `field` and stands for
// `seen_free`, too. A camera is *seeing* if it is not a key frame, and *may see* if some of the
// tool may be in its image. Elements in a ball are *seen free* if one camera sees all of them well
// in front of everything. An element is *unseen* if it is more than kSeenBehind deep in space
// neither seen free nor remembered.
#include <algorithm>
#include <cstddef>
#include <new>
#include <type_traits>

#include "src/contact/field/ball_totals.h"
#include "src/contact/field/whole_totals.h"
#include "src/contact/hull/depth_hull.h"
#include "src/contact/hull/hull_joins.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {
namespace {

/// Calls begin(hull, grid, bounds), then f(slot, elements in the world, hull, number in the
/// cluster) for vectors of elements unless a camera sees that all are free, or begin has left their
/// cluster out of `requested`, and end(cluster) after the vectors of a cluster if it was called for
/// any of them.
template <class Sample, class Begin, class F, class End>
[[gnu::always_inline]] inline void for_each_touching(const HullJob& job, int group,
                                                     std::uint32_t& requested, const Begin& begin,
                                                     const F& f, const End& end) {
  const HullCamera *const cameras = job.cameras, *const seeing_end = cameras + job.num_seeing;
  const auto first_seeing =
      std::find_if(cameras, seeing_end, [](const HullCamera& camera) { return camera.may_see(); });
  int freed_by = first_seeing == seeing_end ? 0 : static_cast<int>(first_seeing - cameras);
  const SphereClusters& clusters = *job.tool.clusters;
  const int first = group * SphereClusters::kClustersPerGroup;
  const int last = std::min(first + SphereClusters::kClustersPerGroup, clusters.num_clusters());
  const float largest =
      *std::max_element(job.tool.largest_radius + first, job.tool.largest_radius + last);
  Bounds bounds;
  if (is_seen_free(job, clusters.groups[static_cast<std::size_t>(group)], largest, freed_by,
                   bounds)) {
    return;
  }
  alignas(Eye) std::byte memory[kMaxCameras * sizeof(Eye)];
  Eye* const eyes = reinterpret_cast<Eye*>(memory);
  for (int k = 0; k < job.num_cameras; ++k) new (eyes + k) Eye(job.cameras[k], job.has_memory);
  Hull<Sample> hull(job, eyes, freed_by);
  begin(hull, eyes[0].field.grid, bounds);
  const auto slot_of = [](int cluster) { return static_cast<std::size_t>(cluster * kSize); };
  const auto is_open = [&](int cluster) {
    return (requested >> (cluster - first) & 1) != 0 &&
           !is_seen_free(job, clusters.clusters[static_cast<std::size_t>(cluster)],
                         job.tool.largest_radius[cluster], freed_by, bounds);
  };
  const auto tell = [&](int cluster, std::uint32_t touching) {
    for_each(touching, [&](int i) {
      const std::size_t slot = slot_of(cluster) + static_cast<std::size_t>(i * kLanes);
      f(slot, aim(job.tool.elements, job.tool.frame, eyes[0].field.grid, slot), hull, i);
    });
    if (touching != 0) end(cluster);
  };
  hull.announce(job.tool.elements);
  const int apart = hull.may_pack() ? std::clamp(job.tool.first_ball, first, last) : first;
  if (apart > first) {
    hull.begin(slot_of(first));
    for (int cluster = first; cluster < apart; ++cluster) {
      if (!is_open(cluster)) continue;
      for (int i = 0; i < kNumVectors; ++i) {
        const std::size_t slot = slot_of(cluster) + static_cast<std::size_t>(i * kLanes);
        hull.add(slot, load(job.tool.elements.radius + slot), bounds);
      }
    }
    hull.evaluate_added();
    for (int cluster = first; cluster < apart; ++cluster) {
      tell(cluster, hull.take(slot_of(cluster), kNumVectors));
    }
  }
  for (int cluster = apart; cluster < last; ++cluster) {
    if (!is_open(cluster)) continue;
    hull.aim_at(clusters.clusters[static_cast<std::size_t>(cluster)],
                job.tool.largest_radius[cluster]);
    tell(cluster, hull.evaluate(slot_of(cluster), cluster >= job.tool.first_ball, kNumVectors));
  }
}

/// Evaluates the clusters from `first` on as one ball each. Returns bits of the vectors that may
/// lie deep.
template <class Sample>
std::uint32_t query_wholes(const HullJob& job, int first, const Bounds& bounds, Hull<Sample>& at) {
  const ElementRows& wholes = job.tool.wholes;
  const auto slot = static_cast<std::size_t>(first);
  at.announce(wholes);
  if (at.may_pack()) {
    const bool is_between = std::any_of(job.cameras, job.cameras + job.num_seeing,
                                        [](const HullCamera& k) { return k.field.num_fields > 1; });
    at.begin(slot);
    for (int i = 0; i < kNumClusters; i += kLanes) {
      const std::size_t here = slot + static_cast<std::size_t>(i);
      const VecF radius = load(wholes.radius + here);
      // Nothing counts above -depth, unless wider pixels may still lower the value of a moment.
      const VecF deep = max(-load(job.tool.whole_depth + here), -deep_limit(radius));
      at.add(here, is_between ? radius : deep, bounds);
    }
    at.evaluate_added();
    return at.take(slot, kNumWholes);
  }
  at.aim_at(job.tool.clusters->groups[slot / kNumClusters],
            *std::max_element(wholes.radius + first, wholes.radius + first + kNumClusters));
  return at.evaluate(slot, false, kNumWholes);
}

template <class Sample>
[[gnu::always_inline]] inline void measure(const HullJob& job, int group, GroupSums* to) {
  constexpr bool kWithStiffness = std::is_same_v<Sample, Curvature>;
  GroupTotals<kWithStiffness> totals, blended;
  NoiseWriter noise(job.tool.noise, group);
  if (noise.wants()) totals.noise = &noise;
  RowSums unseen;
  Wholes<kWithStiffness> wholes;
  BallSamples parts;  // of the current ball in parts
  std::uint32_t known = 0, requested = (1u << kNumClusters) - 1;
  const int first = group * kNumClusters;
  const auto field_at = [](const Hull<Sample>& at, int i) {
    return SpaceCurvature<VecF>{first_of(at.joined[i].hull), second_of(at.joined[i].hull)};
  };
  const auto place_of = [&](Hull<Sample>& at, int i) {
    return noise.wants() ? at.place(i) : NoisePlace{};
  };
  for_each_touching<Sample>(
      job, group, requested,
      [&](Hull<Sample>& at, const Grid& grid, const Bounds& bounds) {
        if (job.tool.first_ball < kMinWholes) return;
        const std::uint32_t near = query_wholes(job, first, bounds, at);
        for (int i = 0; i < kNumWholes; ++i) {
          const auto slot = static_cast<std::size_t>(first + i * kLanes);
          const bool is_near = (near >> i & 1) != 0;
          const Lanes e = aim(job.tool.wholes, job.tool.frame, grid, slot);
          const SpaceCurvature<VecF> field = is_near ? field_at(at, i) : SpaceCurvature<VecF>{};
          wholes.take(job.tool, group, i, e, field.first.phi < e.radius, field,
                      is_near ? place_of(at, i) : NoisePlace{});
          const VecF share = load(wholes.shares() + i * kLanes);
          if (!is_near || mask_bits(share > VecF{}) == 0) continue;
          unseen.add(i % RowSums::kParts,
                     select(at.joined[i].is_unseen(),
                            share * whole_volume(job.tool.wholes, slot, e.radius), VecF{}));
        }
        for (int number = 0; number < kNumClusters; ++number) {
          if (wholes.share(number) >= 1) requested &= ~(1u << number);
        }
      },
      [&](std::size_t slot, const Lanes& e, Hull<Sample>& at, int i) {
        const int part = i % RowSums::kParts;
        const int cluster = static_cast<int>(slot / kSize);
        const float share = wholes.share(cluster - first);
        const SpaceCurvature<VecF> field = field_at(at, i);
        const SpaceGradient<VecF>& g = field.first;
        unseen.add(
            part, select(at.joined[i].is_unseen(),
                         (1.0f - share) * whole_volume(job.tool.elements, slot, e.radius), VecF{}));
        if (cluster < job.tool.first_ball) {
          GroupTotals<kWithStiffness>& sums = share > 0 ? blended : totals;
          if (share > 0 && known == 0) {
            blended = GroupTotals<kWithStiffness>{};
            blended.noise = totals.noise;
            blended.share = 1.0f - share;
            known = 1;
          }
          sums.place = place_of(at, i);
          sums.add(job.tool.elements, slot, e, g.phi < e.radius, g.phi, {g.x, g.y, g.z}, field.h,
                   part);
          return;
        }
        parts.lanes[i] = e;
        parts.is_touching[i] = g.phi < e.radius;
        parts.field[i] = field;
        parts.place[i] = place_of(at, i);
        parts.is_complete &= at.is_complete(i);
      },
      [&](int cluster) {
        if (cluster < job.tool.first_ball) {
          if (known != 0) wholes.add(cluster - first, blended, totals);
          known = 0;
          return;
        }
        const std::size_t begin = static_cast<std::size_t>(cluster) * kSize;
        add_ball(job.tool, begin, parts, totals);
        parts.is_complete = true;
      });
  wholes.add_to(job.tool, group, totals);
  noise.finish();
  totals.write(*to);
  to->measure.unseen = unseen.total();
}

}  // namespace

void measure_hull_group(const HullJob& job, int group, bool with_stiffness, GroupSums* sums) {
  if (with_stiffness) return measure<Curvature>(job, group, sums);
  measure<Gradient>(job, group, sums);
}

void describe_hull_group(const HullJob& job, int group, const SphereCuts& to) {
  std::uint32_t requested = (1u << kNumClusters) - 1;
  for_each_touching<Gradient>(
      job, group, requested, [](Hull<Gradient>&, const Grid&, const Bounds&) {},
      [&](std::size_t slot, const Lanes& e, Hull<Gradient>& at, int i) {
        const auto& joined = at.joined[i];
        const SpaceGradient<VecF>& g = joined.hull;
        const VecI nobody = joined.decider < VecI{};
        VecI number{};
        for (int k = 0; k < job.num_cameras; ++k) {
          number = joined.decider == splat(k) ? splat(job.cameras[k].number) : number;
        }
        describe(job.tool, slot, e, g.phi < e.radius, g.phi, {g.x, g.y, g.z}, to,
                 nobody ? splat(kNoCamera) : number);
        mark_unseen(job.tool, slot, joined.is_unseen(), to.unseen);
      },
      [](int) {});
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
