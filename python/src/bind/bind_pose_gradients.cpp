// Derivatives by the numbers of poses for palpate.torch, with tensors read and written where they
// are.
#include <string>
#include <utility>
#include <vector>

#include "python/src/arrays.h"
#include "python/src/bindings.h"
#include "src/contact/internal/pose_gradients.h"

namespace palpate::python {
namespace {

/// The poses of a call and other arrays of their number, in the same memory; kept alive by this.
class PoseArrays {
 public:
  explicit PoseArrays(nb::handle given) {
    const AnyArray array = cast<AnyArray>(given, "poses");
    const bool is_single = array.dtype() == nb::dtype<float>();
    type_ = is_single ? nb::dtype<float>() : nb::dtype<double>();
    require_dense(array, "poses", type_);
    const bool is_matrix = array.ndim() == 3;
    if (array.ndim() < 2 || array.ndim() > 3 || array.shape(1) != (is_matrix ? 4 : 7) ||
        (is_matrix && array.shape(2) != 4)) {
      refuse_shape("poses", shape_of(array), "(P, 4, 4) or (P, 7)");
    }
    poses = {array.data(), array.shape(0), is_matrix, is_single, memory_of(array, "poses")};
    each_ = is_matrix ? std::vector<std::size_t>{4, 4} : std::vector<std::size_t>{7};
    read_.push_back(array);
  }

  /// Reads (P, inner ...) doubles; null for None. Rows may be any step apart.
  const double* doubles(nb::handle given, const char* name, const std::vector<std::size_t>& inner,
                        std::ptrdiff_t* step = nullptr) {
    return static_cast<const double*>(rows(given, name, inner, nb::dtype<double>(), step, read_));
  }
  /// Reads, and writes, what has the type of the poses.
  const void* read(nb::handle given, const char* name, bool is_of_poses,
                   std::ptrdiff_t* step = nullptr) {
    return rows(given, name, inner(is_of_poses), type_, step, read_);
  }
  void* write(nb::handle given, const char* name, bool is_of_poses) {
    return rows(given, name, inner(is_of_poses), type_, nullptr, written_);
  }
  /// Writes (P, 7) doubles.
  double* write_seven(nb::handle given, const char* name) {
    return static_cast<double*>(rows(given, name, {7}, nb::dtype<double>(), nullptr, written_));
  }

  PoseNumbers poses;

 private:
  template <class Array>
  static Array cast(nb::handle given, const char* name) {
    Array array;
    if (nb::try_cast<Array>(given, array, false)) return array;
    throw nb::type_error((std::string(name) + ": not an array of that kind").c_str());
  }
  std::vector<std::size_t> inner(bool is_of_poses) const {
    return is_of_poses ? each_ : std::vector<std::size_t>{};
  }

  template <class Array>
  using DataOf = decltype(std::declval<const Array&>().data());
  template <class Array>
  DataOf<Array> rows(nb::handle given, const char* name, const std::vector<std::size_t>& inner,
                     nb::dlpack::dtype type, std::ptrdiff_t* step, std::vector<Array>& kept) const {
    if (given.is_none()) return nullptr;
    const Array array = cast<Array>(given, name);
    bool fits = array.ndim() == 1 + inner.size() && array.shape(0) == poses.num;
    for (std::size_t k = 0; fits && k < inner.size(); ++k) fits = array.shape(k + 1) == inner[k];
    if (!fits) {
      std::vector<std::size_t> desired{poses.num};
      desired.insert(desired.end(), inner.begin(), inner.end());
      refuse_shape(name, shape_of(array), shape_text(desired).c_str());
    }
    if (memory_of(array, name) != poses.gpu) {
      throw nb::value_error((std::string(name) + ": is elsewhere than the poses").c_str());
    }
    std::int64_t row = 1;
    bool is_dense = true;
    for (std::size_t axis = array.ndim() - 1; axis > 0; row *= std::int64_t(array.shape(axis--))) {
      is_dense = is_dense && (array.shape(axis) == 1 || array.stride(axis) == row);
    }
    is_dense = is_dense && (step != nullptr || poses.num <= 1 || array.stride(0) == row);
    if (array.dtype() != type || (poses.num > 0 && !is_dense)) refuse_layout(name, type);
    if (step != nullptr) *step = static_cast<std::ptrdiff_t>(array.stride(0));
    kept.push_back(array);
    return array.data();
  }

