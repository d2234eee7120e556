// Poses and answers in the memory of the GPU: the same bits as in host memory, in the caller's
// stream, a few at a time, and captured in a graph.
#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "src/contact/cuda/gpu_field.h"
#include "src/gpu/internal/runtime.h"
#include "tests/contact/scene/answered_scene.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

using test::Answered;
using test::Both;
using test::HullScene;
using test::Random;
using test::surfaces_of;

/// Poses that are near to three cameras, two bodies and nothing, of two tools.
struct Mixed {
  Random random{36};
  HullScene seen = test::rough_scene(3, {}, random);
  Tool tool = test::random_tool(60, 0.05, 3), small = test::random_tool(20, 0.03, 4);
  Tool shape =
      Tool::pack(make_box({0.1, 0.1, 0.1}), {.max_spheres = 50}).value().with_solid_field();
  const Tool* tools[2] = {&tool, &small};
  Scene scene{.surfaces = surfaces_of(seen), .bodies = {Body(shape, {{0.1, 0, 0.8}, {}})}};
  std::vector<Pose> poses;
  std::vector<std::int32_t> tool_of_pose, group_of_pose;

  Mixed() {
    for (int i = 0; i < 20; ++i) {
      const double x = random.uniform(-0.3, 0.3), y = random.uniform(-0.2, 0.2);
      poses.push_back({{x, y, random.uniform(0.5, 1.3)}, random.rotation(3)});
      tool_of_pose.push_back(i % 2);
      group_of_pose.push_back(i / 4);
    }
    poses[5].translation.x = NAN;
  }
  /// With `kAtOnce` poses in a launch.
  template <std::size_t kAtOnce>
  SceneContact contact() const {
    return test::scenes_on_gpu<kAtOnce>(tools);
  }
};

/// Arrays on the GPU for what an Answered has, of P poses and no groups and spheres.
struct AnsweredThere {
  explicit AnsweredThere(std::size_t num) : num_numbers(num * test::kNumNumbers) {
    numbers = memory.take<double>(num_numbers);
    test::lay_out(answers, numbers, num);
    answers.contact.status = memory.take<std::uint32_t>(num);
    answers.contact.gpu = 0;
    answers.nearest = memory.take<std::int32_t>(num);
    answers.decided = memory.take<std::int32_t>(num);
  }
  /// Copies all to the host.
  void fetch(Answered& to, gpu::Stream& stream) const {
    stream.copy(to.numbers.data(), numbers, num_numbers * sizeof(double));
    const auto copy = [&](auto& into, const auto* from) {
      stream.copy(into.data(), from, into.size() * sizeof(into[0]));
    };
    copy(to.status, answers.contact.status);
    copy(to.nearest, answers.nearest);
    copy(to.decided, answers.decided);
    EXPECT_TRUE(stream.wait());
  }

  std::size_t num_numbers;
  gpu::Memory memory{0};
  double* numbers = nullptr;
  SceneAnswers answers;
};

void expect_same(const Answered& a, const Answered& b) {
  EXPECT_EQ(a.numbers, b.numbers);
  EXPECT_EQ(a.status, b.status);
  EXPECT_EQ(a.nearest, b.nearest);
  EXPECT_EQ(a.decided, b.decided);
}

