// Sums over the elements of a group and their cuts, as many at once as a vector has lanes. Included
// by kernel files only.
#pragma once

#include "src/contact/noise/noise_lanes.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

// Sums of one group.
struct Totals {
  RowSums volume, potential, fx, fy, fz, tx, ty, tz, boundary, inside;

  /// Adds volumes, energies and forces of a vector of elements; the force is `push` n.
  template <class Element>
  [[gnu::always_inline]] void add(int part, const Element& e, VecF volume_of, VecF potential_of,
                                  VecF push, const Gradient3<VecF>& n) {
    const VecF x = push * n.x, y = push * n.y, z = push * n.z;
    volume.add(part, volume_of);
    potential.add(part, potential_of);
    fx.add(part, x);
    fy.add(part, y);
    fz.add(part, z);
    tx.add(part, e.ly * z - e.lz * y);
    ty.add(part, e.lz * x - e.lx * z);
    tz.add(part, e.lx * y - e.ly * x);
  }

  /// Adds a share of other sums, and all that they count.
  void add(const Totals& other, float share) {
    using Sums = RowSums Totals::*;
    for (const Sums sums : {&Totals::volume, &Totals::potential, &Totals::fx, &Totals::fy,
                            &Totals::fz, &Totals::tx, &Totals::ty, &Totals::tz}) {
      add_share(other.*sums, share, this->*sums);
    }
    add_share(other.boundary, 1, boundary);
    add_share(other.inside, 1, inside);
  }
  static void add_share(const RowSums& from, float share, RowSums& to) {
    for (int part = 0; part < RowSums::kParts; ++part) to.add(part, share * from.lanes[part]);
  }

  FieldSums sums() const {
    return {volume.total(),
            potential.total(),
            {fx.total(), fy.total(), fz.total()},
            {tx.total(), ty.total(), tz.total()},
            boundary.total(),
            inside.total()};
  }
};

[[gnu::always_inline]] inline VecF length_of(const Gradient3<VecF>& n) {
  return sqrt(n.x * n.x + n.y * n.y + n.z * n.z);
}

// Adds volumes, energies and forces of a vector of elements.
template <class Rows, class Element>
[[gnu::always_inline]] inline void add_measure(const Rows& rows, std::size_t slot, const Element& e,
                                               VecF phi, const CutBall<VecF>& cut,
                                               const Gradient3<VecF>& n, int part, Totals& totals) {
  totals.add(part, e, cut.volume, cut.potential, cut.volume, n);
  const VecF counted = load(rows.counted + slot);
  const VecI is_inside = phi <= -e.radius;
  totals.inside.add(part, select(is_inside, counted, VecF{}));
  totals.boundary.add(part, select((phi < e.radius) & ~is_inside, counted, VecF{}));
}

/// Sums of one group, with those of the stiffness if it is requested.
template <bool kWithStiffness>
struct GroupTotals {
  Totals totals;
  RowSums numbers[kWithStiffness ? StiffnessSums::kNum : 1];
  NoiseWriter* noise = nullptr;  // null: nobody asked
  NoisePlace place;              // of the next vector, if somebody did
  float share = 1;               // of the noise that is kept

  /// Adds a vector of elements, of which some touch the surface: there the field is `phi`, with
  /// this gradient and these second derivatives in W.
  template <class Rows, class Element>
  [[gnu::always_inline]] void add(const Rows& rows, std::size_t slot, const Element& e,
                                  VecI is_touching, VecF field, const Gradient3<VecF>& n,
                                  const Symmetric<VecF>& h, int part) {
    const VecF phi = select(is_touching, field, e.radius);
    const VecF factor = load(rows.factor + slot);
    const CutBall<VecF> cut = cut_ball(e.radius, factor, phi);
    add(rows, slot, e, phi, cut, palpate::cut_area(e.radius, factor, phi), n, h, part);
  }

