// The function behind palpate.torch: the field measure and its derivatives by their definition, one
// element after the other, in double.
#include <algorithm>
#include <cmath>
#include <memory>

#include "palpate/core/core.h"
#include "python/src/arrays.h"
#include "python/src/bindings.h"
#include "src/contact/internal/ball_cut.h"
#include "src/contact/internal/ball_parts.h"
#include "src/contact/internal/field_elements.h"
#include "src/contact/internal/hull_rules.h"
#include "src/field/internal/field_point.h"

namespace palpate::python {
namespace {

/// Result at one pose, in W. Gradients: by a shift and a small rotation about the center of mass.
struct Derivatives {
  double volume = 0, potential = 0;
  double volume_gradient[6] = {}, wrench[6] = {};
  Stiffness stiffness;
};

void add(double (&to)[6], const Vec3d& lever, const Vec3d& force) {
  const Vec3d torque = cross(lever, force);
  for (int k = 0; k < 3; ++k) {
    to[k] += force[k];
    to[k + 3] += torque[k];
  }
}

/// A number for each element of a cluster.
typedef double Row __attribute__((vector_size(8 * SphereClusters::kSize)));
struct SumOfRow {
  double operator()(const Row& row) const {
    double sum = 0;
    for (int i = 0; i < SphereClusters::kSize; ++i) sum += row[i];
    return sum;
  }
};

/// As FieldContact, but in double, and gradients are never shortened: the wrench is the exact
/// derivative of the potential everywhere.
class Differentiated {
 public:
  explicit Differentiated(const PyTool& tool)
      : tool_(tool), elements_(*tool.tool, SphereVolumes::represented) {
    const auto& places = ball_places().rows;
    Row* const rows[] = {&parts_.x, &parts_.y, &parts_.z, &parts_.is_part};
    for (int row = 0; row < 4; ++row) {
      for (int i = 0; i < SphereClusters::kSize; ++i) (*rows[row])[i] = places[row][i];
    }
  }

  Derivatives at(const DepthFieldView& field, const Pose& X_CT) const {
    Sums sums;
    constexpr std::size_t kSize = SphereClusters::kSize;
    for (std::size_t begin = 0; begin < elements_.factor.size(); begin += kSize) {
      if (begin / kSize < static_cast<std::size_t>(elements_.first_ball())) {
        for (std::size_t i = begin; i < begin + kSize; ++i) {
          const Element e = element(field, X_CT, i);
          if (e.at.phi < e.radius) add(e, e.volume(), e.disc(), sums);
        }
      } else {
        add_ball(field, X_CT, begin, sums);
      }
    }
    sums.to.stiffness = sums.stiffness.stiffness();
    return sums.to;
  }

 private:
  struct Element {
    Vec3d lever;
    double radius, factor;
    CurvedFieldSample at;
    bool is_before_camera;

    double volume() const { return factor * cap_volume(radius, at.phi); }
    double disc() const { return factor * kPi * std::max(radius * radius - at.phi * at.phi, 0.0); }
    double potential() const { return cut_ball(radius, factor, at.phi).potential; }
  };
  struct Sums {
    Derivatives to;
    StiffnessSums stiffness;
  };

  Element element(const DepthFieldView& field, const Pose& X_CT, std::size_t slot) const {
    const SphereClusters& places = elements_.clusters;
    const Vec3d lever =
        rotate(X_CT.rotation, to_double(Vec3f{places.x[slot], places.y[slot], places.z[slot]}));
    const Vec3d p_C = X_CT * tool_.tool->sphere_mass().center_of_mass + lever;
    const double radius = elements_.radius[slot];
    return {lever, radius, elements_.factor[slot], sample_field_curvature(field, p_C, radius),
            p_C.z > kMinDepth};
  }

  /// Adds an element with the force `volume` grad phi, which changes by `disc` times its product.
  static void add(const Element& e, double volume, double disc, Sums& sums) {
    const Vec3d& n = e.at.gradient;
    sums.to.volume += volume;
    sums.to.potential += e.potential();
    palpate::python::add(sums.to.volume_gradient, e.lever, n * -disc);
    palpate::python::add(sums.to.wrench, e.lever, n * volume);
    const auto& H = e.at.hessian.m;
    double terms[StiffnessSums::kNum];
    constexpr double kPolar = 0;  // of moments, which are not needed here
    stiffness_terms<double>({e.lever.x, e.lever.y, e.lever.z}, volume, disc, kPolar,
                            {n.x, n.y, n.z}, {H[0][0], H[0][1], H[0][2], H[1][1], H[1][2], H[2][2]},
                            terms);
    for (int k = 0; k < StiffnessSums::kNum; ++k) sums.stiffness.numbers[k] += terms[k];
  }

  /// Limits the field's value at a distant part, as FieldContact does.
  static void limit(Element& e) {
    const Vec3d n = e.at.gradient;
    const Curved<double> f = limited(e.at.phi, e.radius, kPartExtent * e.radius);
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) {
        double& h = e.at.hessian.m[row][column];
        h = f.slope * h + f.bend * n[row] * n[column];
      }
    }
    e.at.phi = f.value;
    e.at.gradient = f.slope * n;
  }

