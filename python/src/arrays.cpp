#include "python/src/arrays.h"

#include <cmath>

#include "palpate/settings/setting_table.h"
#include "src/math/internal/pose_of_matrix.h"

#ifdef PALPATE_CUDA
#include "src/gpu/internal/runtime.h"
#endif

namespace palpate::python {
namespace {

bool all_finite(const double* values, std::size_t num) {
  for (std::size_t i = 0; i < num; ++i) {
    if (!std::isfinite(values[i])) return false;
  }
  return true;
}

[[noreturn]] void refuse_pose(const char* name, const char* why) {
  throw nb::value_error((std::string(name) + ": " + why).c_str());
}

Pose checked_pose(const double* matrix, const char* name) {
  const Pose X = pose_of_matrix(matrix);
  if (!is_finite(X) && all_finite(matrix, 16)) {
    refuse_pose(name,
                "the (4, 4) matrix is no rigid motion: its 3 x 3 part has to be a rotation and its "
                "last row 0 0 0 1");
  }
  return X;
}

Pose pose_of_seven(const double* v, const char* name) {
  if (v[3] == 0 && v[4] == 0 && v[5] == 0 && v[6] == 0) {
    refuse_pose(name, "the quaternion qx qy qz qw is zero");
  }
  return {{v[0], v[1], v[2]}, {v[3], v[4], v[5], v[6]}};
}

Pose with_unit_quaternion(const Pose& X) {
  return is_finite(X) ? Pose{X.translation, normalized(X.rotation)} : X;
}

}  // namespace

void raise(const Error& error) {
  if (error.code == Errc::cancelled && PyErr_Occurred() != nullptr) throw nb::python_error();
  throw PalpateError(error.message);
}

std::string shape_text(const std::vector<std::size_t>& shape) {
  std::string text = "(";
  for (std::size_t i = 0; i < shape.size(); ++i) {
    text += (i > 0 ? ", " : "") + std::to_string(shape[i]);
  }
  return text + (shape.size() == 1 ? ",)" : ")");
}

void refuse_layout(const char* name, nb::dlpack::dtype desired) {
  const char* const kind = desired.code == std::uint8_t(nb::dlpack::dtype_code::Float) ? "float"
                           : desired.code == std::uint8_t(nb::dlpack::dtype_code::Int) ? "int"
                                                                                       : "uint";
  throw nb::value_error((std::string(name) + ": has to be " + kind +
                         std::to_string(int(desired.bits)) + ", row by row")
                            .c_str());
}

std::optional<CallerStream> stream_of(nb::handle given) {
  if (given.is_none()) return std::nullopt;
  nb::object number = nb::borrow(given);
  for (const char* name : {"cuda_stream", "ptr"}) {  // PyTorch, CuPy
    if (nb::hasattr(given, name)) number = given.attr(name);
  }
  return CallerStream{reinterpret_cast<void*>(nb::cast<std::uintptr_t>(number))};
}

int memory_of(int device_type, int device_id, const char* name) {
  switch (device_type) {
    case nb::device::cpu::value:
    case nb::device::cuda_host::value: return kHostMemory;
    case nb::device::cuda::value:
    case nb::device::cuda_managed::value: return device_id;
    default: break;
  }
  const char* const kind = device_type == nb::device::rocm::value     ? " (ROCm)"
                           : device_type == nb::device::oneapi::value ? " (oneAPI)"
                           : device_type == nb::device::vulkan::value ? " (Vulkan)"
                           : device_type == nb::device::metal::value  ? " (Metal)"
                                                                      : "";
  throw nb::value_error((std::string(name) + ": is in the memory of a device of DLPack's type " +
                         std::to_string(device_type) + kind +
                         "; host memory and CUDA GPUs are read: copy it to host memory")
                            .c_str());
}

namespace {
template <class Array>
std::optional<Array> lent_by_gpu(nb::handle given, const char* name, nb::handle stream) {
  if (!nb::hasattr(given, "__dlpack_device__")) return std::nullopt;
  const auto device = nb::cast<nb::tuple>(given.attr("__dlpack_device__")());
  const int type = nb::cast<int>(device[0]), id = nb::cast<int>(device[1]);
  if (memory_of(type, id, name) == kHostMemory) return std::nullopt;
  // In DLPack, 1 is the default stream, and 0 is not allowed. None would not make PyTorch wait.
  const CallerStream reader = stream_of(stream).value_or(CallerStream{});
  const auto number = reinterpret_cast<std::uintptr_t>(reader.handle);
  const nb::object capsule =
      given.attr("__dlpack__")(nb::arg("stream") = number == 0 ? std::uintptr_t{1} : number);
  return nb::cast<Array>(capsule, false);
}
}  // namespace

std::optional<AnyArray> array_on_gpu(nb::handle given, const char* name, nb::handle stream) {
  return lent_by_gpu<AnyArray>(given, name, stream);
}

std::optional<WritableArray> writable_on_gpu(nb::handle given, const char* name,
                                             nb::handle stream) {
  return lent_by_gpu<WritableArray>(given, name, stream);
}

void refuse_shape(const char* name, const std::string& shape, const char* desired) {
  throw nb::value_error((std::string(name) + ": shape " + shape + " is not " + desired).c_str());
}

template <class T>
nb::ndarray<const T, nb::c_contig, nb::device::cpu> numbers_of(nb::handle given, const char* name,
                                                               const char* numpy_type) {
  using Numbers = nb::ndarray<const T, nb::c_contig, nb::device::cpu>;
  Numbers numbers;
  if (nb::try_cast<Numbers>(given, numbers, false)) return numbers;
  // Another type, order or a list: NumPy makes a copy.
  nb::object copied;
  try {
    const nb::module_ numpy = nb::module_::import_("numpy");
    copied = numpy.attr("ascontiguousarray")(given, numpy_type);
    if (std::is_integral_v<T> && !nb::cast<bool>(numpy.attr("array_equal")(given, copied))) {
      throw nb::value_error(
          (std::string(name) + ": not whole numbers that fit " + numpy_type).c_str());
    }
  } catch (nb::python_error& error) {
    const std::string why = nb::cast<std::string>(nb::str(error.value()));
    throw nb::value_error(
        (std::string(name) + ": not an array of numbers in host memory: " + why).c_str());
  }
  if (nb::try_cast<Numbers>(copied, numbers)) return numbers;
  throw nb::value_error((std::string(name) + ": not an array of numbers").c_str());
}
template nb::ndarray<const double, nb::c_contig, nb::device::cpu> numbers_of(nb::handle,
                                                                             const char*,
                                                                             const char*);
template nb::ndarray<const float, nb::c_contig, nb::device::cpu> numbers_of(nb::handle, const char*,
                                                                            const char*);
template nb::ndarray<const std::int64_t, nb::c_contig, nb::device::cpu> numbers_of(nb::handle,
                                                                                   const char*,
                                                                                   const char*);
template nb::ndarray<const std::int32_t, nb::c_contig, nb::device::cpu> numbers_of(nb::handle,
                                                                                   const char*,
                                                                                   const char*);

Doubles doubles_of(nb::handle given, const char* name) {
  return numbers_of<double>(given, name, "float64");
}

Doubles points_of(nb::handle given, const char* name) {
  Doubles points = doubles_of(given, name);
  if (points.ndim() != 2 || points.shape(1) != 3) refuse_shape(name, shape_of(points), "(M, 3)");
  return points;
}

Pose given_pose(nb::handle given, const char* name) {
  const Doubles numbers = doubles_of(given, name);
  if (numbers.ndim() == 1 && numbers.shape(0) == 7) return pose_of_seven(numbers.data(), name);
  if (numbers.ndim() == 2 && numbers.shape(0) == 4 && numbers.shape(1) == 4) {
    return checked_pose(numbers.data(), name);
  }
  refuse_shape(name, shape_of(numbers), "(4, 4) or (7,)");
}

Pose pose_of(nb::handle given, const char* name) {
  return with_unit_quaternion(given_pose(given, name));
}

std::span<const Pose> poses_in(const Doubles& numbers, const char* name,
                               std::vector<Pose>& converted) {
  static_assert(sizeof(Pose) == 7 * sizeof(double));
  const std::size_t num = numbers.ndim() > 0 ? numbers.shape(0) : 0;
  if (numbers.ndim() == 2 && numbers.shape(1) == 7) {
    for (std::size_t i = 0; i < num; ++i) pose_of_seven(numbers.data() + 7 * i, name);
    return {reinterpret_cast<const Pose*>(numbers.data()), num};
  }
  if (numbers.ndim() != 3 || numbers.shape(1) != 4 || numbers.shape(2) != 4) {
    refuse_shape(name, shape_of(numbers), "(P, 4, 4) or (P, 7)");
  }
  converted.reserve(num);
  for (std::size_t i = 0; i < num; ++i) {
    converted.push_back(checked_pose(numbers.data() + 16 * i, name));
  }
  return converted;
}

std::span<const Pose> poses_on_gpu(const AnyArray& array, const char* name) {
  if (array.ndim() != 2 || array.shape(1) != 7) {
    refuse_shape(name, shape_of(array), "(P, 7), which it has to be on a GPU");
  }
  require_dense(array, name, nb::dtype<double>());
  return {static_cast<const Pose*>(array.data()), array.shape(0)};
}

std::vector<Pose> poses_of(nb::handle given, const char* name) {
  const Doubles numbers = doubles_of(given, name);
  std::vector<Pose> converted, poses;
  for (const Pose& X : poses_in(numbers, name, converted)) {
    poses.push_back(with_unit_quaternion(X));
  }
  return poses;
}

nb::object plain_image(nb::handle given) {
  nb::object image = nb::borrow(given);
  const nb::module_ numpy = nb::module_::import_("numpy");
  if (!nb::isinstance(given, numpy.attr("ndarray"))) return image;
  if (nb::isinstance(given, numpy.attr("ma").attr("MaskedArray"))) image = image.attr("filled")(0);
  const nb::object type = image.attr("dtype");
  if (std::string("uifb").find(nb::cast<std::string>(type.attr("kind"))) == std::string::npos) {
    throw nb::value_error("depth: uint16 counts or float32 meters are taken, no other type");
  }
  if (nb::cast<bool>(type.attr("isnative"))) return image;
  return image.attr("astype")(type.attr("newbyteorder")("="));
}

nb::object seven_of(const Pose& X) {
  const auto seven = seven_numbers(X);
  return array_of(std::vector<double>(seven.begin(), seven.end()), {7});
}

int checked_threads(int given) {
  constexpr int kMax = 256;
  if (given < 0 || given > kMax) {
    throw nb::value_error("threads: a whole number from 0 (one per core) to 256 is taken");
  }
  return given;
}

Place place_of(const std::string& word) {
  if (word == "cpu") return Place::cpu();
  if (word == "cuda") return Place::cuda();
  if (word.starts_with("cuda:") && word.size() > 5 && word.size() < 8 &&
      word.find_first_not_of("0123456789", 5) == std::string::npos) {
    return Place::cuda(std::stoi(word.substr(5)));
  }
  throw nb::value_error(("place: '" + word + "' is not \"cpu\", \"cuda\" or \"cuda:1\"").c_str());
}

std::string name_of(const Place& place) {
  return place.backend == Backend::cpu ? "cpu" : "cuda:" + std::to_string(place.gpu);
}

#ifdef PALPATE_CUDA
Status wait_for_producers(int gpu, CallerStream stream) {
  constexpr double kPatience = 600;  // s: a step of training may come first
  gpu::Stream producers(gpu);
  if (!producers.status()) return producers.status();
  producers.continue_in(stream.handle);
  return producers.wait(kPatience);
}
#else
Status wait_for_producers(int, CallerStream) { return Done{}; }  // nothing here reads its memory
#endif

}  // namespace palpate::python
