// The methods of the thesis, as parameters of a test.
#pragma once

#include <gtest/gtest.h>

#include "palpate/contact/contact_query.h"

namespace palpate::test {

struct PointMethod {
  const char* name;
  InsideMethod method;
  InsideVolume inside;
};

inline auto point_methods() {
  return testing::Values(PointMethod{"weighted", InsideMethod::weighted, InsideVolume::full},
                         PointMethod{"simplified", InsideMethod::simplified, InsideVolume::full},
                         PointMethod{"graph", InsideMethod::graph, InsideVolume::full},
                         PointMethod{"graph_cap", InsideMethod::graph, InsideVolume::cap});
}

}  // namespace palpate::test
