// The methods of the thesis, as parameters of a test.
#pragma once

#include <algorithm>
#include <string>

#include <gtest/gtest.h>

#include "eval/context.h"

namespace palpate::test {

inline std::vector<eval::Method> point_methods() {
  std::vector<eval::Method> methods = eval::all_methods();
  std::erase_if(methods, [](const eval::Method& method) {
    return method.options.method == MethodKind::field;
  });
  return methods;
}

/// For INSTANTIATE_TEST_SUITE_P.
inline std::string name_of(const testing::TestParamInfo<eval::Method>& method) {
  std::string name = method.param.name;
  std::ranges::replace(name, '-', '_');
  return name;
}

}  // namespace palpate::test
