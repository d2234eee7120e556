#include "src/contact/bodies/solid_contact.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "src/contact/bodies/body_pair.h"
#include "src/core/internal/select_isa.h"

namespace palpate { inline namespace v0 {
PALPATE_DECLARE_KERNELS(void measure_solid_group(const SolidJob&, int group, bool with_stiffness,
                                                 GroupSums* sums);
                        constexpr SolidContactKernels kSolidContact{measure_solid_group};)

namespace {

constexpr SolidContactKernels kKernels[] = PALPATE_BY_ISA(kSolidContact);

// Smallest weight of a direction of sampling that is worth its time.
constexpr double kMinWeight = 0.1;
// Potential of a single sphere in a light touch, over the square of the coarseness.
constexpr double kSingle = 0.05;

void copy(const Mat3d& from, float (&to)[3][3]) {
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      to[row][column] = static_cast<float>(from.m[row][column]);
    }
  }
}

/// Places the elements of a body E in the field of a body F.
SolidFrame frame_of(const Pose& X_WE, const Vec3d& center_E, const Pose& X_WF,
                    const SolidField& field) {
  const Pose X_FE = relative_pose(X_WF, X_WE);
  SolidFrame frame;
  copy(rotation_matrix(X_FE.rotation), frame.R_FE);
  copy(rotation_matrix(normalized(X_WE.rotation)), frame.R_WE);
  copy(rotation_matrix(normalized(X_WF.rotation)), frame.R_WF);
  const Vec3d p_F = X_FE * center_E - field.layout().origin;
  for (int axis = 0; axis < 3; ++axis) frame.p_FC[axis] = static_cast<float>(p_F[axis]);
  return frame;
}

SolidJob job_of(const FieldElements& elements, const SolidSampling& sampling,
                const SolidField& field) {
  return {&elements.clusters,     elements.radius.data(),
          elements.factor.data(), elements.counted.data(),
          sampling.level.data(),  sampling.rounding.data(),
          view_of(field),         {}};
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

/// Returns the stiffness of the wrench on the other body F, about C_F, by F's own pose, from that
/// of the wrench on a body E, about its center C_E, by E's. Moving F is moving both, which turns
/// all wrenches along, and E back. `d` is from C_F to C_E.
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

/// Returns the moments of the opposite forces about another point, from which F's center lies `d`
/// away, given those of the force on body F about its own center.
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

Stiffness sum_of(const Stiffness& a, double weight_a, const Stiffness& b, double weight_b) {
  Stiffness sum;
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column) {
      sum.m[row][column] = weight_a * a.m[row][column] + weight_b * b.m[row][column];
    }
  }
  return sum;
}

/// sum += scale F F^T
void add_product(Stiffness& sum, double scale, const VolumeWrench& F) {
  const double f[6] = {F.force.x, F.force.y, F.force.z, F.torque.x, F.torque.y, F.torque.z};
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column) sum.m[row][column] += scale * f[row] * f[column];
  }
}

/// The potential U of a pair, a mean of the potentials of both directions of sampling with the
/// exponent 8, and its slope by each of them. Wrenches are on one body, about one point.
///
///   (U + e)^8 = w_a (U_a + e)^8 + w_b (U_b + e)^8
///
/// e is the potential of single spheres: where both have little more, neither is preferred.
class PairPotential {
 public:
  PairPotential(double of_a, double weight_a, double of_b, double weight_b, double e)
      : value_(weight_a * of_a + weight_b * of_b), slope_a_(weight_a), slope_b_(weight_b) {
    if (weight_a == 0 || weight_b == 0) return;
    raised_a_ = of_a + e;
    raised_b_ = of_b + e;
    const double most = std::max(raised_a_, raised_b_);
    const double a = raised_a_ / most, b = raised_b_ / most;
    const double a_7 = seventh_power(a), b_7 = seventh_power(b);
    const double mean = weight_a * a_7 * a + weight_b * b_7 * b;
    const double root = std::sqrt(std::sqrt(std::sqrt(mean)));
    raised_ = most * root;
    value_ = raised_ - e;
    slope_a_ = weight_a * a_7 * root / mean;
    slope_b_ = weight_b * b_7 * root / mean;
  }

