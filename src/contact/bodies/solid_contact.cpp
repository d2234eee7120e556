#include "src/contact/bodies/solid_contact.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "src/contact/bodies/body_pair.h"
#include "src/core/select_isa.h"

namespace palpate::inline v0 {
PALPATE_DECLARE_KERNELS(void measure_solid_group(const SolidJob&, int group, bool with_stiffness,
                                                 GroupSums* sums);
                        constexpr SolidContactKernels kSolidContact{measure_solid_group};)

namespace {

constexpr SolidContactKernels kKernels[] = PALPATE_BY_ISA(kSolidContact);

// A way of asking that would count less is not worth its time.
constexpr double kLeastWeight = 0.05;

void copy(const Mat3d& from, float (&to)[3][3]) {
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      to[row][column] = static_cast<float>(from.m[row][column]);
    }
  }
}

/// The elements of a body E to the field of a body F.
SolidFrame frame_of(const Pose& X_WE, const Vec3d& centre_E, const Pose& X_WF,
                    const SolidField& field) {
  const Pose X_FE = relative_pose(X_WF, X_WE);
  SolidFrame frame;
  copy(rotation_matrix(X_FE.rotation), frame.R_FE);
  copy(rotation_matrix(normalized(X_WE.rotation)), frame.R_WE);
  copy(rotation_matrix(normalized(X_WF.rotation)), frame.R_WF);
  const Vec3d p_F = X_FE * centre_E - field.layout().origin;
  for (int axis = 0; axis < 3; ++axis) frame.p_FC[axis] = static_cast<float>(p_F[axis]);
  return frame;
}

SolidJob job_of(const FieldElements& elements, const SolidAsking& asking, const SolidField& field) {
  return {
      &elements.clusters,  elements.radius.data(), elements.factor.data(), elements.counted.data(),
      asking.level.data(), asking.rounding.data(), view_of(field),         {}};
}

Vec3d times(const Stiffness& k, int first_row, const Vec3d& shift, const Vec3d& turn) {
  Vec3d sum;
  for (int row = 0; row < 3; ++row) {
    const double(&m)[6] = k.m[first_row + row];
    sum[row] = m[0] * shift.x + m[1] * shift.y + m[2] * shift.z + m[3] * turn.x + m[4] * turn.y +
               m[5] * turn.z;
  }
  return sum;
}

/// From how the wrench (about its centre C_E) on a body E changes with its own pose, how that on
/// the other body F, about C_F, changes with F's: moving F is moving both, which turns all wrenches
/// along, and E back. `d` is from C_F to C_E.
Stiffness of_other(const Stiffness& k, const VolumeWrench& on_e, const Vec3d& d) {
  Stiffness other;
  for (int column = 0; column < 6; ++column) {
    Vec3d shift, turn;
    (column < 3 ? shift : turn)[column % 3] = 1;
    const Vec3d shift_e = shift + cross(turn, d);
    const Vec3d force = cross(turn, on_e.force) + times(k, 0, shift_e, turn);
    const Vec3d torque = cross(turn, on_e.torque) + times(k, 3, shift_e, turn);
    const Vec3d torque_f = torque + cross(d, force) - cross(shift, on_e.force);
    for (int row = 0; row < 3; ++row) {
      other.m[row][column] = force[row];
      other.m[row + 3][column] = torque_f[row];
    }
  }
  return other;
}

/// From the moments of the force on body F about its own centre, those of the opposite forces about
/// another point, from which F's centre lies `d` away.
VolumeMoments of_opposite(const VolumeMoments& f, const Vec3d& force, const Vec3d& d) {
  VolumeMoments other;
  const Vec3d n = normalized(force);
  Vec3d sum;  // of levers times volumes
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      other.first[row][column] = -(f.first[row][column] + d[row] * force[column]);
      sum[row] += f.first[row][column] * n[column];
    }
  }
  const Vec3d off = cross(d, n);
  other.polar = f.polar + 2 * dot(cross(sum, n), off) + norm(force) * dot(off, off);
  return other;
}

VolumeMoments sum_of(const VolumeMoments& a, double weight_a, const VolumeMoments& b,
                     double weight_b) {
  VolumeMoments sum;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      sum.first[row][column] = weight_a * a.first[row][column] + weight_b * b.first[row][column];
    }
  }
  sum.polar = weight_a * a.polar + weight_b * b.polar;
  return sum;
}