// Poses and answers there, in the caller's stream, a few at a time and all at once, and captured.
TEST(SceneArraysCuda, ArraysInItsMemoryHaveTheSameBits) {
  PALPATE_GPU_OR_SKIP();
  const Mixed of;
  const std::size_t num = of.poses.size();
  const SceneContact whole = of.contact<64>(), parts = of.contact<7>();
  Answered want(num, 0, 0);
  ASSERT_TRUE(whole.measure(of.scene, {of.poses, of.tool_of_pose}, want.answers));
  std::vector<std::uint8_t> hits(num), group_hits(5);
  ASSERT_TRUE(whole.any(of.scene, {of.poses, of.tool_of_pose}, 0.02, hits.data()));
  ASSERT_TRUE(whole.any(of.scene, {of.poses, of.tool_of_pose, of.group_of_pose, 5}, 0.02,
                        group_hits.data()));
  EXPECT_GT(std::ranges::count_if(want.nearest, [](std::int32_t i) { return i >= 0; }), 5);
  EXPECT_EQ(hits[5], 1);  // it is not finite

  gpu::Stream stream(0, gpu::Priority::low);
  const CallerStream queue{stream.handle()};
  gpu::Memory memory(0);
  const Pose* const X_WT = memory.copy_of(of.poses);
  auto* const hits_there = memory.take<std::uint8_t>(num);
  const auto fetched = [&](std::size_t size) {
    std::vector<std::uint8_t> here(size);
    stream.copy(here.data(), hits_there, size);
    EXPECT_TRUE(stream.wait());
    return here;
  };
  for (const SceneContact* const contact : {&whole, &parts}) {
    for (const bool has_stream : {true, false}) {
      const auto in = has_stream ? std::optional(queue) : std::nullopt;
      ScenePoses there{{X_WT, num}, of.tool_of_pose, {}, 0, 0};
      Answered got(num, 0, 0), here(num, 0, 0), from_host(num, 0, 0);
      AnsweredThere to(num);
      ASSERT_TRUE(contact->measure(of.scene, there, to.answers, in));
      to.fetch(got, stream);
      expect_same(got, want);
      ASSERT_TRUE(contact->measure(of.scene, there, here.answers, in));
      expect_same(here, want);
      ASSERT_TRUE(contact->measure(of.scene, {of.poses, of.tool_of_pose}, to.answers, in));
      to.fetch(from_host, stream);
      expect_same(from_host, want);
      ASSERT_TRUE(contact->any(of.scene, there, 0.02, hits_there, in));
      EXPECT_EQ(fetched(num), hits);
      there.group_of_pose = of.group_of_pose;
      there.num_groups = 5;
      ASSERT_TRUE(contact->any(of.scene, there, 0.02, hits_there, in));
      EXPECT_EQ(fetched(5), group_hits);
    }
    std::vector<std::uint8_t> others(5);
    ASSERT_TRUE(contact->any(of.scene, {of.poses, of.tool_of_pose, of.group_of_pose, 5}, 0.02,
                             others.data()));
    EXPECT_EQ(others, group_hits);
  }
}

TEST(SceneArraysCuda, AGraphCapturesASceneThatWasAskedBefore) {
  PALPATE_GPU_OR_SKIP();
  const Mixed of;
  const std::size_t num = of.poses.size();
  const Tool* const tools[] = {&of.tool};
  const SceneContact contact = test::scenes_on_gpu<7>(tools);
  Answered want(num, 0, 0), got(num, 0, 0);
  gpu::Stream stream(0, gpu::Priority::low);
  const CallerStream queue{stream.handle()};
  gpu::Memory memory(0);
  Pose* const X_WT = memory.take<Pose>(num);
  AnsweredThere to(num);
  const ScenePoses there{{X_WT, num}, {}, {}, 0, 0};
  auto* const hits = memory.take<std::uint8_t>(num);
  stream.begin_recording();
  const Status late = contact.any(of.scene, there, 0.02, hits, queue);
  (void)stream.end_recording();
  ASSERT_FALSE(late);
  EXPECT_NE(late.error().message.find("ask it once before"), std::string::npos);
  ASSERT_TRUE(contact.any(of.scene, there, 0.02, hits, queue));
  ASSERT_TRUE(contact.measure(of.scene, there, to.answers, queue));
  ASSERT_TRUE(stream.wait());
  stream.begin_recording();
  const Status measured = contact.measure(of.scene, there, to.answers, queue);
  const Status asked = contact.any(of.scene, there, 0.02, hits, queue);
  const Status refused = contact.any(of.scene, {of.poses}, 0.02, hits, queue);
  const gpu::Graph graph = stream.end_recording();
  ASSERT_TRUE(measured) << measured.error().message;
  ASSERT_TRUE(asked) << asked.error().message;
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("cannot be captured"), std::string::npos);
  memory.upload(X_WT, of.poses.data(), num * sizeof(Pose));
  stream.launch(graph);
  to.fetch(got, stream);
  std::vector<std::uint8_t> want_hits(num), got_hits(num);
  stream.copy(got_hits.data(), hits, num);
  ASSERT_TRUE(stream.wait());
  ASSERT_TRUE(contact.measure(of.scene, {of.poses}, want.answers));
  ASSERT_TRUE(contact.any(of.scene, {of.poses}, 0.02, want_hits.data()));
  expect_same(got, want);
  EXPECT_EQ(got_hits, want_hits);
}

