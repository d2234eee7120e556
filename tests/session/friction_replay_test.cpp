// Runs with friction and texture, recorded and repeated to the bit.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "palpate/session/run.h"
#include "src/io/internal/atomic_file.h"
#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_messages.h"
#include "src/session/internal/run_reader.h"
#include "tests/session/flowing_stream.h"
#include "tests/session/path_run.h"
#include "tests/session/repeated_run.h"
#include "tests/session/synthetic_stream.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using test::FlowingStream;
using test::SyntheticStream;

/// Presses and slides to and fro.
Pose sliding_pose(double time) {
  return {{0.02 * std::sin(9 * time), 0.005, 0.44 + 0.06 * std::min(1.0, 8 * time)},
          axis_angle({0, 0, 1}, 0.4 * std::sin(5 * time))};
}

class FrictionRun : public ::testing::Test {
 protected:
  FrictionRun() {
    settings_.coupling.friction.coefficient = 0.4;
    settings_.coupling.friction.static_ratio = 1.2;
    settings_.coupling.texture.kind = TextureKind::grain;
  }
  Result<RunOutcome> record(const fs::path& name) {
    SyntheticStream stream(8);
    auto device = test::path_device(sliding_pose, settings_.contact_rate);
    return record_run(tool_, stream, **device, settings_, name);
  }
  void expect_repeats() { EXPECT_GT(test::repeated(run()).num_ticks, 200u); }
  fs::path run() const { return folder_.path() / "run"; }

  test::TemporaryFolder folder_;
  Tool tool_ = test::small_tool();
  RunSettings settings_ = test::path_settings();
};

TEST_F(FrictionRun, RepeatsToTheBitByEveryCoupling) {
  for (const CouplingKind kind : {CouplingKind::none, CouplingKind::virtual_coupling,
                                  CouplingKind::direct, CouplingKind::proxy}) {
    settings_.coupling.kind = kind;
    ASSERT_TRUE(record(run()));
    expect_repeats();
    const auto summary = nlohmann::json::parse(read_file(run() / "summary.json").value());
    EXPECT_EQ(summary.at("settings").at("friction").at("coefficient"), 0.4);
    EXPECT_EQ(summary.at("settings").at("texture").at("kind"), "grain");
  }
}

TEST_F(FrictionRun, RepeatsToTheBitByMethodsWithoutStiffness) {
  settings_.contact.method = MethodKind::weighted;
  settings_.coupling.kind = CouplingKind::virtual_coupling;
  ASSERT_TRUE(record(run()));
  expect_repeats();
}

TEST_F(FrictionRun, ObjectsKeepTheirOwn) {
  const auto shape = std::make_shared<const Tool>(test::random_tool(150, 0.04, 9));
  settings_.coupling.friction.coefficient = 0;
  settings_.objects = {{shape, {{0.05, 0, 0.47}, {}}, 0.6}, {shape, {{-0.05, 0, 0.47}, {}}}};
  ASSERT_TRUE(record(run()));
  expect_repeats();
  const auto summary = nlohmann::json::parse(read_file(run() / "summary.json").value());
  EXPECT_EQ(summary.at("objects").at(0).at("friction"), 0.6);
  EXPECT_FALSE(summary.at("objects").at(1).contains("friction"));
  settings_.objects[1].friction = -1;
  EXPECT_FALSE(record(folder_.path() / "other"));
}