  double value() const { return value_; }
  VolumeWrench wrench(const VolumeWrench& a, const VolumeWrench& b) const {
    return {slope_a_ * a.force + slope_b_ * b.force, slope_a_ * a.torque + slope_b_ * b.torque};
  }
  /// Derivative of the wrench, including that of the slopes.
  Stiffness stiffness(const Stiffness& k_a, const VolumeWrench& a, const Stiffness& k_b,
                      const VolumeWrench& b) const {
    Stiffness sum = sum_of(k_a, slope_a_, k_b, slope_b_);
    if (!(raised_ > 0)) return sum;
    add_product(sum, 7 * slope_a_ / raised_a_, a);
    add_product(sum, 7 * slope_b_ / raised_b_, b);
    add_product(sum, -7 / raised_, wrench(a, b));
    return sum;
  }
  /// Moments of the force, weighted by its slopes; that of the volume by its weights.
  VolumeMoments moments(const VolumeMoments& a, double weight_a, const VolumeMoments& b,
                        double weight_b) const {
    VolumeMoments sum;
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) {
        sum.first[row][column] = slope_a_ * a.first[row][column] + slope_b_ * b.first[row][column];
      }
    }
    sum.polar = weight_a * a.polar + weight_b * b.polar;
    return sum;
  }

 private:
  static double seventh_power(double x) {
    const double x2 = x * x;
    return x2 * x2 * x2 * x;
  }

  double value_, slope_a_, slope_b_;
  double raised_ = 0, raised_a_ = 0, raised_b_ = 0;  // with e; 0: only one direction is sampled
};

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

SolidSampling::SolidSampling(const FieldElements& elements, const SolidField& field)
    : level(elements.radius.size()) {
  const auto last = static_cast<std::int32_t>(field.levels().size()) - 1;
  const double spacing = field.layout().spacing;
  double volume = 0, squares = 0, widest = 0, owed = 0;
  for (std::size_t slot = 0; slot < level.size(); ++slot) {
    const double radius = elements.radius[slot];
    const double counts = elements.factor[slot] * sphere_volume(radius);
    volume += counts;
    squares += counts * radius * radius;
    // Second moments, in those of the finest grid. That of the ball lies between those of two
    // grids; the choice keeps the sum over all elements so far nearest to that of their balls.
    const double desired = std::max(1.0, std::pow(kSpacingPerRadius * radius / spacing, 2));
    double moment = 1;
    while (moment * 4 <= desired && level[slot] < last) {
      moment *= 4;
      ++level[slot];
    }
    const double missing = counts * (desired - moment), more = counts * 3 * moment;
    if (level[slot] < last) {
      if (owed + missing > more / 2 && counts > 0) {
        ++level[slot];
        owed -= more;
      }
      owed += missing;
    } else if (desired > 4 * moment && counts > 0) {
      is_possible = false;
    }
    widest = std::max(widest, std::ldexp(spacing, level[slot]));
    if (slot % SphereClusters::kSize == SphereClusters::kSize - 1) {
      rounding.push_back(static_cast<float>(kMaxRounding * 1.0001 * widest));
      widest = 0;
    }
  }
  coarseness = squares / volume + spacing * spacing;
}

