// A ball in thirty parts, corrected by a plane: exact on planes, the derivative of one potential,
// and never a force without volume.
#include "src/contact/internal/ball_cut.h"

#include <gtest/gtest.h>

#include <cmath>

#include "src/contact/internal/ball_parts.h"
#include "tests/test_util/ball_truth.h"
#include "tests/test_util/random.h"

#pragma GCC diagnostic ignored "-Wpsabi"

namespace palpate {
namespace {

typedef double Row __attribute__((vector_size(256)));
struct SumOfRow {
  double operator()(const Row& row) const {
    double sum = 0;
    for (int i = 0; i < 32; ++i) sum += row[i];
    return sum;
  }
};

BallRows<Row> ball_rows() {
  BallRows<Row> rows{};
  Row* const all[] = {&rows.x, &rows.y, &rows.z, &rows.is_part};
  for (int axis = 0; axis < 4; ++axis) {
    for (int i = 0; i < 32; ++i) (*all[axis])[i] = ball_places().rows[axis][i];
  }
  return rows;
}

Row parts_only(const BallRows<Row>& at, const Row& phi) {
  const Row factor = at.is_part / (30 * std::pow(double{kPartRadius}, 3));
  return cut_ball<Row>(Row{} + double{kPartRadius}, factor, phi).volume;
}

Row plane_values(const BallRows<Row>& at, const Vec3d& n, double distance) {
  return distance + n.x * at.x + n.y * at.y + n.z * at.z;
}

/// Values near a plane with a gradient that is about as long as it should be.
Row rough_values(const BallRows<Row>& at, double roughness, test::Random& random) {
  const Vec3d n = rotate(random.rotation(kPi), Vec3d{0, 0, random.uniform(0.85, 1.15)});
  Row phi = plane_values(at, n, random.uniform(-1.2, 1.2));
  for (int k = 0; k < 30; ++k) phi[k] += random.uniform(-roughness, roughness);
  return phi;
}

constexpr double kWhole = 4 * kPi / 3;

TEST(BallCut, IsExactOnPlanes) {
  const BallRows<Row> at = ball_rows();
  const SumOfRow sum;
  test::Random random(1);
  for (int i = 0; i < 20000; ++i) {
    const Vec3d n = rotate(random.rotation(kPi), Vec3d{0, 0, 1});
    const double distance = random.uniform(-1.2, 1.2);
    const Row phi = plane_values(at, n, distance);
    const auto plane = ball_plane<double>(at, phi, sum, false);
    const Row volume = parts_only(at, phi) + plane.volume;
    EXPECT_NEAR(sum(volume), cap_volume(1.0, distance), 1e-6 * kWhole);
    // The force acts along the normal through the center.
    const Vec3d moment{sum(volume * at.x), sum(volume * at.y), sum(volume * at.z)};
    EXPECT_LT(norm(cross(moment, n)), 1e-6 * kWhole);
    const double count = 1 / (30 * std::pow(double{kPartRadius}, 3));
    double potential = plane.potential;
    for (int k = 0; k < 30; ++k) potential += count * test::cap_potential(kPartRadius, phi[k]);
    EXPECT_NEAR(potential, test::cap_potential(1, distance), 1e-6 * kWhole);
  }
}

TEST(BallCut, IsTheDerivativeOfOnePotential) {
  const BallRows<Row> at = ball_rows();
  const SumOfRow sum;
  test::Random random(2);
  int num_planes = 0, num_bent = 0;
  for (int i = 0; i < 2000; ++i) {
    const Row phi = rough_values(at, random.uniform(0, 0.35), random);
    const auto plane = ball_plane<double>(at, phi, sum, true);
    (plane.is_plane ? num_planes : num_bent)++;
    test::BallValues values;
    for (int k = 0; k < 30; ++k) values[static_cast<std::size_t>(k)] = phi[k];
    const test::BallValues want = test::ball_corrections(values);
    ASSERT_NEAR(plane.potential, test::ball_correction(values), 1e-6);
    for (int k = 0; k < 30; ++k) {
      ASSERT_NEAR(plane.volume[k], want[static_cast<std::size_t>(k)], 2e-6);
    }
    // Second derivatives, along some change of the values.
    Row change{};
    for (int k = 0; k < 30; ++k) change[k] = random.uniform(-1, 1);
    constexpr double kStep = 1e-5;
    const auto moved = [&](double step) {
      return ball_plane<double>(at, phi + step * change, sum, false).volume;
    };
    const double truth = sum((moved(-kStep) - moved(kStep)) / (2 * kStep) * change);
    Row weights[5];
    form_weights(at, plane.residual, weights);
    double got = plane.disc * sum(change * change);
    for (int k = 0; k < 5; ++k) {
      for (int j = 0; j < 5; ++j) {
        got += plane.form[k][j] * sum(weights[k] * change) * sum(weights[j] * change);
      }
    }
    ASSERT_NEAR(got, truth, 1e-4);
  }
  EXPECT_GT(num_planes, 500);
  EXPECT_GT(num_bent, 300);
}

// It is small, so no ball has much less than nothing, and where values are no plane it is none.
TEST(BallCut, TakesLittleAndOnlyFromPlanes) {
  const BallRows<Row> at = ball_rows();
  const SumOfRow sum;
  test::Random random(3);
  double most = 0, least = 0;
  for (int i = 0; i < 5000; ++i) {
    const Row phi = rough_values(at, random.uniform(0, 0.3), random);
    const auto plane = ball_plane<double>(at, phi, sum, false);
    most = std::max(most, std::abs(sum(plane.volume)));
    least = std::min(least, sum(parts_only(at, phi) + plane.volume));
  }
  const Row edge = at.x > 0.0 ? at.z + 0.1 : Row{} + 3.0;  // the far side is beyond a silhouette
  EXPECT_FALSE(ball_plane<double>(at, edge, sum, false).is_plane);
  EXPECT_LT(most, 0.0077 * kWhole);
  EXPECT_GT(least, -0.003 * kWhole);
  EXPECT_EQ(force_scale(0.0, 1.0), 0);
  EXPECT_EQ(force_scale(-1.0, 1.0), 0);
  EXPECT_EQ(force_scale(0.0, 0.0), 1);
  EXPECT_EQ(force_scale(1.0, 1.04), 1);
  EXPECT_NEAR(force_scale(1.0, 2.1), 0.5, 1e-6);
}

}  // namespace
}  // namespace palpate