// A lone joined camera in host memory is two scenes: by what it sees, and by what it has not seen.
TEST(SceneArraysCuda, AGraphCapturesALoneJoinedCameraWithWhatItHasNotSeen) {
  PALPATE_GPU_OR_SKIP();
  Random random(40);
  const HullScene seen = test::rough_scene(1, {}, random);
  const Scene scene{.surfaces = surfaces_of(seen)};
  const Tool tool = test::random_tool(60, 0.05, 3);
  const Tool* const tools[] = {&tool};
  const SceneContact contact = test::scenes_on_gpu(tools);
  const std::vector<Pose> poses{{{0.05, 0, 0.9}, {}}, {{0, 0.03, 1.2}, {}}};
  Answered want(2, 0, 0), got(2, 0, 0);
  ASSERT_TRUE(contact.measure(scene, {poses}, want.answers));
  EXPECT_GT(want.answers.unseen[1], 0);
  gpu::Stream stream(0, gpu::Priority::low);
  gpu::Memory memory(0);
  AnsweredThere to(2);
  const ScenePoses there{{memory.copy_of(poses), 2}, {}, {}, 0, 0};
  stream.begin_recording();
  const Status measured = contact.measure(scene, there, to.answers, CallerStream{stream.handle()});
  const gpu::Graph graph = stream.end_recording();
  ASSERT_TRUE(measured) << measured.error().message;
  stream.launch(graph);
  to.fetch(got, stream);
  expect_same(got, want);
}

TEST(SceneArraysCuda, AnotherSceneThatIsRefusedInACaptureLeavesTheLastOne) {
  PALPATE_GPU_OR_SKIP();
  const Mixed of;
  const Tool other =
      Tool::pack(make_box({0.2, 0.1, 0.1}), {.max_spheres = 20}).value().with_solid_field();
  const Tool* const tools[] = {&of.tool};
  const SceneContact contact = test::scenes_on_gpu(tools);
  const std::size_t num = of.poses.size();
  Answered want(num, 0, 0), got(num, 0, 0);
  const auto contact_of = [](SceneAnswers answers) {
    answers.clearance = answers.clearance_gradient = nullptr;
    answers.nearest = answers.decided = nullptr;
    return answers;
  };
  ASSERT_TRUE(contact.measure(of.scene, {of.poses}, contact_of(want.answers)));
  gpu::Stream stream(0, gpu::Priority::low);
  const CallerStream queue{stream.handle()};
  gpu::Memory memory(0);
  AnsweredThere to(num);
  const ScenePoses there{{memory.copy_of(of.poses), num}, {}, {}, 0, 0};
  stream.begin_recording();
  const Status late = contact.measure({.surfaces = of.scene.surfaces, .bodies = {Body(other)}},
                                      there, contact_of(to.answers), queue);
  const Status measured = contact.measure(of.scene, there, contact_of(to.answers), queue);
  const gpu::Graph graph = stream.end_recording();
  ASSERT_FALSE(late);
  EXPECT_NE(late.error().message.find("ask it once before"), std::string::npos);
  ASSERT_TRUE(measured) << measured.error().message;
  stream.launch(graph);
  to.fetch(got, stream);
  expect_same(got, want);
}