// Half of what the camera sees is of wood, a part says nothing.
TEST_F(FrictionRun, RegionsAreRecordedAndRepeated) {
  MaterialRegions regions{96, 72, {}, {{}, Material{0.3, 1.2, 0.5, 0, 0.4}, {}, Material{0.05}}};
  for (int i = 0; i < 96 * 72; ++i) {
    regions.labels.push_back(static_cast<std::uint8_t>(i % 96 < 48 ? 1 : i / 96 < 30 ? 3 : 0));
  }
  settings_.regions = {std::make_shared<const MaterialRegions>(regions)};
  for (const CouplingKind kind : {CouplingKind::none, CouplingKind::virtual_coupling}) {
    settings_.coupling.kind = kind;
    ASSERT_TRUE(record(run()));
    expect_repeats();
  }
  auto reader = RunReader::open(run());
  ASSERT_TRUE(reader && reader->load_tools());
  const auto& recorded = reader->setup().settings.regions;
  ASSERT_EQ(recorded.size(), 1u);
  EXPECT_EQ(recorded[0]->labels, regions.labels);
  EXPECT_EQ(recorded[0]->materials, regions.materials);
  regions.width = 95;
  settings_.regions = {std::make_shared<const MaterialRegions>(regions)};
  const auto refused = record(folder_.path() / "other");
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("96 x 72"), std::string::npos);
}

TEST_F(FrictionRun, AFlowIsRecordedAndRepeated) {
  for (const CouplingKind kind : {CouplingKind::none, CouplingKind::virtual_coupling}) {
    settings_.coupling.kind = kind;
    FlowingStream stream(8);
    auto device = test::path_device(sliding_pose, settings_.contact_rate);
    ASSERT_TRUE(record_run(tool_, stream, **device, settings_, run()));
    expect_repeats();
  }
  auto reader = RunReader::open(run());
  ASSERT_TRUE(reader);
  EXPECT_TRUE(reader->setup().streams[0].has_flow);
  FlowingStream stream(8);
  RecordedDepth read;
  DepthFrame frame;
  for (int i = 0; i < 8; ++i) {
    ASSERT_TRUE(reader->next_frame(read).value());
    ASSERT_TRUE(stream.next(frame).value());
    EXPECT_EQ(read.frame.flow, frame.flow) << i;
    EXPECT_EQ(read.frame.flow.empty(), i == 4);
  }
  // It is felt: contacts of frame 5 know how their ground moves, those of frame 4 do not.
  reader = RunReader::open(run());
  int num_published[8] = {}, num_touched[8] = {};
  for (;;) {
    const auto message = reader->next();
    ASSERT_TRUE(message);
    if (!*message) break;
    if ((*message)->topic != kContactTopic) continue;
    const ContactRecord contact = read_contact((*message)->data).value();
    if (!(contact.penetration.volume > 0)) continue;
    const auto frame_number = static_cast<std::size_t>(contact.frame_number);
    ++num_touched[frame_number];
    num_published[frame_number] += norm(contact.contact.patch.ground.velocity_W) > 0.01 ? 1 : 0;
  }
  EXPECT_GT(num_touched[4], 20);
  EXPECT_EQ(num_published[4], 0);
  EXPECT_GT(num_touched[5], 20);
  EXPECT_EQ(num_published[5], num_touched[5]);
}

TEST_F(FrictionRun, ContactsWithAndWithoutGroundAreReadBack) {
  ContactRecord record;
  record.number = 7;
  const std::string plain = contact_message(record);
  const auto without = read_contact(plain);
  ASSERT_TRUE(without) << without.error().message;
  EXPECT_EQ(contact_message(*without), plain);
  // Its last number counts the deviations, which older recordings lack.
  EXPECT_TRUE(read_contact(std::string_view(plain).substr(0, plain.size() - 4)));
  EXPECT_FALSE(read_contact(std::string_view(plain).substr(0, plain.size() - 5)));  // cut off
  record.contact.patch.ground = {0.5, 0.1, 0.2, 0.3, 0.4, 0.5, {1, 2, 3}, {4, 5, 6}};
  const auto read = read_contact(contact_message(record));
  ASSERT_TRUE(read);
  EXPECT_EQ(read->contact.patch.ground, record.contact.patch.ground);
}

// The same hand and frames with another friction.
TEST_F(FrictionRun, IsTriedWithOtherFriction) {
  ASSERT_TRUE(record(run()));
  const auto again =
      retry_run(run(), folder_.path() / "again", [](RunSettings& settings) -> Status {
        settings.coupling.friction.coefficient = 0;
        return Done{};
      });
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_GT(again->forces.max, 0.1);
}

}  // namespace
}  // namespace palpate