  /// Adds a vector of elements whose volumes shrink by `disc` phi.
  template <class Rows, class Element>
  [[gnu::always_inline]] void add(const Rows& rows, std::size_t slot, const Element& e, VecF phi,
                                  const CutBall<VecF>& cut, VecF disc, const Gradient3<VecF>& n,
                                  const Symmetric<VecF>& h, int part) {
    const VecF length = length_of(n);
    const Gradient3<VecF> shortened = bounded(n, length);
    add_measure(rows, slot, e, phi, cut, shortened, part, totals);
    if (noise != nullptr) noise->keep(e, place, share * cut.volume, share * disc, shortened);
    if constexpr (kWithStiffness) {
      const VecF factor = load(rows.factor + slot);
      VecF terms[StiffnessSums::kNum];
      stiffness_terms<VecF>({e.lx, e.ly, e.lz}, cut.volume, disc,
                            polar_moment<VecF>(e.radius, factor, phi), shortened,
                            bounded(h, n, length), terms);
      for (int i = 0; i < StiffnessSums::kNum; ++i) numbers[i].add(part, terms[i]);
    }
  }

  /// Adds a share of the elements of a cluster.
  void add(const GroupTotals& elements, float of_them) {
    totals.add(elements.totals, of_them);
    for (int i = 0; kWithStiffness && i < StiffnessSums::kNum; ++i) {
      Totals::add_share(elements.numbers[i], of_them, numbers[i]);
    }
  }

  void write(GroupSums& to) const {
    to.measure = totals.sums();
    if constexpr (kWithStiffness) {
      for (int i = 0; i < StiffnessSums::kNum; ++i) to.stiffness.numbers[i] = numbers[i].total();
    }
  }
};

/// Marks the spheres of a vector of elements that are unseen.
inline void mark_unseen(const MeasureJob& job, std::size_t first, VecI is_unseen,
                        std::uint8_t* spheres) {
  if (spheres == nullptr) return;
  const VecI is_counted = is_unseen & (load(job.elements.counted + first) > VecF{});
  for (std::uint32_t bits = mask_bits(is_counted); bits != 0; bits &= bits - 1) {
    const auto slot = first + static_cast<std::size_t>(__builtin_ctz(bits));
    spheres[job.clusters->sphere_id[slot]] = 1;
  }
}

/// Volume of elements that are wholly inside, m3.
[[gnu::always_inline]] inline VecF whole_volume(const ElementRows& rows, std::size_t slot,
                                                VecF radius) {
  return load(rows.factor + slot) * (static_cast<float>(4 * kPi / 3) * radius * radius * radius);
}

/// Writes the cuts of the spheres of a vector of elements that touch a surface: at `phi` from their
/// centers, with the gradient n in W, as one of several cameras decided.
inline void describe(const MeasureJob& job, std::size_t first, const Lanes& e, VecI is_touching,
                     VecF phi, const Gradient3<VecF>& n, const SphereCuts& to,
                     VecI decider = VecI{}) {
  const SphereClusters& clusters = *job.clusters;
  const VecF length = max(length_of(n), splat(1e-20f));
  const VecF c_C[3] = {load(&clusters.x[first]), load(&clusters.y[first]),
                       load(&clusters.z[first])};
  VecF along = -phi, n_T[3];
  for (int axis = 0; axis < 3; ++axis) {
    const auto& R_WT = job.frame.R_WT;
    n_T[axis] = (R_WT[0][axis] * n.x + R_WT[1][axis] * n.y + R_WT[2][axis] * n.z) / length;
    along += n_T[axis] * (c_C[axis] + to.p_TC[axis]);
  }
  const VecI is_counted = is_touching & (load(job.elements.counted + first) > VecF{});
  for (std::uint32_t bits = mask_bits(is_counted); bits != 0; bits &= bits - 1) {
    const int lane = __builtin_ctz(bits);
    // An element that is counted has the number of its sphere.
    const auto id =
        static_cast<std::size_t>(clusters.sphere_id[first + static_cast<std::size_t>(lane)]);
    if (to.states != nullptr) {
      to.states[id] = phi[lane] > -e.radius[lane] ? SphereState::boundary : SphereState::inside;
    }
    if (to.planes != nullptr) {
      to.planes[id] = {{n_T[0][lane], n_T[1][lane], n_T[2][lane]}, along[lane]};
    }
    if (to.deciders != nullptr) to.deciders[id] = static_cast<std::int8_t>(decider[lane]);
  }
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
