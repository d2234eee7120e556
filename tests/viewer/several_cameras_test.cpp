// A recording of several cameras, of which one moves, looked at anywhere.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "palpate/session/run.h"
#include "src/viewer/repetition.h"
#include "tests/session/path_run.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/posed_wall.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate {
namespace {

using test::beside_wall;
using test::PosedWall;

constexpr double kRate = 200;  // of ticks, 1/s

Pose pressing(double time) {
  return {{0.01 * time, 0.005, 0.47 + 0.03 * std::sin(3 * time)},
          axis_angle({1, 2, 3}, 0.3 * time)};
}

TEST(RepetitionOfSeveralCameras, GivesTheSameBitsFromAnywhere) {
  const test::TemporaryFolder folder;
  const Tool tool = test::random_tool(200, 0.03, 7);
  PosedWall still([](double) { return beside_wall(0.5); }, 12, 0.5, 36);
  PosedWall moving([](double time) { return beside_wall(0.3 * std::sin(2 * time)); }, 30, 0.5, 90);
  auto device = test::path_device(pressing, kRate);
  std::vector<ContactRecord> contacts;
  RunMonitor monitor;
  monitor.observer.on_contact = [&](const ContactRecord& contact) { contacts.push_back(contact); };
  RunOptions options;
  options.monitor = &monitor;
  ASSERT_TRUE(record_run(tool, DepthSources({&still, &moving}), **device,
                         test::path_settings(kRate), folder.path() / "run", options));
  auto run = open_recorded_run(folder.path() / "run");
  ASSERT_TRUE(run) << run.error().message;
  EXPECT_EQ((*run)->streams().size(), 2u);
  Repetition repetition(**run);
  int num_felt = 0;
  // Forwards, near and far, and back.
  for (const std::size_t number : {0u, 70u, 71u, 72u, 90u, 400u, 401u, 50u, 500u, 499u}) {
    const ContactRecord& recorded = contacts[number];
    const auto query = (*run)->query_at(recorded.time + 1e-4);
    ASSERT_TRUE(query) << query.error().message;
    const auto there = repetition.go_to(*query, (*run)->settings(0), [] { return true; });
    ASSERT_TRUE(there) << there.error().message;
    ASSERT_TRUE(*there);
    const Penetration& repeated = repetition.measure();
    EXPECT_EQ(repeated.volume, recorded.penetration.volume) << number;
    EXPECT_EQ(repeated.potential, recorded.penetration.potential) << number;
    EXPECT_EQ(repeated.measure_W.force, recorded.penetration.measure_W.force) << number;
    num_felt += repeated.volume > 0;
  }
  EXPECT_GT(num_felt, 5);
}

}  // namespace
}  // namespace palpate
