// The server against clients that break its rules, ask too much, or take nothing.
#include <gtest/gtest.h>
#include <sys/socket.h>

#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "src/viewer/server/rate_limit.h"
#include "tests/test_util/random.h"
#include "tests/viewer/served_page.h"

namespace palpate {
namespace {

using namespace test::served_page;  // NOLINT: all of it
using test::http_request;
using test::PageClient;
using test::RawSocket;
using test::Received;
using test::status_of;

TEST(RateLimit, GivesSoManyASecondAndSomeAtOnce) {
  RateLimit limit(4, 3);
  for (int i = 0; i < 2; ++i) EXPECT_EQ(limit.take(100), 0);
  EXPECT_EQ(limit.take(100), 0.25);
  EXPECT_EQ(limit.take(100.25), 0.25);
  EXPECT_EQ(limit.take(100.5, 3), 0.75);  // counts as three
  EXPECT_EQ(limit.take(101.5), 0);        // a quarter of a second more than requested
  for (int i = 0; i < 2; ++i) EXPECT_EQ(limit.take(1000), 0);
  EXPECT_EQ(limit.take(1000), 0.25);  // whoever has been silent for long saves up no more
}

TEST(ViewServer, EndsConnectionsThatBreakTheRules) {
  const Fixture fixture;
  const auto ends = [&fixture](const std::function<void(PageClient&)>& misbehave) {
    PageClient page(fixture.port);
    misbehave(page);
    Received message;
    for (int i = 0; i < 200 && page.receive(message); ++i) {
    }
    return !page.is_open();
  };
  EXPECT_TRUE(ends([](PageClient& page) { page.send(std::string(65537, ' ')); }));
  EXPECT_TRUE(ends([](PageClient& page) { page.send_in_frames(std::string(70000, ' '), 1000); }));
  EXPECT_TRUE(ends([](PageClient& page) { page.send("{\"command\": \"\xff\xfe\"}"); }));
  const auto raw = [](const std::string& bytes) {
    return [bytes](PageClient& page) { ::send(page.handle(), bytes.data(), bytes.size(), 0); };
  };
  EXPECT_TRUE(ends(raw("\x81\x05hello")));                             // not masked
  EXPECT_TRUE(ends(raw(std::string("\xf1\x80\0\0\0\0", 6))));          // reserved bits
  EXPECT_TRUE(ends(raw(std::string("\x83\x80\0\0\0\0", 6))));          // unknown opcode
  EXPECT_TRUE(ends(raw(std::string("\x80\x80\0\0\0\0", 6))));          // nothing to continue
  EXPECT_TRUE(ends(raw(std::string("\x89\xfe\x01\x00\0\0\0\0", 8))));  // long ping
  EXPECT_TRUE(ends(raw(std::string("\x81\xff\x7f\xff\xff\xff\xff\xff\xff\xff\0\0\0\0", 14))));
  fixture.expect_alive();

  PageClient page(fixture.port);  // fragments of a good message are no crime
  EXPECT_TRUE(page.send_in_frames(R"({"id": 1, "command": "pause"})", 3));
  EXPECT_EQ(read_until(page, "answer")["ok"], true);
  EXPECT_TRUE(page.send("\x01\x02", false));
  EXPECT_EQ(read_until(page, "answer")["ok"], false);
}

TEST(ViewServer, LivesThroughTwentyThousandHostileMessages) {
  const Fixture fixture;
  test::Random random(5);
  const auto any = [&random](auto... choices) {
    const std::string list[] = {choices...};
    return list[random.bits() % sizeof...(choices)];
  };
  std::size_t num_answers = 0;
  std::vector<std::unique_ptr<PageClient>> pages;  // in turn: one alone would be read from slowly
  for (int k = 0; k < 8; ++k) pages.push_back(std::make_unique<PageClient>(fixture.port));
  for (int i = 0; i < 20000; ++i) {
    PageClient& page = *pages[static_cast<std::size_t>(i / 16 % 8)];
    std::string text =
        "{" + any("\"id\"", "\"ack\"", "\"x\"") + ":" +
        any("1", "-1", "1e999", "null", "\"1\"", "[[[]]]", "{}", "18446744073709551616") +
        ",\"command\":" +
        any("\"show\"", "\"get\"", "\"set\"", "\"pause\"", "\"seek\"", "7", "null", "\"\\u0000\"",
            "[]") +
        "," + any("\"frames\"", "\"what\"", "\"key\"", "\"time\"", "\"samples\"") + ":" +
        any("true", "\"mesh\"", "\"contact.method\"", "1e308", "{}", "\"tree\"") + "}";
    if (i % 3 == 0) text[random.bits() % text.size()] = any("}", "\"", ":", "[", " ", "9")[0];
    ASSERT_TRUE(page.send(text)) << text;
    if (i % 16 != 15) continue;
    // All have been answered, or acknowledged something, when this one is.
    ASSERT_TRUE(page.send(Json{{"id", 1000000 + i}, {"command", "resume"}}.dump()));
    for (Received message; page.receive(message);) {
      if (!message.is_text) continue;
      const Json json = Json::parse(message.bytes);
      if (json["type"] == "picture") acknowledge(page, json);
      num_answers += json["type"] == "answer" ? 1 : 0;
      if (json["type"] == "answer" && json["id"] == 1000000 + i) break;
    }
  }
  for (const auto& page : pages) EXPECT_TRUE(page->is_open());
  EXPECT_GT(num_answers, 15000u);  // acknowledgements are not answered
  pages.clear();
  EXPECT_TRUE(comes_true([&] { return fixture.server->num_pages() == 0; }));
  fixture.expect_alive();
}

// Times are compared from below only: however slow the machine, no client is served more often than
// that.
TEST(ViewServer, WhoSaysTooMuchIsHeardLater) {
  const Fixture fixture;
  PageClient shouting(fixture.port), other(fixture.port);
  int number = 0;
  // Sends `num` messages and waits for the answer to the last one.
  const auto say = [&](int num, const std::string& more) {
    for (int i = 0; i < num; ++i) {
      ASSERT_TRUE(shouting.send(R"({"command": "resume", "x": ")" + more + R"(", "id": )" +
                                std::to_string(++number) + "}"));
    }
    for (Received message; shouting.receive(message, 60);) {
      if (message.is_text && Json::parse(message.bytes).value("id", 0) == number) return;
    }
    ADD_FAILURE() << "message " << number << " is not answered";
  };
  const double begin = monotonic_now();
  for (int i = 0; i < 30; ++i) {
    say(100, "");
    EXPECT_EQ(command(other, {{"id", 4}, {"command", "pause"}})["ok"], true);
  }
  // 2000 more than at once, and 60 long ones that count as more than 15 each.
  for (int i = 0; i < 10; ++i) say(6, std::string(60000, ' '));
  EXPECT_GE(monotonic_now() - begin, 2 + 0.059 * 15);

  const double requested = monotonic_now();
  RawSocket kept(fixture.port);
  std::string seen;
  for (int desired = 500; desired <= 2000; desired += 500) {
    for (int k = 0; k < 500; ++k) kept.send("GET /api/none HTTP/1.1\r\nHost: localhost\r\n\r\n");
    EXPECT_TRUE(comes_true([&] {
      seen += kept.receive(0.05);
      int num_answers = 0;
      for (std::size_t at = 0; (at = seen.find("HTTP/1.1 404", at)) != std::string::npos; ++at) {
        ++num_answers;
      }
      return num_answers == desired;
    })) << desired;
  }
  EXPECT_GE(monotonic_now() - requested, 1);  // 1000 more than at once
}

TEST(ViewServer, LivesThroughStormsOfBytes) {
  const Fixture fixture;
  test::Random random(6);
  const auto noise = [&random](std::size_t size) {
    std::string bytes(size, ' ');
    for (char& c : bytes) c = static_cast<char>(random.bits());
    return bytes;
  };
  const std::string upgrade =
      "GET /ws HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: "
      "Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n";
  for (int i = 0; i < 300; ++i) {
    RawSocket socket(fixture.port);
    ASSERT_TRUE(socket.is_open());
    switch (i % 4) {
      case 0: socket.send(noise(1 + 37 * static_cast<std::size_t>(i))); break;
      case 1: socket.send(upgrade + noise(200)); break;
      case 2: {
        socket.send(upgrade);
        socket.receive(0.003);
        socket.send(noise(5000));
        break;
      }
      default: {
        std::string broken = upgrade;
        for (int k = 0; k < 3; ++k) broken[random.bits() % broken.size()] = noise(1)[0];
        socket.send(broken);
      }
    }
  }
  EXPECT_TRUE(comes_true([&] { return fixture.server->num_pages() == 0; }));
  fixture.expect_alive();
}

TEST(ViewServer, ConnectionsThatOnlyWaitKeepNobodyOut) {
  const Fixture fixture;
  std::vector<std::unique_ptr<RawSocket>> idle;
  for (int i = 0; i < 300; ++i) {
    idle.push_back(std::make_unique<RawSocket>(fixture.port));
    idle.back()->send("GET / HTTP/1.1\r\nX-Slow: ");
  }
  fixture.expect_alive();
  int num_closed = 0;
  for (const auto& socket : idle) {
    socket->receive(0.001);
    num_closed += socket->is_closed() ? 1 : 0;
  }
  EXPECT_GE(num_closed, 300 - 64);
}

long resident_kilobytes() {
  std::ifstream status("/proc/self/status");
  std::string word;
  while (status >> word)
    if (word == "VmRSS:" && status >> word) return std::stol(word);
  return 0;
}

TEST(ViewServer, PagesThatDoNotReadOrDrawCostNothingAndTheFormerAreDropped) {
  const Fixture fixture(test::big_scene(2000, 320, 240));
  PageClient not_drawing(fixture.port), not_reading(fixture.port), shouting(fixture.port);
  const std::string all =
      R"({"command": "show", "frames": true, "contacts": true, "surfaces": true, "samples": true})";
  not_drawing.send(all);
  not_reading.send(all);
  // The third never reads the answers to its requests.
  std::thread shouter([&shouting] {
    for (int i = 0; i < 1000000 && shouting.send(R"({"command": "get", "what": "tree"})"); ++i) {
    }
  });
  sleep_for(2);
  const long before = resident_kilobytes();
  Received message;
  int num_pictures = 0;
  for (const double end = monotonic_now() + 14; monotonic_now() < end;) {
    if (not_drawing.receive(message, 0.1) && message.is_text)
      num_pictures += Json::parse(message.bytes)["type"] == "picture" ? 1 : 0;
    if (fixture.server->num_pages() <= 2 && monotonic_now() > end - 2) break;
  }
  EXPECT_LE(num_pictures, 1);
  EXPECT_LT(resident_kilobytes() - before, 40000);
  EXPECT_TRUE(comes_true([&] { return fixture.server->num_pages() <= 2; }));  // the third is gone
  ::shutdown(shouting.handle(), SHUT_RDWR);
  shouter.join();
  fixture.expect_alive();
}

TEST(ViewServer, TwoHundredSlowClientsCostAPageNothing) {
  const Fixture fixture;
  PageClient page(fixture.port);
  page.send(R"({"command": "show", "frames": true})");
  const auto next_picture = [&page] {
    const Json picture = read_until(page, "picture");
    acknowledge(page, picture);
    return picture["number"].get<int>();
  };
  int picture = next_picture();
  const long before = resident_kilobytes();
  // Each sends a request byte by byte, and never ends it.
  std::vector<std::unique_ptr<RawSocket>> slow;
  for (int i = 0; i < 200; ++i) slow.push_back(std::make_unique<RawSocket>(fixture.port));
  const std::string request = "GET /api/state HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ";
  for (int round = 0; round < 100; ++round) {
    const auto at = static_cast<std::size_t>(round);
    for (const auto& socket : slow) socket->send(at < request.size() ? request.substr(at, 1) : "x");
    if (round % 10 != 0) continue;
    const int next = next_picture();
    EXPECT_GT(next, picture);
    picture = next;
    EXPECT_EQ(status_of(fixture.get("/api/state")), 200);
  }
  EXPECT_LT(resident_kilobytes() - before, 64 * 2 * 64 + 8192);  // KiB: 64 with full buffers
  fixture.expect_alive();
}

}  // namespace
}  // namespace palpate
