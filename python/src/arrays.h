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

/// Exception palpate.Error.
struct PalpateError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Returns the value, or throws its error: KeyboardInterrupt if Ctrl-C is the reason.
[[noreturn]] void raise(const Error& error);
template <class T>
T taken(Result<T> result) {
  if (!result) raise(result.error());
  return *std::move(result);
}
inline void check(const Status& status) {
  if (!status) raise(status.error());
}
/// True if Ctrl-C was pressed: then the exception is set. With the GIL, in Python's main thread.
inline bool is_interrupted() { return PyErr_CheckSignals() != 0; }

/// Array of any type in any memory, without conversion.
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
/// Throws ValueError "NAME: shape (2, 3) is not DESIRED".
[[noreturn]] void refuse_shape(const char* name, const std::string& shape, const char* desired);

/// Checks type and layout; an array without numbers has any. ValueError: another type, or gaps
/// between the numbers.
template <class Array>
void require_dense(const Array& array, const char* name, nb::dlpack::dtype type) {
  bool is_dense = true;
  std::int64_t stride = 1;
  for (std::size_t axis = array.ndim(); axis-- > 0; stride *= std::int64_t(array.shape(axis))) {
    is_dense = is_dense && (array.shape(axis) == 1 || array.stride(axis) == stride);
  }
  if (array.dtype() != type || (stride > 0 && !is_dense)) refuse_layout(name, type);
}

/// Converts a GPU stream: None, a number, or an object of PyTorch or CuPy.
std::optional<CallerStream> stream_of(nb::handle given);
/// Returns the GPU index of a DLPack device, or kHostMemory. ValueError: another accelerator.
int memory_of(int device_type, int device_id, const char* name);
template <class Array>
int memory_of(const Array& array, const char* name) {
  return memory_of(array.device_type(), array.device_id(), name);
}
/// Returns an array in GPU memory; none if it is in host memory. Its producer gets the stream that
/// reads it, which then waits for the work that still writes the array; None: CUDA's default
/// stream. ValueError: memory of another accelerator.
std::optional<AnyArray> array_on_gpu(nb::handle given, const char* name, nb::handle stream);
/// The same for an array that is written.
std::optional<WritableArray> writable_on_gpu(nb::handle given, const char* name, nb::handle stream);

/// Returns the numbers of any array or nested list in host memory, without a copy if they are
/// row-major doubles already. ValueError: not numbers.
Doubles doubles_of(nb::handle given, const char* name);
/// The same as T, for whole numbers and for float32.
template <class T>
nb::ndarray<const T, nb::c_contig, nb::device::cpu> numbers_of(nb::handle given, const char* name,
                                                               const char* numpy_type);
/// Returns points (M, 3). ValueError: another shape.
Doubles points_of(nb::handle given, const char* name);

/// Converts (4, 4) or (7,) tx ty tz qx qy qz qw, which is normalized. ValueError: another shape, no
/// rotation, a quaternion of length zero. Numbers that are not finite stay so.
Pose pose_of(nb::handle given, const char* name);
/// The same without normalizing the quaternion, as batches do.
Pose given_pose(nb::handle given, const char* name);
/// Converts poses (P, 4, 4) or (P, 7).
std::vector<Pose> poses_of(nb::handle given, const char* name);
/// The same in place if they are (P, 7), else converted into `converted`. Quaternions are not
/// normalized.
std::span<const Pose> poses_in(const Doubles& numbers, const char* name,
                               std::vector<Pose>& converted);

/// Returns those of an array on a GPU. ValueError: another shape, type or layout.
std::span<const Pose> poses_on_gpu(const AnyArray& array, const char* name);

/// Returns a depth image in native byte order, with pixels that NumPy masks as 0: no measurement.
/// ValueError: an array of anything but numbers.
nb::object plain_image(nb::handle given);

/// Returns the number of threads. ValueError: fewer than 0 or more than 256.
int checked_threads(int given);

/// Parses "cpu", "cuda" or "cuda:1". ValueError: another word.
Place place_of(const std::string& word);
/// Returns the word that place_of parses to the place.
std::string name_of(const Place& place);

/// Returns a NumPy array that owns its numbers.
template <class T>
nb::object array_of(std::vector<T> values, std::initializer_list<std::size_t> shape) {
  auto* const kept = new std::vector<T>(std::move(values));
  const nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return nb::cast(nb::ndarray<nb::numpy, T>(kept->data(), shape, owner));
}
/// Returns the signature of a property that is an array, for the stubs.
inline std::string array_property(const char* name,
                                  const char* type = "numpy.typing.NDArray[numpy.float64]") {
  return std::string("def ") + name + "(self) -> " + type;
}
/// Returns tx ty tz qx qy qz qw of a pose: (7,).
nb::object seven_of(const Pose& X);
/// Returns a read-only NumPy array of numbers that `owner` keeps alive.
template <class T>
nb::object view_of(const T* values, std::initializer_list<std::size_t> shape, nb::handle owner) {
  return nb::cast(nb::ndarray<nb::numpy, const T>(values, shape, owner));
}

/// Waits for the work in a stream of a GPU: DLPack has made it wait for whoever writes an array
/// (array_on_gpu). Without the GIL. Error: the GPU has failed, or has not finished in ten minutes.
Status wait_for_producers(int gpu, CallerStream stream);

}  // namespace palpate::python
