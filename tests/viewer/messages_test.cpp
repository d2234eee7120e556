#include "src/viewer/protocol/messages.h"

#include <limits>
#include <optional>

#include <gtest/gtest.h>

#include "src/viewer/server/page_outbox.h"
#include "tests/viewer/message_reader.h"
#include "tests/viewer/scripted_source.h"

namespace palpate {
namespace {

using test::MessageReader;
using test::ScriptedScene;
using test::ScriptedSource;
using Json = nlohmann::json;

MessageReader read(const std::string& bytes, int kind) {
  MessageReader reader(bytes);
  EXPECT_EQ(reader.kind, kind);
  EXPECT_EQ(reader.protocol, 3);
  return reader;
}

TEST(Messages, SpheresGraphAndMeshAreTheTools) {
  const ScriptedSource source;
  const Tool& tool = source.tool();

  MessageReader spheres = read(encode_spheres(tool.spheres()), 1);
  ASSERT_EQ(spheres.take<std::uint32_t>(), 4u);
  EXPECT_EQ(spheres.take<float>(4), (std::vector{-0.06f, 0.f, 0.f, 0.025f}));
  EXPECT_EQ(spheres.take<float>(12).size(), 12u);
  EXPECT_TRUE(spheres.is_at_end());

  MessageReader graph = read(encode_graph(tool.graph()), 2);
  const auto num_edges = graph.take<std::uint32_t>();
  ASSERT_EQ(num_edges, static_cast<std::uint32_t>(tool.graph().num_edges()));
  for (const auto& [a, b] : tool.graph().edges()) {
    EXPECT_EQ(graph.take<std::uint32_t>(), static_cast<std::uint32_t>(a));
    EXPECT_EQ(graph.take<std::uint32_t>(), static_cast<std::uint32_t>(b));
  }
  EXPECT_TRUE(graph.is_at_end());

  MessageReader mesh = read(encode_mesh(tool.mesh()), 3);
  ASSERT_EQ(mesh.take<std::uint32_t>(), 8u);
  ASSERT_EQ(mesh.take<std::uint32_t>(), 12u);
  for (const Vec3d& vertex : tool.mesh().vertices)
    EXPECT_EQ(mesh.take<float>(3),
              (std::vector{float(vertex.x), float(vertex.y), float(vertex.z)}));
  for (const auto& triangle : tool.mesh().triangles)
    EXPECT_EQ(mesh.take<std::uint32_t>(3),
              std::vector<std::uint32_t>(triangle.begin(), triangle.end()));
  EXPECT_TRUE(mesh.is_at_end());
}

TEST(Messages, ObjectsAreTheirMeshes) {
  const ScriptedSource source;
  const auto tool = std::make_shared<const Tool>(source.tool());
  const std::vector<std::shared_ptr<const Tool>> objects{tool, tool};
  MessageReader reader = read(encode_objects(objects), 5);
  ASSERT_EQ(reader.take<std::uint32_t>(), 2u);
  const std::string alone = encode_mesh(tool->mesh());
  EXPECT_EQ(encode_objects(objects).size(), 16 + 4 + 2 * (alone.size() - 16));
  for (int i = 0; i < 2; ++i) {
    ASSERT_EQ(reader.take<std::uint32_t>(), tool->mesh().vertices.size());
    ASSERT_EQ(reader.take<std::uint32_t>(), tool->mesh().triangles.size());
    reader.take<float>(3 * tool->mesh().vertices.size());
    EXPECT_EQ(reader.take<std::uint32_t>(3 * tool->mesh().triangles.size()).back(),
              tool->mesh().triangles.back()[2]);
  }
  EXPECT_TRUE(reader.is_at_end());
}

TEST(Messages, TreeHasInnerNodesWithTheirLevels) {
  const ScriptedSource source(test::big_scene(64, 8, 8));
  const auto nodes = source.tool().tree().nodes();
  MessageReader tree = read(encode_tree(source.tool().tree()), 4);
  const auto count = tree.take<std::uint32_t>();
  ASSERT_EQ(count, 1u + 4 + 16);  // 64 leaves, four children each
  std::size_t next = 0;
  for (const IstNode& node : nodes) {
    if (node.num_children == 0) continue;
    ++next;
    EXPECT_EQ(tree.take<float>(4), (std::vector{node.bound.center.x, node.bound.center.y,
                                                node.bound.center.z, node.bound.radius}));
  }
  EXPECT_EQ(next, count);
  std::vector<int> per_level(3);
  for (const std::uint8_t level : tree.take<std::uint8_t>(count)) ++per_level.at(level);
  EXPECT_EQ(per_level, (std::vector{1, 4, 16}));
  EXPECT_TRUE(tree.is_at_end());
}

TEST(Messages, FrameIsTheRawImageOfACameraSomewhere) {
  const Pose X_WC{{1, 2, 3}, {0, 0.6, 0, 0.8}};
  ViewFrame frame{7, 2.5, {3, 2, 0.00025, {0, 65535, 1, 2, 3, 0x1234}, 0, X_WC}, 5};
  MessageReader reader = read(encode_frame(frame), 10);
  EXPECT_EQ(reader.number, 7u);
  EXPECT_EQ(reader.time, 2.5);
  EXPECT_EQ(reader.take<std::uint16_t>(), 3);
  EXPECT_EQ(reader.take<std::uint16_t>(), 2);
  EXPECT_EQ(reader.take<std::uint16_t>(), 5);
  EXPECT_EQ(reader.take<std::uint16_t>(), 0);
  EXPECT_EQ(reader.position() % 8, 0u);  // pages look at the numbers where they lie
  EXPECT_EQ(reader.take<double>(7), (std::vector<double>{1, 2, 3, 0, 0.6, 0, 0.8}));
  EXPECT_EQ(reader.take<double>(), 0.00025);
  EXPECT_EQ(reader.position(), 88u);
  EXPECT_EQ(reader.take<std::uint16_t>(6), frame.frame.pixels);
  EXPECT_TRUE(reader.is_at_end());
}

TEST(Messages, ContactHasPlanesOnlyOfSpheresThatTheyCut) {
  const ScriptedScene scene;
  const Pose X_WT{{1, 2, 3}, {0, 0.6, 0, 0.8}};
  const Pose X_WB{{4, 5, 6}, {0.8, 0, 0.6, 0}};
  const ViewContact contact{1.25, 3, X_WT, {scene.states, scene.planes, {}, {}}, {Pose{}, X_WB}};
  MessageReader reader = read(encode_contact(contact, scene.spheres, 9), 11);
  EXPECT_EQ(reader.number, 9u);
  EXPECT_EQ(reader.time, 1.25);
  EXPECT_EQ(reader.take<double>(7), (std::vector<double>{1, 2, 3, 0, 0.6, 0, 0.8}));
  ASSERT_EQ(reader.take<std::uint32_t>(), 4u);
  EXPECT_EQ(reader.take<std::uint8_t>(4), (std::vector<std::uint8_t>{0, 1 + 4, 2, 2 + 4}));
  ASSERT_EQ(reader.take<std::uint32_t>(), 2u);
  EXPECT_EQ(reader.take<float>(8), (std::vector{0.f, -1.f, 0.f, 0.f, -1.f, 0.f, 0.f, 0.01f}));
  ASSERT_EQ(reader.take<std::uint32_t>(), 2u);
  EXPECT_EQ(reader.take<double>(7), (std::vector<double>{0, 0, 0, 0, 0, 0, 1}));
  EXPECT_EQ(reader.take<double>(7), (std::vector<double>{4, 5, 6, 0.8, 0, 0.6, 0}));
  EXPECT_TRUE(reader.is_at_end());
}

TEST(Messages, ContactIsPaddedAndTakesOddPlanes) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<Sphere> spheres(6, {{0, 0, 1}, 0.5f});
  // Beside the sphere on either side, touching it, no numbers, of an outside sphere, not there.
  const ViewContact contact{0,
                            0,
                            {},
                            {{SphereState::inside, SphereState::inside, SphereState::boundary,
                              SphereState::boundary, SphereState::outside, SphereState::inside},
                             {{{0, 0, 1}, 1.6f},
                              {{0, 0, 1}, 0.4f},
                              {{0, 0, 1}, 1.5f},
                              {{nan, 0, 0}, nan},
                              {{0, 0, 1}, 1.f}},
                             {},
                             {}}};
  MessageReader reader = read(encode_contact(contact, spheres, 0), 11);
  reader.take<double>(7);
  ASSERT_EQ(reader.take<std::uint32_t>(), 6u);
  EXPECT_EQ(reader.take<std::uint8_t>(6), (std::vector<std::uint8_t>{2, 2, 1, 1, 0, 2}));
  EXPECT_EQ(reader.take<std::uint8_t>(2), (std::vector<std::uint8_t>{0, 0}));
  EXPECT_EQ(reader.position() % 4, 0u);
  EXPECT_EQ(reader.take<std::uint32_t>(), 0u);
  EXPECT_EQ(reader.take<std::uint32_t>(), 0u);
  EXPECT_TRUE(reader.is_at_end());
}

TEST(Messages, ContactSaysWhoDecidedAndWhatNobodySees) {
  const std::vector<Sphere> spheres(6, {{0, 0, 1}, 0.5f});
  constexpr SphereState kInside = SphereState::inside;
  const ViewContact contact{
      0,
      0,
      {},
      {{kInside, kInside, kInside, SphereState::outside, SphereState::outside, kInside},
       {},
       {0, 2, kNoCamera, kNoCamera, 1, 15},
       {0, 1, 1, 1, 0, 0}}};
  MessageReader reader = read(encode_contact(contact, spheres, 0), 11);
  reader.take<double>(7);
  ASSERT_EQ(reader.take<std::uint32_t>(), 6u);
  EXPECT_EQ(reader.take<std::uint8_t>(6),
            (std::vector<std::uint8_t>{2 + 16, 2 + 8 + 48, 2 + 8, 8, 0, 2 + 240}));
}

TEST(Messages, NormalsAreBytesAndEdgesAList) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const ViewSurface surface{5,
                            2,
                            2,
                            {{1, 2, 3}, {4, 5, 6}, {nan, nan, nan}, {7, 8, 9}},
                            {{0, -0.6f, -0.8f}, {nan, nan, nan}, {0, 0, -1}, {1, 0, 0}},
                            {{}, {0.1f, 0.2f, 0}, {1, 1, 1}, {nan, 0, 0}}};
  MessageReader normals = read(encode_normals(surface, 4, 0.5), 12);
  EXPECT_EQ(normals.number, 4u);
  EXPECT_EQ(normals.time, 0.5);
  EXPECT_EQ(normals.take<std::uint16_t>(), 2);
  EXPECT_EQ(normals.take<std::uint16_t>(), 2);
  EXPECT_EQ(normals.take<std::int8_t>(16),
            (std::vector<std::int8_t>{0, -76, -102, 0, 0, 0, 0, 0, 0, 0, -127, 0, 127, 0, 0, 0}));
  EXPECT_TRUE(normals.is_at_end());

