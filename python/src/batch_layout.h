// palpate.Batch over arrays of the caller, each of which is checked.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "python/src/batch.h"

namespace palpate::python {

/// Creates a batch over arrays of the caller.
class Layout {
 public:
  explicit Layout(PyBatch& batch) : batch_(batch) {}

  /// (P, inner ...) of T; null for None.
  template <class T>
  T* take(nb::handle given, const char* name, const std::vector<std::size_t>& inner) {
    if (given.is_none()) return nullptr;
    WritableArray array;
    if (!nb::try_cast<WritableArray>(given, array, false)) {
      throw nb::type_error((std::string(name) + ": not an array that can be written").c_str());
    }
    const int where = memory_of(array, name);
    std::vector<std::size_t> desired{array.ndim() > 0 ? array.shape(0) : 0};
    if (!batch_.given.empty()) desired[0] = batch_.num;
    desired.insert(desired.end(), inner.begin(), inner.end());
    const std::string shape = shape_of(array);
    if (shape != shape_text(desired)) refuse_shape(name, shape, shape_text(desired).c_str());
    require_dense(array, name, nb::dtype<T>());
    if (!batch_.given.empty() && where != batch_.answers.gpu) {
      throw nb::value_error((std::string(name) + ": is elsewhere than the others").c_str());
    }
    batch_.num = desired[0];
    batch_.answers.gpu = where;
    batch_.given.push_back(array);
    return static_cast<T*>(array.data());
  }

  /// A result of scenes, which the batch has by its name.
  template <class T>
  T* take_named(nb::handle given, const char* name, const std::vector<std::size_t>& inner) {
    T* const array = take<T>(given, name, inner);
    if (array != nullptr) batch_.more[name] = given;
    return array;
  }
  /// One of each sphere.
  template <class T>
  T* take_spheres(nb::handle given, const char* name, const std::vector<std::size_t>& inner = {}) {
    WritableArray array;
    std::size_t& num = batch_.scene.max_spheres;
    if (num == 0 && nb::try_cast<WritableArray>(given, array, false) && array.ndim() > 1) {
      num = array.shape(1);
    }
    std::vector<std::size_t> each{num};
    each.insert(each.end(), inner.begin(), inner.end());
    return take_named<T>(given, name, each);
  }

 private:
  PyBatch& batch_;
};

}  // namespace palpate::python
