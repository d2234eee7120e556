// Arrays and poses on their way into and out of Python, and errors that become exceptions.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include <initializer_list>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "palpate/core/core.h"
#include "palpate/gpu/devices.h"
#include "palpate/math/geometry.h"

namespace palpate::python {

namespace nb = nanobind;

/// palpate.Error.
struct PalpateError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// The value, or its error as an exception: KeyboardInterrupt if Ctrl-C is the reason.
[[noreturn]] void raise(const Error& error);
template <class T>
T taken(Result<T> result) {
  if (!result) raise(result.error());
  return *std::move(result);
}
inline void check(const Status& status) {
  if (!status) raise(status.error());
}
/// Has Ctrl-C been pressed? The exception is set then. With the GIL, in Python's main thread.
inline bool is_interrupted() { return PyErr_CheckSignals() != 0; }

/// Of any type at any place, as it is.
using AnyArray = nb::ndarray<nb::ro>;
using WritableArray = nb::ndarray<>;
using Doubles = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;

/// "(3, 4)"
std::string shape_text(const std::vector<std::size_t>& shape);
template <class Array>
std::string shape_of(const Array& array) {
  std::vector<std::size_t> shape;
  for (std::size_t i = 0; i < array.ndim(); ++i) shape.push_back(array.shape(i));
  return shape_text(shape);
}
[[noreturn]] void refuse_layout(const char* name, nb::dlpack::dtype desired);
/// ValueError: "NAME: shape (2, 3) is not WANTED".
[[noreturn]] void refuse_shape(const char* name, const std::string& shape, const char* desired);

/// ValueError: another type, or gaps between its numbers.
template <class Array>
void require_dense(const Array& array, const char* name, nb::dlpack::dtype type) {
  bool is_dense = array.dtype() == type;
  std::int64_t stride = 1;
  for (std::size_t axis = array.ndim(); axis-- > 0; stride *= std::int64_t(array.shape(axis))) {
    is_dense = is_dense && (array.shape(axis) == 1 || array.stride(axis) == stride);
  }
  if (!is_dense) refuse_layout(name, type);
}

/// A queue of a GPU: None, a number, or an object of PyTorch or CuPy.
std::optional<CallerStream> stream_of(nb::handle given);
/// The GPU whose memory this DLPack device is, or kHostMemory. ValueError: another accelerator's.
int memory_of(int device_type, int device_id, const char* name);
template <class Array>
int memory_of(const Array& array, const char* name) {
  return memory_of(array.device_type(), array.device_id(), name);
}
/// An array in the memory of a GPU; nothing if it is in host memory. Its producer gets the stream
/// in which it is read, which then waits for the work that still writes it; None: CUDA's default
/// stream. ValueError: memory of another accelerator.
std::optional<AnyArray> array_on_gpu(nb::handle given, const char* name, nb::handle stream);

/// Numbers of any array or nested list in host memory, without a copy if they are doubles row by
/// row already. ValueError: not numbers.
Doubles doubles_of(nb::handle given, const char* name);
/// The same as T, for whole numbers and for float32.
template <class T>
nb::ndarray<const T, nb::c_contig, nb::device::cpu> numbers_of(nb::handle given, const char* name,
                                                               const char* numpy_type);
/// (M, 3). ValueError: another shape.
Doubles points_of(nb::handle given, const char* name);

/// (4, 4) or (7,) tx ty tz qx qy qz qw, which is normalized. ValueError: another shape, no
/// rotation, a quaternion of length zero. What is not finite stays so.
Pose pose_of(nb::handle given, const char* name);
/// The same with a quaternion as long as it was given, as batches take them.
Pose given_pose(nb::handle given, const char* name);
/// (P, 4, 4) or (P, 7).
std::vector<Pose> poses_of(nb::handle given, const char* name);
/// The same as they lie there if they are (P, 7), else converted into `converted`. Quaternions stay
/// as long as they are.
std::span<const Pose> poses_in(const Doubles& numbers, const char* name,
                               std::vector<Pose>& converted);

/// A depth image in the byte order of this machine, and what NumPy has masked as 0: no measurement.
/// ValueError: an array of anything but numbers.
nb::object plain_image(nb::handle given);

/// ValueError: fewer than 0 or more than 256.
int checked_threads(int given);

/// "cpu", "cuda" or "cuda:1". ValueError: another word.
Place place_of(const std::string& word);

/// A NumPy array that owns its numbers.
template <class T>
nb::object array_of(std::vector<T> values, std::initializer_list<std::size_t> shape) {
  auto* const kept = new std::vector<T>(std::move(values));
  const nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return nb::cast(nb::ndarray<nb::numpy, T>(kept->data(), shape, owner));
}
/// A NumPy array of numbers that `owner` keeps, to be read only.
template <class T>
nb::object view_of(const T* values, std::initializer_list<std::size_t> shape, nb::handle owner) {
  return nb::cast(nb::ndarray<nb::numpy, const T>(values, shape, owner));
}

}  // namespace palpate::python