  MessageReader edges = read(encode_edges(surface, 4, 0.5), 13);
  ASSERT_EQ(edges.take<std::uint32_t>(), 1u);
  EXPECT_EQ(edges.take<float>(6), (std::vector{4.f, 5.f, 6.f, 0.1f, 0.2f, 0.f}));
  EXPECT_TRUE(edges.is_at_end());
}

TEST(Messages, SamplesHaveTheColumnsThatHelloNames) {
  ScriptedSource source;
  const Json hello = Json::parse(hello_text(source, tool_radius(source.tool())));
  const auto columns = hello["columns"].get<std::vector<std::string>>();
  const std::vector<ViewSample> samples = {test::scripted_sample(100250, 1000),
                                           test::scripted_sample(100251, 1000)};
  MessageReader reader = read(encode_samples(samples, 77), 20);
  EXPECT_EQ(reader.number, 77u);
  EXPECT_EQ(reader.time, 100.25);
  ASSERT_EQ(reader.take<std::uint32_t>(), 2u);
  ASSERT_EQ(reader.take<std::uint32_t>(), columns.size());
  for (const ViewSample& sample : samples) {
    Json row;
    for (const std::string& column : columns) row[column] = reader.take<float>();
    EXPECT_EQ(row["time"], float(sample.time - 100.25));
    EXPECT_EQ(row["force_x"], float(sample.F_H_B.force.x));
    EXPECT_EQ(row["torque_z"], 0.03f);
    EXPECT_EQ(row["contact_force_z"], -2.f);
    EXPECT_EQ(row["contact_torque_x"], 0.1f);
    EXPECT_EQ(row["volume"], float(sample.volume));
    EXPECT_EQ(row["objects_volume"], float(0.25 * sample.volume));
    EXPECT_EQ(row["compute"], 4.f);
    EXPECT_EQ(row["contact_age"], 0.001f);
    EXPECT_EQ(row["sensor_age"], 0.02f);
    EXPECT_EQ(row["stretch"], 0.005f);
    EXPECT_EQ(row["gain"], 1.f);
    EXPECT_EQ(row["energy"], float(sample.energy));
    EXPECT_EQ(row["tool_x"], float(sample.X_WT.translation.x));
    EXPECT_EQ(row["tool_qw"], 1.f);
    EXPECT_EQ(row["hand_y"], 0.01f);
    EXPECT_EQ(row["hand_qw"], 1.f);
  }
  EXPECT_TRUE(reader.is_at_end());
}

