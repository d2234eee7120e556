// A solid as a scanner leaves it: the rabbit of the optional data, and a made one for everybody.
#pragma once

#include <cmath>

#include "palpate/mesh/mesh.h"
#include "tests/test_util/data.h"
#include "tests/test_util/off_mesh.h"
#include "tests/test_util/random.h"

namespace palpate::test {

/// 2562 vertices on a lump of about 0.1 m with a head, ears and hollows, each 0.1 mm off along its
/// ray by noise.
inline TriangleMesh made_scan() {
  TriangleMesh mesh = make_icosphere(1, 4);
  Random random(77);
  for (Vec3d& p : mesh.vertices) {
    const Vec3d d = normalized(p);
    const auto bump = [&d](const Vec3d& at, double width, double high) {
      return high * std::exp(-(1 - dot(d, normalized(at))) / width);
    };
    const double waves = 0.03 * std::sin(7 * d.x + 2) * std::sin(6 * d.y) * std::sin(5 * d.z + 1);
    const double r = 0.7 + waves + bump({1, 0.4, 0}, 0.1, 0.35) + bump({0.7, 1, 0.3}, 0.01, 0.5) +
                     bump({0.7, 1, -0.3}, 0.01, 0.5) + bump({-1, 0.2, 0}, 0.05, -0.2);
    p = d * (0.05 * r + 1e-4 * random.normal());
  }
  return mesh;
}

/// `variable` = the scan of GetParam() (an Origin); skips the test by name where it is not there.
#define PALPATE_SCAN_OR_SKIP(variable)                                                            \
  if (GetParam() == ::palpate::test::Origin::recorded && !::palpate::test::data_folder())         \
    GTEST_SKIP() << "SKIPPED: no real data for meshes_good/bunny_3k.off (set PALPATE_DATA)";      \
  const TriangleMesh variable = GetParam() == ::palpate::test::Origin::made                       \
                                    ? ::palpate::test::made_scan()                                \
                                    : ::palpate::test::read_off(*::palpate::test::data_folder() / \
                                                                "meshes_good/bunny_3k.off")

/// TEST_P(suite, ...) on both.
#define PALPATE_ON_SCANS(suite)                                                          \
  class suite : public testing::TestWithParam<::palpate::test::Origin> {};               \
  INSTANTIATE_TEST_SUITE_P(                                                              \
      Scans, suite,                                                                      \
      testing::Values(::palpate::test::Origin::recorded, ::palpate::test::Origin::made), \
      ::palpate::test::name_of)

}  // namespace palpate::test