Stiffness sum_of(const Stiffness& a, double weight_a, const Stiffness& b, double weight_b) {
  Stiffness sum;
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column) {
      sum.m[row][column] = weight_a * a.m[row][column] + weight_b * b.m[row][column];
    }
  }
  return sum;
}

}  // namespace

SolidContactKernels solid_contact_kernels(Isa isa) { return select_isa(kKernels, isa); }

SolidFieldView view_of(const SolidField& field) {
  SolidFieldView view;
  view.values = field.values().data();
  view.num_levels = static_cast<std::int32_t>(field.levels().size());
  view.spacing = static_cast<float>(field.layout().spacing);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    view.box[axis] = static_cast<float>(field.layout().spacing * field.layout().num_cells[axis]);
    for (std::size_t k = 0; k < field.levels().size(); ++k) {
      view.num_nodes[axis][k] = field.levels()[k].num_nodes[axis];
    }
  }
  for (std::size_t k = 0; k < field.levels().size(); ++k) {
    view.first[k] = static_cast<std::int32_t>(field.levels()[k].first);
  }
  return view;
}

SolidAsking::SolidAsking(const FieldElements& elements, const SolidField& field)
    : level(elements.radius.size()) {
  const auto last = static_cast<std::int32_t>(field.levels().size()) - 1;
  const double spacing = field.layout().spacing;
  double volume = 0, squares = 0, widest = 0, owed = 0;
  for (std::size_t slot = 0; slot < level.size(); ++slot) {
    const double radius = elements.radius[slot];
    const double counts = elements.factor[slot] * sphere_volume(radius);
    volume += counts;
    squares += counts * radius * radius;
    // Second moments, in those of the finest grid: what the ball has lies between those of two
    // grids, and it asks the one by which all so far have theirs most nearly.
    const double wanted = std::max(1.0, std::pow(kSpacingPerRadius * radius / spacing, 2));
    double moment = 1;
    while (moment * 4 <= wanted && level[slot] < last) {
      moment *= 4;
      ++level[slot];
    }
    const double missing = counts * (wanted - moment), more = counts * 3 * moment;
    if (level[slot] < last) {
      if (owed + missing > more / 2 && counts > 0) {
        ++level[slot];
        owed -= more;
      }
      owed += missing;
    } else if (wanted > 4 * moment && counts > 0) {
      is_possible = false;
    }
    widest = std::max(widest, std::ldexp(spacing, level[slot]));
    if (slot % SphereClusters::kSize == SphereClusters::kSize - 1) {
      rounding.push_back(static_cast<float>(kMostRounding * 1.0001 * widest));
      widest = 0;
    }
  }
  coarseness = squares / volume + spacing * spacing;
}

SolidPair::SolidPair(std::shared_ptr<const ToolIndex> of_a, std::shared_ptr<const ToolIndex> of_b)
    : a(std::move(of_a)),
      b(std::move(of_b)),
      elements_a(&a->parts().solid_elements()),
      elements_b(&b->parts().solid_elements()),
      field_a(&a->parts().solid_field()),
      field_b(&b->parts().solid_field()),
      asking_a(*elements_a, *field_b),
      asking_b(*elements_b, *field_a) {
  const double fine_a = asking_a.is_possible ? std::pow(asking_a.coarseness, -2) : 0;
  const double fine_b = asking_b.is_possible ? std::pow(asking_b.coarseness, -2) : 0;
  const bool asks_a = fine_a >= kLeastWeight * (fine_a + fine_b);
  const bool asks_b = fine_b >= kLeastWeight * (fine_a + fine_b);
  const double sum = (asks_a ? fine_a : 0) + (asks_b ? fine_b : 0);
  weight_a = asks_a ? fine_a / sum : 0;
  weight_b = asks_b ? fine_b / sum : 0;
}

void SolidPair::place(const Pose& X_WA, const Pose& X_WB, SolidFrame& of_a,
                      SolidFrame& of_b) const {
  of_a = frame_of(X_WA, a->tool().sphere_mass().centre_of_mass, X_WB, *field_b);
  of_b = frame_of(X_WB, b->tool().sphere_mass().centre_of_mass, X_WA, *field_a);
}

