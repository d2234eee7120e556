// The viewer's door: clients that do not end their request, do not take its answer, or come too
// often.
#include "src/viewer/server/door_limits.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "tests/test_util/wait_for.h"
#include "tests/viewer/page_client.h"
#include "tests/viewer/scripted_source.h"

namespace palpate {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;
using test::RawSocket;
using test::wait_for;

// Limits that docs/security.md promises.
static_assert(DoorLimits().request_time == std::chrono::seconds(10));
static_assert(DoorLimits().answer_time == std::chrono::seconds(30));
static_assert(DoorLimits().connections_per_second == 250);
static_assert(DoorLimits().connections_at_once == 500);

const std::string kHello = "GET /api/hello HTTP/1.1\r\nHost: localhost\r\n\r\n";

struct Door {
  explicit Door(const DoorLimits& limits, test::ScriptedScene scene = {})
      : source(std::move(scene)) {
    ViewServerOptions options;
    options.port = 0;
    auto started = start_view_server(source, options, limits);
    EXPECT_TRUE(started.has_value()) << started.error().message;
    server = *std::move(started);
    const std::string url = server->url();
    port = std::stoi(url.substr(url.rfind(':') + 1));
  }
  test::ScriptedSource source;
  std::unique_ptr<ViewServer> server;
  int port = 0;
};

// The time is that of the whole request: a byte now and then does not prolong it.
TEST(ViewDoor, ARequestThatDoesNotEndIsClosed) {
  const Door door({.request_time = milliseconds(300), .answer_time = hours(1)});
  for (const bool trickles : {false, true}) {
    RawSocket socket(door.port);
    ASSERT_TRUE(socket.send("GET /api/state HTTP/1.1\r\nX: "));
    EXPECT_TRUE(wait_for([&] {
      if (trickles) socket.send("x");
      EXPECT_EQ(socket.receive(0.02), "");
      return socket.is_closed();
    })) << trickles;
  }
}

TEST(ViewDoor, ARequestThatTakesItsTimeIsAnswered) {
  const Door door({.request_time = hours(1), .answer_time = hours(1)});
  RawSocket socket(door.port);
  std::string answer;
  for (const char byte : kHello) {
    ASSERT_TRUE(socket.send(std::string(1, byte)));
    answer += socket.receive(0.005);
    ASSERT_FALSE(socket.is_closed());
  }
  EXPECT_TRUE(wait_for([&] { return answer += socket.receive(0.02), answer.size() > 100; }));
  EXPECT_EQ(test::status_of(answer), 200);
}

// More than the buffers between both hold, and the client reads nothing of it.
TEST(ViewDoor, AnAnswerThatNobodyTakesIsGivenUp) {
  test::ScriptedScene scene;
  scene.title = std::string(1 << 20, 'x');
  const Door door({.request_time = hours(1), .answer_time = milliseconds(2000)}, scene);
  RawSocket socket(door.port);
  std::string requests;
  for (int i = 0; i < 100; ++i) requests += kHello;
  ASSERT_TRUE(socket.send(requests));
  // A client that sends to a closed connection gets an error.
  EXPECT_TRUE(wait_for([&] { return !socket.send("\r\n"); }));
  RawSocket reader(door.port);
  ASSERT_TRUE(reader.send(kHello));
  std::string answer;
  EXPECT_TRUE(wait_for([&] { return answer += reader.receive(0.02), answer.size() > 1 << 20; }));
}

// The time is compared from below only: however slow the machine, no more come in.
TEST(ViewDoor, WhoComesTooOftenIsLetInLater) {
  constexpr int kAtOnce = 5, kMore = 20;
  constexpr double kPerSecond = 20;
  const Door door({.connections_per_second = kPerSecond, .connections_at_once = kAtOnce});
  const double begin = monotonic_now();
  std::vector<std::unique_ptr<RawSocket>> clients;
  std::vector<std::string> answers(kAtOnce + kMore);
  for (int i = 0; i < kAtOnce + kMore; ++i) {
    clients.push_back(std::make_unique<RawSocket>(door.port));
    ASSERT_TRUE(clients.back()->send(kHello));
  }
  for (std::size_t i = 0; i < clients.size(); ++i) {
    EXPECT_TRUE(wait_for([&] {
      answers[i] += clients[i]->receive(0.01);
      return test::status_of(answers[i]) == 200;
    })) << i;
  }
  EXPECT_GE(monotonic_now() - begin, (kMore - 1) / kPerSecond);
}

}  // namespace
}  // namespace palpate
