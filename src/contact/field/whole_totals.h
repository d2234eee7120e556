// Sums of the clusters of a group that count as one ball each (whole_cluster.h), wholly or for a
// share. Included by kernel files only.
#pragma once

#include "src/contact/field/group_totals.h"
#include "src/contact/internal/hull_rules.h"
#include "src/contact/internal/whole_cluster.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

inline constexpr int kNumClusters = SphereClusters::kClustersPerGroup;
inline constexpr int kNumWholes = kNumClusters / kLanes;  // vectors of a group

/// The clusters of one group as balls, against one field.
template <bool kWithStiffness>
class Wholes {
 public:
  /// Takes vector i of the balls, with their field in W; those that do not touch have no share.
  [[gnu::always_inline]] void take(const MeasureJob& job, int group, int i, const Lanes& e,
                                   VecI is_touching, const SpaceCurvature<VecF>& field,
                                   const NoisePlace& place) {
    const std::size_t slot = first_of_group(group) + static_cast<std::size_t>(i * kLanes);
    Ball& ball = balls_[i];
    ball.share =
        whole_share(select(is_touching, field.first.phi, VecF{}), load(job.whole_depth + slot));
    store(&share_[i * kLanes], ball.share.value);  // kept if it is more than 0
    if (mask_bits(ball.share.value > VecF{}) == 0) return;
    any_ = true;
    ball.lanes = e;
    ball.field = field;
    ball.place = place;
  }

  /// Returns the share of the ball of a cluster, by its number in the group.
  float share(int cluster) const { return share_[cluster]; }
  const float* shares() const { return share_; }

  /// Adds the elements of a cluster to those of the group, by what is not the ball's.
  void add(int cluster, const GroupTotals<kWithStiffness>& elements,
           GroupTotals<kWithStiffness>& group) {
    const Totals& t = elements.totals;
    const RowSums* const sums[] = {&t.potential, &t.fx, &t.fy, &t.fz, &t.tx, &t.ty, &t.tz};
    for (int k = 0; k < kNumKept; ++k) {
      kept_[k][cluster] = static_cast<float>(sums[k]->total());
    }
    group.add(elements, 1.0f - share_[cluster]);
  }

  /// Adds the balls.
  void add_to(const MeasureJob& job, int group, GroupTotals<kWithStiffness>& to) const {
    if (!any_) return;
    for (int i = 0; i < kNumWholes; ++i) {
      if (mask_bits(balls_[i].share.value > VecF{}) == 0) continue;
      add_to(job, first_of_group(group) + static_cast<std::size_t>(i * kLanes), i, to);
    }
  }

 private:
  static constexpr int kNumKept = 7;  // potential, force and torque of elements
  struct Ball {
    Lanes lanes;
    SpaceCurvature<VecF> field;
    NoisePlace place;
    Curved<VecF> share;
  };

  static std::size_t first_of_group(int group) {
    return static_cast<std::size_t>(group) * kNumClusters;
  }

  [[gnu::noinline]] void add_to(const MeasureJob& job, std::size_t slot, int i,
                                GroupTotals<kWithStiffness>& to) const {
    const ElementRows& rows = job.wholes;
    const Ball& ball = balls_[i];
    const Lanes& e = ball.lanes;
    const VecI counts = ball.share.value > VecF{};
    const VecF phi = select(counts, ball.field.first.phi, VecF{});
    const Gradient3<VecF> n{select(counts, ball.field.first.x, VecF{}),
                            select(counts, ball.field.first.y, VecF{}),
                            select(counts, ball.field.first.z, VecF{})};
    const VecF all = whole_volume(rows, slot, e.radius);
    const auto kept = [&](int k) { return load(&kept_[k][i * kLanes]); };
    const WholeTerms<VecF> terms = whole_terms(ball.share, all, phi, kept(0));
    const VecF length = length_of(n);
    const Gradient3<VecF> shortened = bounded(n, length);
    const int part = i % RowSums::kParts;
    to.totals.add(part, e, terms.volume, terms.potential, terms.push, shortened);
    to.totals.inside.add(part,
                         select(ball.share.value < splat(1.0f), VecF{}, load(rows.counted + slot)));
    const VecF polar = load(job.whole_polar + slot);
    // The volume of a ball that lies deep does not change.
    if (to.noise != nullptr) to.noise->keep(e, ball.place, terms.volume, VecF{}, shortened);
    if constexpr (kWithStiffness) {
      const Gradient3<VecF> l{e.lx, e.ly, e.lz};
      Symmetric<VecF> h{};
      const auto take = [&](VecF Symmetric<VecF>::*entry) {
        h.*entry = select(counts, ball.field.h.*entry, VecF{});
      };
      for (const auto entry : {&Symmetric<VecF>::xx, &Symmetric<VecF>::xy, &Symmetric<VecF>::xz,
                               &Symmetric<VecF>::yy, &Symmetric<VecF>::yz, &Symmetric<VecF>::zz}) {
        take(entry);
      }
      VecF numbers[StiffnessSums::kNum];
      stiffness_terms<VecF>(l, terms.push, terms.disc, ball.share.value * polar, shortened,
                            bounded(h, n, length), numbers);
      const VecF J[6] = {shortened.x,
                         shortened.y,
                         shortened.z,
                         l.y * shortened.z - l.z * shortened.y,
                         l.z * shortened.x - l.x * shortened.z,
                         l.x * shortened.y - l.y * shortened.x};
      const VecF W[6] = {kept(1), kept(2), kept(3), kept(4), kept(5), kept(6)};
      add_exchange(ball.share.slope, J, W, numbers);
      for (int k = 0; k < StiffnessSums::kNum; ++k) to.numbers[k].add(part, numbers[k]);
    }
  }

  Ball balls_[kNumWholes];
  alignas(64) float share_[kNumClusters] = {};
  alignas(64) float kept_[kNumKept][kNumClusters] = {};
  bool any_ = false;
};

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
