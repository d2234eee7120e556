// What palpate.torch differentiates: the field measure and its derivatives by their definition, one
// element after the other, in double.
#include <algorithm>
#include <cmath>
#include <memory>

#include "palpate/core/core.h"
#include "python/src/arrays.h"
#include "python/src/bindings.h"
#include "src/contact/field/field_element.h"
#include "src/contact/index/field_elements.h"
#include "src/field/internal/field_curvature.h"

namespace palpate::python {
namespace {

/// Of one pose, in W. Gradients: by a shift of the tool and a small turn about its centre of mass.
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

/// As FieldContact, but in double, and gradients are never shortened: the wrench is the exact
/// derivative of the potential everywhere.
class Differentiated {
 public:
  explicit Differentiated(const PyTool& tool)
      : tool_(tool), elements_(*tool.tool, SphereVolumes::represented) {}

  Derivatives at(const DepthFieldView& field, const Pose& X_CT) const {
    Derivatives sum;
    StiffnessSums stiffness;
    const Vec3d p_CC = X_CT * tool_.tool->sphere_mass().centre_of_mass;
    const Mat3d R_CT = rotation_matrix(X_CT.rotation);
    const SphereClusters& places = elements_.clusters;
    for (std::size_t i = 0; i < elements_.factor.size(); ++i) {
      if (places.sphere_id[i] < 0) continue;  // padding
      const Vec3d lever = R_CT * Vec3d{places.x[i], places.y[i], places.z[i]};
      const double r = elements_.radius[i], factor = elements_.factor[i];
      const CurvedFieldSample at = sample_field_curvature(field, p_CC + lever, r);
      if (at.phi >= r) continue;
      const double h = std::min(r - at.phi, 2 * r);
      const double volume = factor * cap_volume(r, at.phi);
      const double disc = factor * kPi * std::max(r * r - at.phi * at.phi, 0.0);
      sum.volume += volume;
      sum.potential += factor * (kPi / 12 * h * h * h * (4 * r - h) +
                                 sphere_volume(r) * std::max(-at.phi - r, 0.0));
      add(sum.volume_gradient, lever, at.gradient * -disc);
      add(sum.wrench, lever, at.gradient * volume);
      const auto& H = at.hessian.m;
      double terms[StiffnessSums::kNum];
      constexpr double kPolar = 0;  // of moments, which are not needed here
      stiffness_terms<double>({lever.x, lever.y, lever.z}, volume, disc, kPolar,
                              {at.gradient.x, at.gradient.y, at.gradient.z},
                              {H[0][0], H[0][1], H[0][2], H[1][1], H[1][2], H[2][2]}, terms);
      for (int k = 0; k < StiffnessSums::kNum; ++k) stiffness.numbers[k] += terms[k];
    }
    sum.stiffness = stiffness.stiffness();
    return sum;
  }

 private:
  PyTool tool_;
  FieldElements elements_;
};

/// Six numbers of C in W.
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
torque (P, 6) m3 and m4, stiffness (P, 6, 6): all in W, by a shift of the tool and a small turn
about its centre of mass. poses: (P, 4, 4) or (P, 7).)");
}

}  // namespace palpate::python