// Its pose is an argument of the launch, and so that of the capture.
TEST(SceneArraysCuda, AGraphKeepsThePoseOfOneCamera) {
  PALPATE_GPU_OR_SKIP();
  Random random(41);
  HullScene seen = test::rough_scene(1, {}, random);
  test::set_apart(seen.views[0].from, seen.views[0].to);
  gpu::Stream stream(0, gpu::Priority::low);
  GpuFields copies(0);
  Scene scene{.surfaces = surfaces_of(seen)};
  SurfaceView& camera = scene.surfaces[0];
  camera.field = copies.on_gpu(camera.field, stream);
  ASSERT_TRUE(stream.wait());
  camera.X_WC = {{0.1, 0, 0}, axis_angle({1, 2, 3}, 0.1)};
  const Tool tool = test::random_tool(60, 0.05, 3);
  const Tool* const tools[] = {&tool};
  const SceneContact contact = test::scenes_on_gpu(tools);
  const std::vector<Pose> poses{{{0.15, 0, 1.1}, {}}, {{0.1, 0.03, 1.2}, {}}};
  double want[2], got[2];
  SceneAnswers here, to;
  here.contact.volume = want;
  ASSERT_TRUE(contact.measure(scene, {poses}, here));
  EXPECT_GT(want[1], 0);
  gpu::Memory memory(0);
  to.contact = {.volume = memory.take<double>(2), .gpu = 0};
  const ScenePoses there{{memory.copy_of(poses), 2}, {}, {}, 0, 0};
  stream.begin_recording();
  ASSERT_TRUE(contact.measure(scene, there, to, CallerStream{stream.handle()}));
  const gpu::Graph graph = stream.end_recording();
  camera.X_WC.translation.z = 5;
  here.contact.volume = got;
  ASSERT_TRUE(contact.measure(scene, {poses}, here));
  EXPECT_NE(got[1], want[1]);
  stream.launch(graph);
  stream.copy(got, to.contact.volume, sizeof(got));
  ASSERT_TRUE(stream.wait());
  EXPECT_EQ(got[0], want[0]);
  EXPECT_EQ(got[1], want[1]);
}

TEST(SceneArraysCuda, ACameraWithoutAFrameHasNothingUnseen) {
  PALPATE_GPU_OR_SKIP();
  const Tool tool = test::random_tool(10, 0.03, 3);
  const Tool* const tools[] = {&tool};
  const Both both(tools);
  const Scene scene{.surfaces = {SurfaceView{}}};
  const std::vector<Pose> poses{{{0, 0, 1}, {}}};
  for (const SceneContact* const contact : {&both.cpu, &both.gpu}) {
    double volume = 7, unseen = 7;
    std::uint32_t status = 0;
    SceneAnswers answers;
    answers.contact = {.volume = &volume, .status = &status};
    answers.unseen = &unseen;
    ASSERT_TRUE(contact->measure(scene, {poses}, answers));
    EXPECT_EQ(volume, 0);
    EXPECT_EQ(unseen, 0);
    EXPECT_EQ(status, static_cast<std::uint32_t>(StepStatus::no_surface));
  }
}

// One camera at a pose in W is the batch of the contact, whose poses may lie there, too.
TEST(SceneArraysCuda, PosesInItsMemoryBeforeOneCameraAnywhere) {
  PALPATE_GPU_OR_SKIP();
  Random random(37);
  const HullScene seen = test::rough_scene(1, {}, random);
  const Tool tool = test::random_tool(60, 0.05, 3);
  const Tool* const tools[] = {&tool};
  const Both both(tools);
  Scene scene{.surfaces = surfaces_of(seen)};
  scene.surfaces[0].role = SurfaceRole::frame;
  std::vector<Pose> poses;
  for (int i = 0; i < 12; ++i) {
    const double x = random.uniform(-0.2, 0.2), y = random.uniform(-0.1, 0.1);
    poses.push_back({{x, y, random.uniform(0.9, 1.3)}, random.rotation(3)});
  }
  gpu::Memory memory(0);
  gpu::Stream stream(0, gpu::Priority::low);
  SceneAnswers there, here;
  there.contact = {.volume = memory.take<double>(12), .gpu = 0};
  for (const Pose& X : {Pose{}, Pose{{0.5, -1, 0.2}, axis_angle({1, 2, 3}, 0.7)}}) {
    const Pose X_WC = scene.surfaces[0].X_WC = X * seen.views[0].to.X_WC;
    std::vector<Pose> placed;
    for (const Pose& pose : poses) placed.push_back(X * pose);
    std::vector<double> want(12), got(12);
    here.contact.volume = want.data();
    ASSERT_TRUE(both.gpu.measure(scene, {placed}, here));
    EXPECT_GT(std::ranges::count_if(want, [](double volume) { return volume > 0; }), 2);
    const ScenePoses given{{memory.copy_of(placed), 12}, {}, {}, 0, 0};
    ASSERT_TRUE(both.gpu.measure(scene, given, there, CallerStream{stream.handle()}));
    stream.copy(got.data(), there.contact.volume, 12 * sizeof(double));
    ASSERT_TRUE(stream.wait());
    EXPECT_EQ(got, want) << X_WC.translation.x;
  }
}