  /// Adds the ball of a cluster in parts (ball_cut.h).
  void add_ball(const DepthFieldView& field, const Pose& X_CT, std::size_t begin,
                Sums& sums) const {
    std::vector<Element> parts;
    Row phi{};
    bool is_complete = true;
    for (int i = 0; i <= kNumBallParts; ++i) {
      parts.push_back(element(field, X_CT, begin + static_cast<std::size_t>(i)));
      Element& e = parts.back();
      is_complete &= e.is_before_camera;
      if (i < kNumBallParts) limit(e);
      phi[i] = e.at.phi;
    }
    const double R = parts.back().radius;
    BallPlane<Row, double> plane;
    if (is_complete) plane = ball_plane<double>(parts_, phi / R, SumOfRow{}, true);
    const double twice = elements_.ball_factor[begin / SphereClusters::kSize] * R * R;
    Row weights[5];
    form_weights(parts_, plane.residual, weights);
    double X[5][6] = {};
    sums.to.potential += twice * R * R * plane.potential;
    for (int i = 0; i < kNumBallParts; ++i) {
      const Element& e = parts[static_cast<std::size_t>(i)];
      const double touches = e.at.phi < e.radius ? 1 : 0;
      add(e, touches * e.volume() + twice * R * plane.volume[i],
          touches * e.disc() + twice * plane.disc, sums);
      for (int k = 0; k < 5; ++k) {
        palpate::python::add(X[k], e.lever, e.at.gradient * weights[k][i]);
      }
    }
    if (!plane.is_plane) return;
    add_form(plane.form, X, twice, sums.stiffness.numbers);
    // The volume is the sum of minus the potential's derivatives by all values, so its gradient is
    // the form's with a change of all of them: 1 in the first of its five sums.
    for (int i = 0; i < 5; ++i) {
      for (int k = 0; k < 6; ++k) {
        sums.to.volume_gradient[k] -= twice * plane.form[0][i] * X[i][k];
      }
    }
  }

  BallRows<Row> parts_{};
  PyTool tool_;
  FieldElements elements_;
};

/// Rotates six numbers from C to W.
void turn(const Mat3d& R_WC, double* six) {
  for (int half = 0; half < 6; half += 3) {
    const Vec3d v = R_WC * Vec3d{six[half], six[half + 1], six[half + 2]};
    for (int k = 0; k < 3; ++k) six[half + k] = v[k];
  }
}

nb::tuple differentiate(const Differentiated& self, const PySurface& surface, nb::handle poses,
                        int threads) {
  const std::vector<Pose> X_WT = poses_of(poses, "poses");
  const DepthFieldView& field = surface.view.field;
  if (field.num_levels == 0 || field.gpu != kHostMemory) {
    throw PalpateError(
        "the derivatives are computed from a depth field in host memory; make the "
        "surface with Sensor(camera, place=\"cpu\")");
  }
  for (const Pose& X : X_WT) {
    if (!is_finite(X)) throw nb::value_error("poses: not finite");
  }
  const std::size_t num = X_WT.size();
  std::vector<double> volume(num), potential(num), volume_gradient(6 * num), wrench(6 * num),
      stiffness(36 * num);
  {
    const nb::gil_scoped_release no_gil;
    const Mat3d R_WC = rotation_matrix(surface.X_WC.rotation);
    ThreadPool pool(threads);
    pool.parallel_for(static_cast<int>(num), [&](int pose) {
      const auto i = static_cast<std::size_t>(pose);
      const Derivatives d = self.at(field, surface.X_CW * X_WT[i]);
      volume[i] = d.volume;
      potential[i] = d.potential;
      std::copy_n(d.volume_gradient, 6, &volume_gradient[6 * i]);
      std::copy_n(d.wrench, 6, &wrench[6 * i]);
      turn(R_WC, &volume_gradient[6 * i]);
      turn(R_WC, &wrench[6 * i]);
      // Columns, then rows: K_W = R K R^T.
      double K[6][6];
      for (int column = 0; column < 6; ++column) {
        double six[6];
        for (int row = 0; row < 6; ++row) six[row] = d.stiffness.m[row][column];
        turn(R_WC, six);
        for (int row = 0; row < 6; ++row) K[row][column] = six[row];
      }
      for (int row = 0; row < 6; ++row) {
        turn(R_WC, K[row]);
        std::copy_n(K[row], 6, &stiffness[36 * i + 6 * static_cast<std::size_t>(row)]);
      }
    });
  }
  return nb::make_tuple(array_of(std::move(volume), {num}), array_of(std::move(potential), {num}),
                        array_of(std::move(volume_gradient), {num, 6}),
                        array_of(std::move(wrench), {num, 6}),
                        array_of(std::move(stiffness), {num, 6, 6}));
}

}  // namespace

void bind_penetration(nb::module_& m) {
  nb::class_<Differentiated>(
      m, "Differentiated",
      R"(The field measure of a tool and its derivatives, in double; for palpate.torch.)")
      .def(nb::init<const PyTool&>(), nb::arg("tool"))
      .def("__call__", differentiate, nb::arg("surface"), nb::arg("poses"), nb::arg("threads") = 0,
           nb::sig("def __call__(self, surface: Surface, poses: palpate._types.Array, "
                   "threads: int = 0) -> tuple[numpy.typing.NDArray[numpy.float64], ...]"),
           R"(Volume (P,) m3, potential (P,) m4, the volume's gradient (P, 6) m2 and m3, force and
torque (P, 6) m3 and m4, stiffness (P, 6, 6): all in W, by a shift of the tool and a small rotation
about its center of mass. poses: (P, 4, 4) or (P, 7).)");
}

}  // namespace palpate::python