BodyPenetration SolidPair::penetration(const GroupSums& of_a, const GroupSums& of_b,
                                       bool with_stiffness, const Pose& X_WA,
                                       const Pose& X_WB) const {
  const Pose X_A{X_WA.translation, normalized(X_WA.rotation)};
  const Pose X_B{X_WB.translation, normalized(X_WB.rotation)};
  // From the one centre of mass to the other.
  const Vec3d d_BA =
      X_A * a->tool().sphere_mass().centre_of_mass - X_B * b->tool().sphere_mass().centre_of_mass;
  const VolumeWrench measure_a{of_a.measure.force, of_a.measure.torque};
  const VolumeWrench measure_b{of_b.measure.force, of_b.measure.torque};
  BodyPenetration result;
  result.on_a = of_a.measure.penetration();
  result.on_b = of_b.measure.penetration();
  for (Penetration* part : {&result.on_a, &result.on_b}) {
    part->volume = weight_a * of_a.measure.volume + weight_b * of_b.measure.volume;
    part->potential = weight_a * of_a.measure.potential + weight_b * of_b.measure.potential;
  }
  VolumeWrench &on_a = result.on_a.measure_W, &on_b = result.on_b.measure_W;
  on_a.force = weight_a * measure_a.force - weight_b * measure_b.force;
  on_b.force = -on_a.force;
  on_a.torque =
      weight_a * measure_a.torque - weight_b * (measure_b.torque - cross(d_BA, measure_b.force));
  on_b.torque =
      weight_b * measure_b.torque - weight_a * (measure_a.torque + cross(d_BA, measure_a.force));
  result.num_pairs = std::int64_t{result.on_a.num_boundary_spheres} +
                     result.on_a.num_inside_spheres + result.on_b.num_boundary_spheres +
                     result.on_b.num_inside_spheres;
  if (with_stiffness) {
    const Stiffness k_a = of_a.stiffness.stiffness(), k_b = of_b.stiffness.stiffness();
    result.stiffness_a = sum_of(k_a, weight_a, of_other(k_b, measure_b, -d_BA), weight_b);
    result.stiffness_b = sum_of(k_b, weight_b, of_other(k_a, measure_a, d_BA), weight_a);
    result.moments_a =
        sum_of(of_a.stiffness.moments(), weight_a,
               of_opposite(of_b.stiffness.moments(), measure_b.force, -d_BA), weight_b);
  }
  return result;
}

SolidContact::SolidContact(std::shared_ptr<const ToolIndex> a, std::shared_ptr<const ToolIndex> b,
                           Isa isa)
    : pair_(std::move(a), std::move(b)),
      kernels_(solid_contact_kernels(isa)),
      job_a_(job_of(*pair_.elements_a, pair_.asking_a, *pair_.field_b)),
      job_b_(job_of(*pair_.elements_b, pair_.asking_b, *pair_.field_a)) {}

void SolidContact::start(const Pose& X_WA, const Pose& X_WB, bool wants_stiffness) noexcept {
  X_WA_ = X_WA;
  X_WB_ = X_WB;
  wants_stiffness_ = wants_stiffness;
}

BodyPenetration SolidContact::finish() noexcept {
  if (BodyPenetration nothing; is_non_finite(X_WA_, X_WB_, nothing)) return nothing;
  pair_.place(X_WA_, X_WB_, job_a_.frame, job_b_.frame);
  return pair_.penetration(sums_of(job_a_, pair_.weight_a), sums_of(job_b_, pair_.weight_b),
                           wants_stiffness_, X_WA_, X_WB_);
}

GroupSums SolidContact::sums_of(const SolidJob& job, double weight) const {
  GroupSums all;
  if (weight == 0) return all;
  for (int group = 0; group < job.clusters->num_groups(); ++group) {
    GroupSums sums;
    kernels_.measure_solid_group(job, group, wants_stiffness_, &sums);
    all.measure.add(sums.measure);
    if (wants_stiffness_) all.stiffness.add(sums.stiffness);
  }
  return all;
}

}  // namespace palpate::inline v0