TEST(Messages, HelloAndStateSayWhatThereIs) {
  ScriptedScene scene;
  scene.title = "tool\xff.palp";  // not UTF-8
  scene.cameras.resize(2);
  ScriptedSource source(scene);
  const Json hello = Json::parse(hello_text(source, tool_radius(source.tool())));
  EXPECT_EQ(hello["type"], "hello");
  EXPECT_EQ(hello["protocol"], 3);
  EXPECT_EQ(hello["kind"], "live");
  EXPECT_EQ(hello["tool"]["spheres"], 4);
  EXPECT_NEAR(hello["tool"]["volume"].get<double>(), 0.2 * 0.2 * 0.1, 1e-12);
  EXPECT_GT(hello["tool"]["radius"].get<double>(), 0.15);  // half the diagonal, about
  EXPECT_LT(hello["tool"]["radius"].get<double>(), 0.19);
  ASSERT_EQ(hello["streams"].size(), 2u);
  EXPECT_EQ(hello["streams"][1]["name"], "scripted");
  EXPECT_EQ(hello["streams"][1]["width"], 64);
  EXPECT_EQ(hello["streams"][1]["cx"], 31.5);
  EXPECT_EQ(hello["streams"][1]["is_moving"], false);
  EXPECT_EQ(hello["controls"].size(), 3u);

  const Json state = Json::parse(state_text(source, 2));
  EXPECT_EQ(state["type"], "state");
  EXPECT_EQ(state["pages"], 2);
  EXPECT_EQ(state["settings"]["contact.method"], "field");
}

