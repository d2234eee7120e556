#include "palpate/contact/contact.h"

#include <cmath>
#include <thread>
#include <type_traits>
#include <utility>

#include <gtest/gtest.h>

#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/contact_scenes.h"

namespace palpate {
namespace {

std::unique_ptr<ContactQuery> query_of(const std::shared_ptr<const ToolIndex>& index,
                                       const ContactMethod& method) {
  return make_contact_query(Place::cpu(), index, method).value();
}

TEST(ToolIndex, HasThePartsThatQueriesNeed) {
  const Tool tool = test::random_tool(200, 0.05, 3);
  const auto index = ToolIndex::create(tool);
  EXPECT_EQ(index->num_bytes(), 0u);
  const auto field = query_of(index, FieldMethod{});
  const std::size_t of_field = index->num_bytes();
  EXPECT_GT(of_field, 0u);
  const auto simplified = query_of(index, SimplifiedMethod{});
  const std::size_t of_points = index->num_bytes();
  EXPECT_GT(of_points, of_field);
  const auto weighted = query_of(index, WeightedMethod{});
  EXPECT_EQ(index->num_bytes(), of_points) << "the same parts";
  const auto graph = query_of(index, GraphMethod{});
  EXPECT_GT(index->num_bytes(), of_points);
  EXPECT_EQ(graph->index(), index);
}

// A query of a million spheres may take 16 MB beyond the index.
TEST(ToolIndex, AFieldQueryTakesLittleMoreThanTheIndex) {
  const Tool tool = test::block_of_spheres(20);
  const double num = static_cast<double>(tool.spheres().size());
  const auto index = ToolIndex::create(tool);
  const auto first = query_of(index, FieldMethod{});
  const std::size_t before = test::num_allocated_bytes();
  const auto second = query_of(index, FieldMethod{});
  const double beyond = static_cast<double>(test::num_allocated_bytes() - before);
  EXPECT_LE(beyond / num, 16);
  std::printf("%.1f bytes a sphere in the index, %.2f in each query by field\n",
              static_cast<double>(index->num_bytes()) / num, beyond / num);
}

TEST(ToolIndex, QueriesThatShareItHaveTheBitsOfThoseThatDoNot) {
  const Tool tool = test::random_tool(200, 0.05, 3);
  const PointCloud cloud = test::noisy_wall(160, 120, 140, 0.6, 0.001, 5);
  DepthField field = DepthField::create(160, 120).value();
  ThreadPool pool(1);
  field.update(cloud.view(), pool);
  const SurfaceView surface{cloud.view(), field.view()};
  const Pose X_WT{{0.01, 0.02, 0.58}, axis_angle({1, 2, 3}, 0.7)};
  const auto index = ToolIndex::create(tool);
  const ContactMethod methods[] = {FieldMethod{}, WeightedMethod{}, SimplifiedMethod{},
                                   GraphMethod{}};
  std::vector<Penetration> shared(std::size(methods));
  std::vector<std::thread> threads;
  for (std::size_t m = 0; m < std::size(methods); ++m) {
    threads.emplace_back(
        [&, m] { shared[m] = query_of(index, methods[m])->measure(surface, X_WT).penetration; });
  }
  for (std::thread& thread : threads) thread.join();
  for (std::size_t m = 0; m < std::size(methods); ++m) {
    const auto alone = make_contact_query(Place::cpu(), tool, methods[m]).value();
    const Penetration want = alone->measure(surface, X_WT).penetration;
    EXPECT_GT(want.volume, 0);
    EXPECT_EQ(shared[m].volume, want.volume);
    EXPECT_EQ(shared[m].measure_W.force, want.measure_W.force);
    EXPECT_EQ(shared[m].measure_W.torque, want.measure_W.torque);
  }
}

template <class T>
concept HasIndex = requires(T&& tool) {
  ToolIndex::create(std::forward<T>(tool));
};
static_assert(HasIndex<const Tool&> && !HasIndex<Tool>);

// Optional outputs do not change the measure.
TEST(ContactWants, LeaveTheMeasureAlone) {
  const Tool tool = test::random_tool(200, 0.05, 3);
  const PointCloud cloud = test::noisy_wall(160, 120, 140, 0.6, 0.001, 5);
  DepthField field = DepthField::create(160, 120).value();
  ThreadPool pool(1);
  field.update(cloud.view(), pool);
  const SurfaceView surface{cloud.view(), field.view()};
  std::vector<SphereState> states(200);
  std::vector<Plane<float>> planes(200);
  for (const ContactMethod& method :
       {ContactMethod(FieldMethod{}), ContactMethod(WeightedMethod{}),
        ContactMethod(SimplifiedMethod{}), ContactMethod(GraphMethod{})}) {
    const auto query = make_contact_query(Place::cpu(), tool, method).value();
    const bool is_field = std::holds_alternative<FieldMethod>(method);
    test::Random random(8);
    for (int i = 0; i < 50; ++i) {
      const Pose X_WT{{0, 0, random.uniform(0.5, 0.65)}, random.rotation(3.0)};
      const ContactResult plain = query->measure(surface, X_WT);
      const ContactResult full =
          query->measure(surface, X_WT, {.stiffness = true, .states = states, .planes = planes});
      EXPECT_FALSE(plain.stiffness);
      EXPECT_EQ(full.stiffness.has_value(), is_field);
      EXPECT_EQ(plain.penetration.volume, full.penetration.volume);
      EXPECT_EQ(plain.penetration.potential, full.penetration.potential);
      EXPECT_EQ(plain.penetration.measure_W.force, full.penetration.measure_W.force);
      EXPECT_EQ(plain.penetration.measure_W.torque, full.penetration.measure_W.torque);
      const auto num_inside = std::count(states.begin(), states.end(), SphereState::inside);
      EXPECT_EQ(num_inside, full.penetration.num_inside_spheres);
    }
  }
}

TEST(ContactMethod, RefusesOptionsThatItDoesNotHave) {
  const auto message = [](const ContactOptions& options) {
    const auto method = contact_method(options);
    return method ? std::string() : method.error().message;
  };
  using enum MethodKind;
  EXPECT_EQ(message({.method = field, .edges = Edges::cut}),
            "edges does not go with the method field: leave it out, or choose another method");
  EXPECT_NE(message({.method = field, .priority = Priority::count}), "");
  EXPECT_NE(message({.method = field, .inside = InsideVolume::cap}), "");
  EXPECT_NE(message({.method = field, .continuity = Continuity::entry}), "");
  EXPECT_NE(message({.method = graph, .priority = Priority::count}), "");
  EXPECT_NE(message({.method = simplified, .inside = InsideVolume::cap}), "");
  EXPECT_EQ(message({.method = graph, .inside = InsideVolume::cap, .edges = Edges::cut}), "");
  // There and back.
  const ContactOptions options{.method = graph,
                               .inside = InsideVolume::cap,
                               .volumes = SphereVolumes::represented,
                               .edges = Edges::strict,
                               .continuity = Continuity::kernel};
  EXPECT_EQ(contact_options(contact_method(options).value()), options);
}

}  // namespace
}  // namespace palpate