  nb::dlpack::dtype type_;
  std::vector<std::size_t> each_;
  std::vector<AnyArray> read_;
  std::vector<WritableArray> written_;
};

void pull_back(nb::handle poses, nb::handle p_TC, nb::handle by_shift, nb::handle by_turn,
               nb::handle out, double factor, nb::handle scale, nb::handle along,
               nb::handle stiffness, nb::handle p_CQ, nb::handle by_scale, nb::handle stream) {
  const int num_with = int{!stiffness.is_none()} + int{!p_CQ.is_none()} + int{!by_scale.is_none()};
  if (num_with != (along.is_none() ? 0 : 1)) {
    throw nb::value_error("along: goes with one of stiffness, p_CQ and by_scale");
  }
  if (out.is_none() == by_scale.is_none()) throw nb::value_error("out: give either it or by_scale");
  PoseArrays arrays(poses);
  PoseGradients job;
  job.poses = arrays.poses;
  job.p_TC = arrays.doubles(p_TC, "p_TC", {3}, &job.center_step);
  job.by_shift = arrays.doubles(by_shift, "by_shift", {3}, &job.shift_step);
  job.by_turn = arrays.doubles(by_turn, "by_turn", {3}, &job.turn_step);
  job.factor = factor;
  job.scale = arrays.read(scale, "scale", false, &job.scale_step);
  job.along = arrays.read(along, "along", true);
  job.stiffness = arrays.doubles(stiffness, "stiffness", {6, 6});
  job.p_CQ = arrays.doubles(p_CQ, "p_CQ", {3});
  job.to = arrays.write(out, "out", true);
  job.by_scale = arrays.write(by_scale, "by_scale", false);
  const CallerStream where = stream_of(stream).value_or(CallerStream{});
  const nb::gil_scoped_release no_gil;
  check(put_pose_gradients(job, where));
}

void plain_poses(nb::handle poses, nb::handle out, nb::handle stream) {
  PoseArrays arrays(poses);
  double* const to = arrays.write_seven(out, "out");
  const CallerStream where = stream_of(stream).value_or(CallerStream{});
  const nb::gil_scoped_release no_gil;
  check(put_plain_poses(arrays.poses, to, where));
}

}  // namespace

void bind_pose_gradients(nb::module_& m) {
  m.def("pull_back", pull_back, nb::arg("poses"), nb::arg("p_TC"), nb::arg("by_shift"),
        nb::arg("by_turn"), nb::arg("out").none(), nb::kw_only(), nb::arg("factor") = 1.0,
        nb::arg("scale") = nb::none(), nb::arg("along") = nb::none(),
        nb::arg("stiffness") = nb::none(), nb::arg("p_CQ") = nb::none(),
        nb::arg("by_scale") = nb::none(), nb::arg("stream") = nb::none(),
        nb::sig("def pull_back(poses: palpate._types.Array, p_TC: palpate._types.Array, "
                "by_shift: palpate._types.Array, by_turn: palpate._types.Array, "
                "out: palpate._types.Array | None, *, factor: float = 1.0, "
                "scale: palpate._types.Array | None = None, "
                "along: palpate._types.Array | None = None, "
                "stiffness: palpate._types.Array | None = None, "
                "p_CQ: palpate._types.Array | None = None, "
                "by_scale: palpate._types.Array | None = None, "
                "stream: palpate._types.Stream | None = None) -> None"),
        R"(Derivatives by the numbers of poses, from those by motions; for palpate.torch.

poses: (P, 7), quaternions of any length, or (P, 4, 4), float32 or float64. by_shift, by_turn: (P, 3),
by a shift of the center of mass p_TC (P, 3) and a rotation about it, in W, times `factor`. out, of the
type and shape of the poses, gets the gradient, times scale (P,). With `along`, of the same type and
shape, it gets the derivative of their product instead: stiffness (P, 6, 6) is minus the derivative of
by_shift and by_turn, or p_CQ (P, 3) is the point Q of the tool before a plane. Or out is None, and
by_scale (P,) gets the product itself, without the scale. ValueError: other combinations, shapes, types
or memory.)");
  m.def(
      "plain_poses", plain_poses, nb::arg("poses"), nb::arg("out"), nb::kw_only(),
      nb::arg("stream") = nb::none(),
      nb::sig("def plain_poses(poses: palpate._types.Array, out: palpate._types.Array, *, "
              "stream: palpate._types.Stream | None = None) -> None"),
      R"(Poses as above into out (P, 7) float64, as batches take them; what is no pose is not finite.)");
}

}  // namespace palpate::python