// Pages, without a network.

struct Outbox {
  explicit Outbox(ViewHub& hub) : outbox(hub) {}
  /// All that it would send now: names of texts, kinds of binary messages.
  std::vector<std::string> take(double now) {
    std::vector<std::string> names;
    while (const ViewMessage message = outbox.next(now)) {
      if (message.is_text) {
        last_text = Json::parse(*message.bytes);
        names.push_back(last_text["type"]);
        if (names.back() == "picture") last_picture = last_text["number"];
      } else {
        last_binary.emplace(*message.bytes);
        last_bytes = message.bytes;
        names.push_back(std::to_string(last_binary->kind));
      }
      if (names.size() > 100) break;
    }
    return names;
  }
  void send(const Json& json) { outbox.receive(json.dump()); }

  PageOutbox outbox;
  Json last_text;
  std::uint64_t last_picture = 0;
  std::optional<MessageReader> last_binary;
  std::shared_ptr<const std::string> last_bytes;
};

using Names = std::vector<std::string>;

TEST(PageOutbox, SendsOnePictureAtATimeAndThenTheNewest) {
  ScriptedSource source;
  ViewHub hub(source);
  Outbox page(hub);
  source.set_time(1);
  hub.poll(0);
  EXPECT_EQ(page.take(0), (Names{"hello", "state"}));
  page.send({{"id", 1}, {"command", "show"}, {"frames", true}});
  EXPECT_EQ(page.take(0), Names{"answer"});  // pictures come of the next poll
  hub.poll(0.01);
  EXPECT_EQ(page.take(0.01), (Names{"10", "picture"}));
  EXPECT_EQ(page.last_binary->number, 30u);
  for (int i = 1; i <= 20; ++i) {
    source.set_time(1 + 0.1 * i);
    hub.poll(0.01 + 0.001 * i);
    EXPECT_EQ(page.take(0.01 + 0.001 * i), Names{});
  }
  page.send({{"ack", page.last_picture + 1}});  // not one that was sent
  EXPECT_EQ(page.take(0.05), Names{});
  page.send({{"ack", page.last_picture}});
  EXPECT_EQ(page.take(0.05), (Names{"10", "picture"}));
  EXPECT_EQ(page.last_binary->number, 90u);
  page.send({{"ack", page.last_picture}});
  EXPECT_EQ(page.take(0.05), Names{});  // nothing new
}