SolidPair::SolidPair(std::shared_ptr<const ToolIndex> of_a, std::shared_ptr<const ToolIndex> of_b)
    : a(std::move(of_a)),
      b(std::move(of_b)),
      elements_a(&parts_of(*a).solid_elements()),
      elements_b(&parts_of(*b).solid_elements()),
      field_a(&parts_of(*a).solid_field()),
      field_b(&parts_of(*b).solid_field()),
      sampling_a(*elements_a, *field_b),
      sampling_b(*elements_b, *field_a) {
  const double fine_a = sampling_a.is_possible ? std::pow(sampling_a.coarseness, -2) : 0;
  const double fine_b = sampling_b.is_possible ? std::pow(sampling_b.coarseness, -2) : 0;
  const bool samples_a = fine_a >= kMinWeight * (fine_a + fine_b);
  const bool samples_b = fine_b >= kMinWeight * (fine_a + fine_b);
  const double sum = (samples_a ? fine_a : 0) + (samples_b ? fine_b : 0);
  weight_a = samples_a ? fine_a / sum : 0;
  weight_b = samples_b ? fine_b / sum : 0;
  const double coarseness = std::max(sampling_a.coarseness, sampling_b.coarseness);
  single_potential = kSingle * coarseness * coarseness;
}

void SolidPair::place(const Pose& X_WA, const Pose& X_WB, SolidFrame& of_a,
                      SolidFrame& of_b) const {
  of_a = frame_of(X_WA, a->tool().sphere_mass().center_of_mass, X_WB, *field_b);
  of_b = frame_of(X_WB, b->tool().sphere_mass().center_of_mass, X_WA, *field_a);
}

BodyPenetration SolidPair::penetration(const GroupSums& of_a, const GroupSums& of_b,
                                       bool with_stiffness, const Pose& X_WA,
                                       const Pose& X_WB) const {
  const Pose X_A{X_WA.translation, normalized(X_WA.rotation)};
  const Pose X_B{X_WB.translation, normalized(X_WB.rotation)};
  // From one center of mass to the other.
  const Vec3d d_BA =
      X_A * a->tool().sphere_mass().center_of_mass - X_B * b->tool().sphere_mass().center_of_mass;
  const VolumeWrench measure_a{of_a.measure.force, of_a.measure.torque};
  const VolumeWrench measure_b{of_b.measure.force, of_b.measure.torque};
  const PairPotential both(of_a.measure.potential, weight_a, of_b.measure.potential, weight_b,
                           single_potential);
  BodyPenetration result;
  result.on_a = of_a.measure.penetration();
  result.on_b = of_b.measure.penetration();
  for (Penetration* part : {&result.on_a, &result.on_b}) {
    part->volume = weight_a * of_a.measure.volume + weight_b * of_b.measure.volume;
    part->potential = both.value();
  }
  // Wrenches of each direction on both bodies.
  const VolumeWrench b_on_a{-measure_b.force, -(measure_b.torque - cross(d_BA, measure_b.force))};
  const VolumeWrench a_on_b{-measure_a.force, -(measure_a.torque + cross(d_BA, measure_a.force))};
  result.on_a.measure_W = both.wrench(measure_a, b_on_a);
  result.on_b.measure_W = both.wrench(a_on_b, measure_b);
  result.num_pairs = std::int64_t{result.on_a.num_boundary_spheres} +
                     result.on_a.num_inside_spheres + result.on_b.num_boundary_spheres +
                     result.on_b.num_inside_spheres;
  if (with_stiffness) {
    const Stiffness k_a = of_a.stiffness.stiffness(), k_b = of_b.stiffness.stiffness();
    result.stiffness_a = both.stiffness(k_a, measure_a, of_other(k_b, measure_b, -d_BA), b_on_a);
    result.stiffness_b = both.stiffness(of_other(k_a, measure_a, d_BA), a_on_b, k_b, measure_b);
    result.moments_a =
        both.moments(of_a.stiffness.moments(), weight_a,
                     of_opposite(of_b.stiffness.moments(), measure_b.force, -d_BA), weight_b);
  }
  return result;
}

SolidContact::SolidContact(std::shared_ptr<const ToolIndex> a, std::shared_ptr<const ToolIndex> b,
                           Isa isa)
    : pair_(std::move(a), std::move(b)),
      kernels_(solid_contact_kernels(isa)),
      job_a_(job_of(*pair_.elements_a, pair_.sampling_a, *pair_.field_b)),
      job_b_(job_of(*pair_.elements_b, pair_.sampling_b, *pair_.field_a)) {}

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

}}  // namespace palpate::v0