TEST(SceneArraysCuda, ArraysElsewhereAreRefusedInOneSentence) {
  PALPATE_GPU_OR_SKIP();
  Random random(38);
  const HullScene seen = test::rough_scene(1, {}, random);
  const Tool tool = test::random_tool(10, 0.03, 3);
  const Tool* const tools[] = {&tool};
  const Both both(tools);
  const Scene scene{.surfaces = surfaces_of(seen)};
  gpu::Memory memory(0);
  const std::int32_t group[1] = {};
  SceneAnswers answers;
  answers.contact = {.volume = memory.take<double>(1), .gpu = 0};
  answers.clearance = memory.take<double>(1);
  auto* const hits = memory.take<std::uint8_t>(1);
  ScenePoses poses{{memory.take<Pose>(1), 1}, {}, {}, 0, 0};
  const auto expect = [](const Status& status, const char* words) {
    ASSERT_FALSE(status);
    EXPECT_NE(status.error().message.find(words), std::string::npos) << status.error().message;
  };
  expect(both.cpu.measure(scene, poses, answers), "given to a contact on the CPU; create it with");
  expect(both.cpu.any(scene, poses, 0, hits), "given to a contact on the CPU; create it with");
  poses.gpu = 3;
  expect(both.gpu.any(scene, poses, 0, hits), "in the memory of GPU 3 were given to a contact on");
  poses.gpu = 0;
  answers.group_clearance = memory.take<double>(1);
  poses.group_of_pose = group;
  poses.num_groups = 1;
  expect(both.gpu.measure(scene, poses, answers), "groups are put together in host memory");
  answers.group_clearance = nullptr;
  answers.sphere_depth = memory.take<float>(10);
  answers.max_spheres = 10;
  const double mine = 7;
  memory.upload(answers.contact.volume, &mine, sizeof mine);
  expect(both.gpu.measure(scene, poses, answers), "give poses and answers in host memory");
  gpu::Stream stream(0, gpu::Priority::low);
  double left = 0;
  stream.copy(&left, answers.contact.volume, sizeof left);
  ASSERT_TRUE(stream.wait());
  EXPECT_EQ(left, mine) << "written before it was refused";
}

TEST(SceneArraysCuda, NothingIsWrittenBeforeAClearanceIsRefused) {
  PALPATE_GPU_OR_SKIP();
  Random random(42);
  const HullScene seen = test::rough_memories(2, random);
  const Tool tool = test::random_tool(10, 0.03, 3);
  const Tool* const tools[] = {&tool};
  const Both both(tools);
  const std::vector<Pose> poses{test::pose_in_front(seen, random)};
  for (const SceneContact* const contact : {&both.cpu, &both.gpu}) {
    double volume = 7, clearance = 7;
    SceneAnswers answers;
    answers.contact.volume = &volume;
    answers.clearance = &clearance;
    EXPECT_FALSE(contact->measure({.surfaces = surfaces_of(seen)}, {poses}, answers));
    EXPECT_EQ(volume, 7);
    EXPECT_EQ(clearance, 7);
  }
}

}  // namespace
}  // namespace palpate