TEST(PageOutbox, SendsTheNewestFrameOfEachCamera) {
  ScriptedScene scene;
  scene.cameras = {Pose{}, {{1, 2, 3}, {}}};
  ScriptedSource source(scene);
  ViewHub hub(source);
  Outbox page(hub);
  source.set_time(1);
  hub.poll(0);
  page.send({{"command", "show"}, {"frames", true}});
  page.take(0);
  for (int i = 1; i <= 20; ++i) {
    source.set_time(1 + 0.1 * i);
    hub.poll(0.01 * i);
  }
  // Only the newest of twenty frames of each camera is sent.
  std::vector<std::pair<std::uint32_t, int>> frames;
  std::vector<double> x;
  while (const ViewMessage message = page.outbox.next(0.3)) {
    if (message.is_text) continue;
    MessageReader reader(*message.bytes);
    EXPECT_EQ(reader.kind, 10);
    reader.take<std::uint16_t>(2);
    frames.emplace_back(reader.number, reader.take<std::uint16_t>());
    reader.take<std::uint16_t>();
    x.push_back(reader.take<double>());
  }
  EXPECT_EQ(frames, (std::vector<std::pair<std::uint32_t, int>>{{90, 0}, {90, 1}}));
  EXPECT_EQ(x, (std::vector<double>{0, 1}));
}

TEST(PageOutbox, EncodesOnceForAllPages) {
  ScriptedSource source;
  ViewHub hub(source);
  Outbox first(hub), second(hub);
  for (Outbox* page : {&first, &second}) page->send({{"command", "show"}, {"contacts", true}});
  hub.poll(0);
  EXPECT_EQ(first.take(0), (Names{"hello", "answer", "state", "11", "picture"}));
  EXPECT_EQ(second.take(0), (Names{"hello", "answer", "state", "11", "picture"}));
  EXPECT_EQ(first.last_bytes, second.last_bytes);
  EXPECT_EQ(first.last_text["number"], 1);
}

TEST(PageOutbox, SendsEachPageWhatItSubscribesTo) {
  ScriptedSource source;
  source.set_time(1);
  ViewHub hub(source);
  Outbox all(hub), none(hub);
  all.send({{"command", "show"},
            {"frames", true},
            {"contacts", true},
            {"surfaces", true},
            {"samples", true}});
  hub.poll(0);
  source.set_time(1.1);
  hub.poll(0.1);
  EXPECT_EQ(all.take(0.1),
            (Names{"hello", "answer", "state", "10", "11", "12", "13", "20", "picture"}));
  EXPECT_EQ(none.take(0.1), (Names{"hello", "state"}));
  EXPECT_TRUE(source.subscription().frames);
  all.send({{"command", "show"}, {"frames", false}, {"surfaces", false}, {"contacts", false}});
  hub.poll(0.2);
  EXPECT_FALSE(source.subscription().frames);
  EXPECT_TRUE(source.subscription().samples);
}

TEST(PageOutbox, SendsEverySampleOfTheLastFourSecondsOnce) {
  ScriptedSource source;
  source.set_time(1);
  ViewHub hub(source);
  Outbox page(hub);
  hub.poll(0);
  page.send({{"command", "show"}, {"samples", true}});
  page.take(0);
  std::vector<float> energies;
  std::uint32_t expected = 0;
  for (int i = 1; i <= 50; ++i) {
    source.set_time(1 + 0.02 * i);
    hub.poll(0.02 * i);
    ASSERT_NE(page.take(0.02 * i).size(), 0u);
    const auto count = page.last_binary->take<std::uint32_t>();
    EXPECT_EQ(page.last_binary->number, expected);
    EXPECT_NEAR(page.last_binary->time, 1 + 0.001 * expected, 1e-9);
    expected += count;
    page.send({{"ack", page.last_picture}});
  }
  EXPECT_EQ(expected, 1000u);
  // Then the page sleeps for ten seconds.
  source.set_time(2.02);
  hub.poll(1.02);
  page.take(1.02);
  for (int i = 1; i <= 500; ++i) {
    source.set_time(2.02 + 0.02 * i);
    hub.poll(1.02 + 0.02 * i);
  }
  page.send({{"ack", page.last_picture}});
  page.take(11.02);
  EXPECT_EQ(page.last_binary->take<std::uint32_t>(), 4000u + 1);
}

