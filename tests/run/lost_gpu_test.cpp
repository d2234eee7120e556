// A GPU that is lost in the middle of a live run, on any machine: what settings call cuda is
// computed by the CPU until a test says that it is lost. The linker puts `emulated_query` and
// `emulated_surfaces` in the place of what makes queries and surfaces (CMakeLists.txt): all around
// it is what users run. gpu_loss_test.cu loses a real one.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <memory>
#include <string>
#include <utility>

#include "palpate/field/sensor.h"
#include "tests/run/live_loop_fixtures.h"

namespace palpate {
namespace {

std::atomic<bool> g_is_lost = false, g_is_cpu_lost = false;

/// Another query, until what it runs on is lost.
class QueryUntilLost final : public ContactQuery {
 public:
  QueryUntilLost(std::unique_ptr<ContactQuery> query, const std::atomic<bool>& is_lost)
      : ContactQuery(query->index(), query->method()),
        query_(std::move(query)),
        is_lost_(is_lost) {}

  using ContactQuery::measure;
  ContactResult measure_one(const SurfaceView& from, const SurfaceView& to, double alpha,
                            const Pose& X_CT, const ContactWants& wants) const noexcept override {
    if (!is_lost_) return query_->measure(from, to, alpha, X_CT, wants);
    ContactResult nothing;
    nothing.penetration.status = StepStatus::backend_failed;
    return nothing;
  }

 private:
  std::unique_ptr<ContactQuery> query_;
  const std::atomic<bool>& is_lost_;
};

}  // namespace

// PALPATE_MAKE_QUERY and PALPATE_MAKE_SURFACES are the names that the compiler gives
// make_contact_query and SurfaceTimeline::create.
using MadeQuery = Result<std::unique_ptr<ContactQuery>>;
MadeQuery usual_query(const Place& place, std::shared_ptr<const ToolIndex> index,
                      const ContactMethod& method,
                      const ExecutionOptions& options) asm("__real_" PALPATE_MAKE_QUERY);
MadeQuery emulated_query(const Place& place, std::shared_ptr<const ToolIndex> index,
                         const ContactMethod& method,
                         const ExecutionOptions& options) asm("__wrap_" PALPATE_MAKE_QUERY);
MadeQuery emulated_query(const Place& place, std::shared_ptr<const ToolIndex> index,
                         const ContactMethod& method, const ExecutionOptions& options) {
  auto query = usual_query(Place::cpu(), std::move(index), method, options);
  if (!query) return query.error();
  return std::unique_ptr<ContactQuery>(std::make_unique<QueryUntilLost>(
      *std::move(query), place.backend == Backend::cuda ? g_is_lost : g_is_cpu_lost));
}

using MadeSurfaces = Result<SurfaceTimeline>;
MadeSurfaces usual_surfaces(const DepthStreamInfo& stream, const TimelineOptions& options,
                            const Place& place) asm("__real_" PALPATE_MAKE_SURFACES);
MadeSurfaces emulated_surfaces(const DepthStreamInfo& stream, const TimelineOptions& options,
                               const Place& place) asm("__wrap_" PALPATE_MAKE_SURFACES);
MadeSurfaces emulated_surfaces(const DepthStreamInfo& stream, const TimelineOptions& options,
                               const Place&) {
  return usual_surfaces(stream, options, {});
}

namespace {

/// A hand in a wall, measured by what is called a GPU.
struct Touching {
  explicit Touching(Backend backend) : device({.hand = [](double) { return Vec3d{0, 0, 0.04}; }}) {
    g_is_lost = g_is_cpu_lost = false;
    RunSettings settings = test::patient_settings();
    settings.backend = backend;
    settings.safety.recover_seconds = 0.02;
    loop = RunLoop::create(test::box_tool(), source, device, settings).value();
    EXPECT_TRUE(loop->start());
    EXPECT_TRUE(test::wait_for([&] { return is_felt(); }));
  }
  bool is_felt() {
    newest = loop->latest().value_or(newest);
    return norm(newest.F_H_B.force) > 0.5 && newest.safety.is_engaged();
  }
  bool has_note(const char* words) const {
    const auto notes = loop->report().notes;
    return std::ranges::any_of(
        notes, [&](const std::string& note) { return note.find(words) != std::string::npos; });
  }

  test::WallSource source{test::WallSource::Options()};
  test::ScriptedDevice device;
  TickRecord newest;
  std::unique_ptr<RunLoop> loop;
};

TEST(LostGpu, TheRunGoesOnWithTheCpu) {
  Touching touching(Backend::cuda);
  RunLoop& loop = *touching.loop;
  EXPECT_EQ(loop.settings().backend, Backend::cuda);
  EXPECT_FALSE(touching.has_note("the GPU is lost"));
  g_is_lost = true;
  EXPECT_TRUE(test::wait_for([&] { return loop.settings().backend == Backend::cpu; }));
  EXPECT_TRUE(touching.has_note("the GPU is lost"));
  // The hand stays in contact, so it has to ask for the force.
  EXPECT_TRUE(test::wait_for([&] {
    loop.request_force();
    return touching.is_felt();
  })) << touching.newest.F_H_B.force.z;
  EXPECT_GT(touching.newest.safety.num_faults, 0u);
  EXPECT_TRUE(loop.is_running());
  EXPECT_TRUE(loop.status());
}

TEST(LostGpu, WithoutAnythingElseTheForceFadesAndTheRunEnds) {
  Touching touching(Backend::cpu);
  g_is_cpu_lost = true;
  EXPECT_TRUE(test::wait_for([&] { return !touching.loop->is_running(); }));
  EXPECT_TRUE(test::wait_for([&] { return touching.device.last_force() == 0; }));
  const Status status = touching.loop->status();
  ASSERT_FALSE(status);
  EXPECT_NE(status.error().message.find("did not answer"), std::string::npos)
      << status.error().message;
}

}  // namespace
}  // namespace palpate
