// Where a run is computed, and what happens when that fails in its middle: the force fades out and
// the run ends.
#include <algorithm>
#include <string>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "palpate/session/report.h"
#include "src/session/run_files.h"
#include "src/session/run_loop.h"
#include "src/session/settings_json.h"
#include "tests/session/synthetic_stream.h"

namespace palpate {
namespace {

using test::SyntheticStream;

constexpr int kGoodTicks = 20;

/// Feels the same at every tick, until its GPU is lost.
class FailingQuery final : public ContactQuery {
 public:
  void set_cloud(const PointCloudView&) noexcept override {}
  void set_field(const DepthFieldView&) noexcept override {}
  Penetration query(const Pose&, const ContactOptions&) noexcept override {
    Penetration result;
    if (num_ticks_++ < kGoodTicks) {
      result.volume = 4;
      result.potential = 2;
      result.measure_W = {{1, 2, -3}, {0, 8, 1}};
      result.num_boundary_spheres = 5;
    } else {
      result.status = StepStatus::backend_failed;
    }
    return result;
  }
  Stiffness stiffness() const noexcept override { return {}; }
  std::span<const SphereState> states() const noexcept override { return {}; }
  std::span<const Plane<float>> planes() const noexcept override { return {}; }

 private:
  int num_ticks_ = 0;
};

class BackendFailure : public testing::Test {
 protected:
  Session make_session() {
    RunSettings settings;
    settings.time.mode = TimeMode::latest;  // one query a tick
    return std::move(
               Session::create(tool_, stream_.info(), settings, std::make_unique<FailingQuery>()))
        .value();
  }

  Tool tool_ = test::small_tool();
  SyntheticStream stream_{8};
};

TEST_F(BackendFailure, FadesTheForceOut) {
  Session session = make_session();
  constexpr double kStep = 0.001;
  for (int k = 0; k < kGoodTicks; ++k) {
    const TickRecord tick = session.tick(k * kStep, {});
    EXPECT_EQ(tick.penetration.volume, 4);
    EXPECT_EQ(tick.penetration.status.bits, 0u);
    EXPECT_TRUE(session.status());
  }
  const double last_good = (kGoodTicks - 1) * kStep;
  for (int k = kGoodTicks; k < kGoodTicks + 60; ++k) {
    const double time = k * kStep;
    const double share = std::max(0.0, 1 - (time - last_good) / Session::kFadeTime);
    const TickRecord tick = session.tick(time, {});
    EXPECT_DOUBLE_EQ(tick.penetration.volume, 4 * share);
    EXPECT_DOUBLE_EQ(tick.penetration.potential, 2 * share);
    EXPECT_DOUBLE_EQ(tick.penetration.measure_W.force.z, -3 * share);
    EXPECT_DOUBLE_EQ(tick.penetration.measure_W.torque.y, 8 * share);
    EXPECT_EQ(tick.penetration.status, StepStatus::backend_failed);
    EXPECT_EQ(session.is_faded_out(), share == 0);
    ASSERT_FALSE(session.status());
  }
  EXPECT_NE(session.status().error().message.find("GPU"), std::string::npos);
}

TEST_F(BackendFailure, EndsTheRunWithItsReason) {
  Session session = make_session();
  const auto log = run_loop(session, stream_,
                            [](std::size_t, double time) { return test::pressing_pose(time); }, {});
  ASSERT_TRUE(log) << log.error().message;
  EXPECT_EQ(log->failure, session.status().error().message);
  EXPECT_FALSE(log->interrupted);
  // The last good tick, and 50 ms of fading.
  EXPECT_NEAR(static_cast<double>(log->ticks.size()), kGoodTicks + 50, 1);
  EXPECT_EQ(log->ticks.back().penetration.volume, 0);
  EXPECT_NE(summary_json(tool_, *log).find("\"failure\": \"the GPU"), std::string::npos);
  const auto report = make_report(tool_, *log);
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_NE(report->find("The force was faded out"), std::string::npos);
}

TEST_F(BackendFailure, LongAfterTheLastTickNothingIsFelt) {
  Session session = make_session();
  for (int k = 0; k < kGoodTicks; ++k) session.tick(0, {});
  const TickRecord tick = session.tick(1, {});  // long after the last one
  EXPECT_EQ(tick.penetration.volume, 0);
  EXPECT_TRUE(session.is_faded_out());
}

TEST(BackendChoice, IsKeptWithTheSettings) {
  RunSettings settings;
  settings.backend = Backend::cuda;
  settings.sensing_gpu = 1;
  settings.contact_gpu = 2;
  auto json = to_json(settings);
  auto read = settings_from_json(json);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->backend, Backend::cuda);
  EXPECT_EQ(read->sensing_gpu, 1);
  EXPECT_EQ(read->contact_gpu, 2);
  json["loop"].erase("sensing_gpu");
  read = settings_from_json(json);
  ASSERT_FALSE(read);
  EXPECT_NE(read.error().message.find("loop.sensing_gpu"), std::string::npos);
}

#if !defined(PALPATE_CUDA)
TEST(BackendChoice, AutoSaysWhyItIsTheCpu) {
  const Tool tool = test::small_tool();
  SyntheticStream stream(3);
  RunSettings settings;
  settings.backend = std::nullopt;
  const auto log = run_session(
      tool, stream, [](std::size_t, double time) { return test::pressing_pose(time); }, settings);
  ASSERT_TRUE(log) << log.error().message;
  EXPECT_EQ(log->settings.backend, Backend::cpu);
  EXPECT_NE(log->why_not_cuda.find("no CUDA backend"), std::string::npos);
  EXPECT_NE(summary_json(tool, *log).find("\"why_not_cuda\": \"this build"), std::string::npos);
  settings.backend = Backend::cuda;
  EXPECT_FALSE(Session::create(tool, stream.info(), settings));
}
#endif

}  // namespace
}  // namespace palpate