TEST(PageOutbox, APageThatJoinsAPausedRunGetsItsLastSeconds) {
  ScriptedSource source;
  ViewHub hub(source);
  Outbox first(hub);
  first.send({{"command", "show"}, {"samples", true}});
  for (int i = 1; i <= 300; ++i) {
    source.set_time(0.02 * i);
    hub.poll(0.02 * i);
  }
  // Nothing new for a minute; then somebody else comes.
  for (int i = 0; i < 60; ++i) hub.poll(7 + i);
  Outbox second(hub);
  second.send({{"command", "show"}, {"samples", true}});
  hub.poll(68);
  EXPECT_EQ(second.take(68), (Names{"hello", "answer", "state", "20", "picture"}));
  EXPECT_EQ(second.last_binary->take<std::uint32_t>(), 4000u + 1);
  EXPECT_EQ(second.last_binary->number, 1999u);
  EXPECT_NEAR(second.last_binary->time, 1.999, 1e-9);
  second.send({{"ack", second.last_picture}});
  // It has them: once is enough, also after it looked away.
  second.send({{"command", "show"}, {"samples", false}});
  second.send({{"command", "show"}, {"samples", true}});
  hub.poll(69);
  EXPECT_EQ(second.take(69), (Names{"answer", "answer", "state"}));
  // A seek back: what was there is not of this time.
  source.set_time(0.5);
  hub.poll(70);
  source.set_time(0.6);
  hub.poll(71);
  Outbox third(hub);
  third.send({{"command", "show"}, {"samples", true}});
  hub.poll(72);
  third.take(72);
  EXPECT_EQ(third.last_binary->take<std::uint32_t>(), 100u);
  EXPECT_NEAR(third.last_binary->time, 0.5, 1e-9);
}

TEST(PageOutbox, APageThatDoesNotDrawGetsNoPictures) {
  ScriptedSource source;
  ViewHub hub(source);
  Outbox page(hub);
  page.send({{"command", "show"}, {"contacts", true}, {"samples", true}});
  hub.poll(0);
  page.take(0);
  hub.poll(0.5);
  EXPECT_TRUE(source.subscription().contacts);
  hub.poll(1.5);
  EXPECT_FALSE(source.subscription().contacts);
  EXPECT_TRUE(source.subscription().samples);
  page.send({{"ack", page.last_picture}});
  hub.poll(1.6);
  EXPECT_TRUE(source.subscription().contacts);
}

TEST(PageOutbox, AnswersEveryCommand) {
  ScriptedSource source;
  ViewHub hub(source);
  Outbox page(hub);
  hub.poll(0);
  page.take(0);
  const auto answer = [&page](const std::string& text) {
    page.outbox.receive(text);
    const Names names = page.take(0);
    EXPECT_FALSE(names.empty()) << text;
    EXPECT_EQ(page.last_text["type"], "answer") << text;
    return page.last_text;
  };
  EXPECT_EQ(answer(R"({"id": 7, "command": "set", "key": "contact.method", "value": "graph"})"),
            (Json{{"type", "answer"}, {"id", 7}, {"ok", true}}));
  EXPECT_EQ(source.settings()["contact.method"], "graph");
  EXPECT_TRUE(answer(R"({"id": 8, "command": "mark", "text": "here"})").contains("time"));
  for (const char* bad : {"",
                          "x",
                          "7",
                          "[]",
                          "null",
                          "{",
                          "{}",
                          R"({"id": "7", "command": "pause"})",
                          R"({"command": 7})",
                          R"({"command": ""})",
                          R"({"command": "no such"})",
                          R"({"ack": "1"})",
                          R"({"ack": -1})",
                          R"({"ack": 1.5})",
                          R"({"command": "show", "frames": 1})",
                          R"({"command": "get"})",
                          R"({"command": "get", "what": 1})",
                          R"({"command": "get", "what": "secrets"})",
                          R"({"command": "set", "key": "no"})",
                          "{\"command\": \"\xff\"}"}) {
    const Json said = answer(bad);
    EXPECT_EQ(said["ok"], false) << bad;
    EXPECT_GT(said["error"].get<std::string>().size(), 10u) << bad;
  }
  EXPECT_FALSE(source.is_paused());
  const std::string deep(60000, '[');
  EXPECT_EQ(answer(deep)["ok"], false);
  EXPECT_EQ(answer(R"({"command": "pause", "x": )" + deep + std::string(60000, ']') + "}")["ok"],
            true);
  page.outbox.receive_binary();
  page.take(0);
  EXPECT_EQ(page.last_text["ok"], false);

  page.send({{"id", 1.5}, {"command", "get"}, {"what", "spheres"}});
  EXPECT_EQ(page.take(0), (Names{"1", "answer"}));
  EXPECT_EQ(page.last_text["id"], 1.5);
  hub.poll(0);
  EXPECT_EQ(page.take(0), Names{"state"});  // commands may have changed it
}

}  // namespace
}  // namespace palpate
