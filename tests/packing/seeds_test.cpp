#include "src/packing/seeds.h"

#include <gtest/gtest.h>

#include "palpate/mesh/mesh.h"

namespace palpate {
namespace {

struct Start {
  explicit Start(const TriangleMesh& solid) : box(bounds(solid)), mesh(solid) {}
  std::optional<StartingPoints> points(int num_threads, const std::function<bool()>& keep_going) {
    ThreadPool pool(num_threads);
    return starting_points(space, box, 1, pool, keep_going);
  }

  Bounds box;
  TriangleBvh mesh;
  SphereLevels spheres;
  FreeSpace space{mesh, spheres, 1e300};
};

TEST(Seeds, LieInsideAndDoNotDependOnThreads) {
  Start start(make_torus(0.04, 0.015, 48, 24));
  const auto one = start.points(1, [] { return true; });
  const auto two = start.points(2, [] { return true; });
  ASSERT_TRUE(one && two);
  ASSERT_GT(one->balls.size(), 1000u);
  ASSERT_EQ(one->balls.size(), two->balls.size());
  for (std::size_t i = 0; i < one->balls.size(); ++i) {
    const Ball &a = one->balls[i], &b = two->balls[i];
    ASSERT_TRUE(a.center == b.center && a.radius == b.radius) << i;
    ASSERT_TRUE(start.mesh.inside(a.center)) << i;
  }
}

TEST(Seeds, StopWhenAsked) {
  Start start(make_torus(0.04, 0.015, 48, 24));
  for (const int answer_no_at : {1, 5, 40}) {
    int num_questions = 0;
    EXPECT_FALSE(start.points(2, [&] { return ++num_questions < answer_no_at; }));
    EXPECT_EQ(num_questions, answer_no_at);
  }
}

}  // namespace
}  // namespace palpate
