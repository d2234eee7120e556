#include "palpate/viewer/viewer.h"

#include <sys/socket.h>

#include <fstream>
#include <functional>
#include <map>
#include <thread>

#include <gtest/gtest.h>

#include "src/viewer/server/rate_limit.h"
#include "tests/test_util/own_nice.h"
#include "tests/test_util/random.h"
#include "tests/test_util/sanitized.h"
#include "tests/viewer/message_reader.h"
#include "tests/viewer/page_client.h"
#include "tests/viewer/scripted_source.h"

namespace palpate {
namespace {

using test::body_of;
using test::http_request;
using test::MessageReader;
using test::PageClient;
using test::RawSocket;
using test::Received;
using test::ScriptedSource;
using test::status_of;
using Json = nlohmann::json;

constexpr const char* kToken = "0123456789abcdef";

void sleep_for(double seconds) { sleep_until(monotonic_now() + seconds); }

/// Waits for it, at most a minute.
bool comes_true(const std::function<bool()>& condition) {
  for (const double deadline = monotonic_now() + 60; monotonic_now() < deadline; sleep_for(0.005))
    if (condition()) return true;
  return condition();
}

int port_of(const ViewServer& server) {
  const std::string url = server.url();
  return std::stoi(url.substr(url.rfind(':') + 1));
}

struct Fixture {
  explicit Fixture(test::ScriptedScene scene = {}, ViewServerOptions options = {})
      : source(std::move(scene)) {
    options.port = 0;
    auto started = ViewServer::start(source, options);
    EXPECT_TRUE(started.has_value()) << started.error().message;
    server = *std::move(started);
    port = port_of(*server);
  }
  std::string get(const std::string& target, const std::string& headers = "") const {
    return http_request(port, "GET " + target +
                                  " HTTP/1.1\r\nHost: 127.0.0.1:" + std::to_string(port) +
                                  "\r\nConnection: close\r\n" + headers + "\r\n");
  }
  std::string post(const std::string& body) const {
    return http_request(port,
                        "POST /api/command HTTP/1.1\r\nHost: localhost\r\nConnection: "
                        "close\r\nContent-Length: " +
                            std::to_string(body.size()) + "\r\n\r\n" + body);
  }
  /// Expects that the server still serves requests and pages.
  void expect_alive() const {
    EXPECT_EQ(Json::parse(body_of(get("/api/hello")), nullptr, false)["protocol"], 3);
    PageClient page(port);
    Received message;
    ASSERT_EQ(page.status(), 101);
    ASSERT_TRUE(page.receive(message));
    EXPECT_EQ(Json::parse(message.bytes)["type"], "hello");
  }

  ScriptedSource source;
  std::unique_ptr<ViewServer> server;
  int port = 0;
};

/// Reads until a text message of this type, counting the kinds of what comes before it.
Json read_until(PageClient& page, const std::string& type, std::map<int, int>* kinds = nullptr,
                std::map<int, std::string>* newest = nullptr) {
  Received message;
  while (page.receive(message)) {
    if (!message.is_text) {
      const int kind = MessageReader(message.bytes).kind;
      if (kinds) ++(*kinds)[kind];
      if (newest) (*newest)[kind] = message.bytes;
      continue;
    }
    Json json = Json::parse(message.bytes);
    if (json["type"] == type) return json;
  }
  ADD_FAILURE() << "the connection ended before " << type;
  return {{"number", 0}};
}

Json command(PageClient& page, const Json& json) {
  EXPECT_TRUE(page.send(json.dump()));
  return read_until(page, "answer");
}

void acknowledge(PageClient& page, const Json& picture) {
  page.send(Json{{"ack", picture["number"]}}.dump());
}

// HTTP.

TEST(ViewServer, AnswersRequests) {
  const Fixture fixture;
  const std::string page = fixture.get("/", "Accept-Encoding: gzip, deflate\r\n");
  EXPECT_EQ(status_of(page), 200);
  EXPECT_NE(page.find("Content-Type: text/html"), std::string::npos);
  EXPECT_NE(page.find("Content-Security-Policy: default-src 'self'"), std::string::npos);
  EXPECT_NE(page.find("frame-ancestors 'none'"), std::string::npos);
  EXPECT_NE(page.find("X-Content-Type-Options: nosniff"), std::string::npos);
  EXPECT_NE(page.find("Referrer-Policy: no-referrer"), std::string::npos);
  EXPECT_GT(body_of(page).size(), 200u);
  EXPECT_LT(status_of(fixture.get("/favicon.ico", "Accept-Encoding: gzip\r\n")), 300);

  const Json hello = Json::parse(body_of(fixture.get("/api/hello")));
  EXPECT_EQ(hello["type"], "hello");
  EXPECT_EQ(hello["title"], "scripted");
  const Json state = Json::parse(body_of(fixture.get("/api/state?x=1")));
  EXPECT_EQ(state["type"], "state");
  EXPECT_EQ(state["pages"], 0);

  EXPECT_EQ(status_of(fixture.get("/api/nothing")), 404);
  EXPECT_EQ(status_of(fixture.get("/../../etc/passwd")), 404);
  EXPECT_EQ(status_of(fixture.get("/api/command")), 405);
  EXPECT_EQ(status_of(fixture.get("/ws")), 426);
  const std::string head = http_request(
      fixture.port, "HEAD /api/hello HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  EXPECT_EQ(status_of(head), 200);
  EXPECT_EQ(body_of(head), "");
  EXPECT_EQ(status_of(http_request(
                fixture.port, "DELETE / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")),
            405);
}

TEST(ViewServer, KeepsAConnectionForTheNextRequest) {
  const Fixture fixture;
  const std::string request = "GET /api/state HTTP/1.1\r\nHost: localhost\r\n\r\n";
  RawSocket socket(fixture.port);
  socket.send(request + request + request);  // all at once
  std::string answers;
  const auto count = [&] {
    std::size_t num = 0;
    for (std::size_t at = 0; (at = answers.find("HTTP/1.1 200", at)) != std::string::npos; ++at)
      ++num;
    return num;
  };
  EXPECT_TRUE(comes_true([&] {
    answers += socket.receive(0.05);
    return count() >= 3;
  }));
  answers += socket.receive(0.2);
  EXPECT_EQ(count(), 3u);
  EXPECT_FALSE(socket.is_closed());
}

TEST(ViewServer, ObeysCommandsByPost) {
  const Fixture fixture;
  const std::string done =
      fixture.post(R"({"id": 3, "command": "set", "key": "contact.method", "value": "graph"})");
  EXPECT_EQ(status_of(done), 200);
  EXPECT_EQ(Json::parse(body_of(done)), (Json{{"type", "answer"}, {"id", 3}, {"ok", true}}));
  EXPECT_EQ(fixture.source.settings()["contact.method"], "graph");
  EXPECT_EQ(Json::parse(body_of(fixture.get("/api/state")))["settings"]["contact.method"], "graph");

  for (const char* bad : {"", "x", "[]", R"({"command": "no"})", R"({"command": "show"})",
                          R"({"command": "get", "what": "mesh"})", R"({"ack": 1})"}) {
    const std::string answer = fixture.post(bad);
    EXPECT_EQ(status_of(answer), 400) << bad;
    EXPECT_EQ(Json::parse(body_of(answer))["ok"], false) << bad;
  }
  EXPECT_EQ(status_of(fixture.post(std::string(70000, ' '))), 413);
  EXPECT_EQ(status_of(fixture.get("/", "X: " + std::string(9000, 'x') + "\r\n")), 431);
  EXPECT_EQ(status_of(http_request(fixture.port, "no HTTP at all\r\n\r\n")), 400);
}

// Access control.

struct Asker {
  const char* host;
  const char* origin;  // empty: none
  int status;
};

int poll_state(int port, const Asker& asker, const std::string& more = "",
               const std::string& target = "/api/state") {
  const std::string origin = *asker.origin ? "Origin: " + std::string(asker.origin) + "\r\n" : "";
  return status_of(http_request(port, "GET " + target + " HTTP/1.1\r\nHost: " + asker.host +
                                          "\r\nConnection: close\r\n" + origin + more + "\r\n"));
}

TEST(ViewServer, WithoutATokenOnlyThisComputerIsAnswered) {
  const Fixture fixture;
  for (const Asker& asker : {Asker{"127.0.0.1", "", 200},
                             {"localhost", "", 200},
                             {"LocalHost:8787", "", 200},
                             {"localhost:1", "http://localhost:1", 200},
                             {"127.0.0.1:8787", "http://127.0.0.1:8787", 200},
                             {"127.3.2.1:9", "", 200},
                             {"[::1]:8787", "http://[::1]:8787", 200},
                             {"[::1]", "", 200},
                             {"evil.example", "", 403},
                             {"evil.example:8787", "http://evil.example:8787", 403},
                             {"127.0.0.1.evil.example", "", 403},
                             {"127.evil.example", "", 403},
                             {"localhost.evil.example", "", 403},
                             {"localhost:", "", 403},
                             {"localhost:x", "", 403},
                             {"localhost:1:2", "", 403},
                             {"[::1", "", 403},
                             {"[::1]x", "", 403},
                             {"[::2]", "", 403},
                             {"user@localhost", "", 403},
                             {"192.168.1.1", "", 403},
                             {"0.0.0.0", "", 403},
                             {"", "", 403},
                             {"localhost", "http://evil.example", 403},
                             {"localhost", "null", 403},
                             {"localhost:8787", "http://localhost:3000", 403},
                             {"localhost:8787", "http://localhost", 403},
                             {"localhost:8787", "http://127.0.0.1:8787", 403},
                             {"localhost:8787", "ftp://localhost:8787", 403},
                             {"localhost:8787", "http://localhost:8787/", 403},
                             {"localhost:8787", "http://localhost:8787.evil.example", 403}}) {
    EXPECT_EQ(poll_state(fixture.port, asker), asker.status) << asker.host << ' ' << asker.origin;
    if (!*asker.host) continue;
    const PageClient page(fixture.port, "/ws",
                          *asker.origin
                              ? PageClient::Headers{{"Host", asker.host}, {"Origin", asker.origin}}
                              : PageClient::Headers{{"Host", asker.host}});
    EXPECT_EQ(page.status(), asker.status == 200 ? 101 : 403) << asker.host << ' ' << asker.origin;
  }
  EXPECT_EQ(poll_state(fixture.port, {"localhost", "", 0}, "Host: localhost\r\n"), 403);
  EXPECT_EQ(poll_state(fixture.port, {"localhost", "http://localhost", 0},
                       "Origin: http://localhost\r\n"),
            403);
  EXPECT_EQ(status_of(http_request(fixture.port, "GET / HTTP/1.0\r\n\r\n")), 400);
}

TEST(ViewServer, WithATokenEveryRequestNeedsIt) {
  const Fixture fixture({}, {.address = "0.0.0.0", .token = kToken});
  EXPECT_NE(fixture.server->url().find(std::string("/?token=") + kToken), std::string::npos);
  const std::string good = std::string("?token=") + kToken;
  const std::string bearer = std::string("Authorization: Bearer ") + kToken + "\r\n";
  const Asker asker{"robot.example:8787", "", 0};
  EXPECT_EQ(poll_state(fixture.port, asker), 401);
  EXPECT_EQ(poll_state(fixture.port, asker, "", "/api/state" + good), 200);
  EXPECT_EQ(
      poll_state(fixture.port, asker, "", "/api/state?a=b&token=" + std::string(kToken) + "&c"),
      200);
  EXPECT_EQ(poll_state(fixture.port, asker, bearer), 200);
  for (const char* bad :
       {"?token=", "?token", "?token=0123456789abcdeF", "?token=0123456789abcdef0",
        "?token=0123456789abcde", "?xtoken=0123456789abcdef", "?token=x&token=0123456789abcdef",
        "?&&&", "?"})
    EXPECT_EQ(poll_state(fixture.port, asker, "", "/api/state" + std::string(bad)), 401) << bad;
  for (const char* bad : {"Authorization: Bearer\r\n", "Authorization: 0123456789abcdef\r\n",
                          "Authorization: Basic 0123456789abcdef\r\n", "Authorization: \r\n"})
    EXPECT_EQ(poll_state(fixture.port, asker, bad), 401) << bad;
  // The page's files are public; another page may use them no more than the rest.
  EXPECT_EQ(status_of(fixture.get("/", "Accept-Encoding: gzip\r\n")), 200);
  EXPECT_EQ(
      poll_state(fixture.port, {"robot:1", "http://evil.example", 0}, "", "/api/state" + good),
      403);
  EXPECT_EQ(poll_state(fixture.port, {"robot:1", "http://robot:1", 0}, "", "/api/state" + good),
            200);
  EXPECT_EQ(status_of(fixture.post(R"({"command": "pause"})")), 401);
  EXPECT_FALSE(fixture.source.is_paused());
  EXPECT_EQ(PageClient(fixture.port).status(), 401);
  EXPECT_EQ(PageClient(fixture.port, "/ws" + good).status(), 101);
}

TEST(ViewServer, MakesATokenWhereOneIsNeeded) {
  const Fixture first({}, {.address = "0.0.0.0"}), second({}, {.address = "::"});
  const auto token = [](const Fixture& fixture) {
    const std::string url = fixture.server->url();
    return url.substr(url.find("token=") + 6);
  };
  EXPECT_EQ(token(first).size(), 32u);
  EXPECT_NE(token(first), token(second));
  EXPECT_EQ(PageClient(first.port, "/ws?token=" + token(first)).status(), 101);
  EXPECT_EQ(PageClient(second.port, "/ws?token=" + token(second)).status(), 101);
  EXPECT_EQ(PageClient(second.port, "/ws?token=" + token(first)).status(), 401);
  EXPECT_EQ(Fixture().server->url().find("token"), std::string::npos);
}

TEST(ViewServer, SaysWhyItCannotStart) {
  ScriptedSource source;
  const Fixture fixture;
  const auto error = [&source](const ViewServerOptions& options) {
    const auto server = ViewServer::start(source, options);
    return server.has_value() ? "no error" : server.error().message;
  };
  const auto port = static_cast<std::uint16_t>(fixture.port);
  EXPECT_EQ(error({.port = port}),
            "port " + std::to_string(port) +
                " on 127.0.0.1 is in use by another program; choose another port");
  EXPECT_NE(error({.address = "192.0.2.1", .port = 0}).find("not an address of this computer"),
            std::string::npos);
  EXPECT_NE(error({.address = "my host", .port = 0}).find("not an IP address"), std::string::npos);
  EXPECT_NE(error({.address = "", .port = 0}).find("not an IP address"), std::string::npos);
  for (const char* token : {"short", "0123456789abcde!", "0123456789 abcdef"})
    EXPECT_NE(error({.port = 0, .token = token}).find("16 to 128 letters"), std::string::npos);
  EXPECT_NE(error({.port = 0, .token = std::string(129, 'x')}).find("16 to 128 letters"),
            std::string::npos);
  EXPECT_NE(error({.port = 0, .max_pages = 0}).find("max_pages"), std::string::npos);
}

// Pages.

TEST(ViewServer, ShowsWhatTheSourceSees) {
  const Fixture fixture;
  PageClient page(fixture.port);
  const Json hello = read_until(page, "hello");
  EXPECT_EQ(hello["tool"]["spheres"], 4);
  EXPECT_EQ(read_until(page, "state")["pages"], 1);
  EXPECT_EQ(fixture.server->num_pages(), 1);
  EXPECT_EQ(command(page, {{"id", 1}, {"command", "get"}, {"what", "graph"}})["ok"], true);
  EXPECT_EQ(command(page, {{"id", 2},
                           {"command", "show"},
                           {"frames", true},
                           {"contacts", true},
                           {"surfaces", true},
                           {"samples", true}})["id"],
            2);
  std::uint32_t last_frame = 0;
  std::map<int, int> kinds;
  for (int i = 0; i < 20; ++i) {
    std::map<int, std::string> newest;
    acknowledge(page, read_until(page, "picture", &kinds, &newest));
    if (newest.contains(10)) {
      MessageReader frame(newest[10]);
      EXPECT_GE(frame.number, last_frame);
      last_frame = frame.number;
      EXPECT_EQ(frame.time, frame.number / 30.0);
      ASSERT_EQ(frame.take<std::uint16_t>(), 64);
      ASSERT_EQ(frame.take<std::uint16_t>(), 48);
      frame.take<std::uint16_t>(2);
      frame.take<double>(7);
      EXPECT_EQ(frame.take<double>(), fixture.source.scene().unit);
      for (int v = 0; v < 48; ++v)
        for (int u = 0; u < 64; ++u)
          ASSERT_EQ(frame.take<std::uint16_t>(), fixture.source.scene().depth(u, v, frame.number));
      EXPECT_TRUE(frame.is_at_end());
    }
    if (newest.contains(20)) {
      MessageReader samples(newest[20]);
      EXPECT_GT(samples.take<std::uint32_t>(), 0u);
      EXPECT_EQ(samples.take<std::uint32_t>(), hello["columns"].size());
    }
  }
  for (const int kind : {10, 11, 12, 13, 20}) EXPECT_GE(kinds[kind], 1) << kind;
}

TEST(ViewServer, SendsALargeImageWhole) {
  const Fixture fixture(test::big_scene(1000, 1280, 960));
  PageClient page(fixture.port);
  page.send(R"({"command": "show", "frames": true})");
  std::map<int, std::string> newest;
  read_until(page, "picture", nullptr, &newest);
  ASSERT_EQ(newest[10].size(), 88u + 2 * 1280 * 960);
  MessageReader frame(newest[10]);
  frame.take<std::uint32_t>(18);
  const auto pixels = frame.take<std::uint16_t>(1280 * 960);
  EXPECT_EQ(pixels[1280 * 959 + 7], fixture.source.scene().depth(7, 959, frame.number));
}

TEST(ViewServer, ASlowPageMissesPicturesButSeesTheNewest) {
  const Fixture fixture;
  PageClient slow(fixture.port), quick(fixture.port);
  for (PageClient* page : {&slow, &quick}) page->send(R"({"command": "show", "frames": true})");
  Json held = read_until(slow, "picture");
  for (int num_quick = 0; num_quick < 20; ++num_quick) {
    acknowledge(quick, read_until(quick, "picture"));
  }
  Received message;
  int num_binary = 0;
  while (slow.receive(message, 0.05)) num_binary += message.is_text ? 0 : 1;
  EXPECT_EQ(num_binary, 0);  // nothing before it has acknowledged
  const auto now = Json::parse(body_of(fixture.get("/api/state")))["frame_number"].get<int>();
  acknowledge(slow, held);
  std::map<int, std::string> newest;
  read_until(slow, "picture", nullptr, &newest);
  EXPECT_GE(static_cast<int>(MessageReader(newest[10]).number), now - 2);
}

TEST(ViewServer, PagesSeeWhatTheyWishForAndEachOthersCommands) {
  const Fixture fixture;
  PageClient first(fixture.port), second(fixture.port);
  first.send(R"({"command": "show", "contacts": true})");
  second.send(R"({"command": "show", "samples": true})");
  std::map<int, int> of_first, of_second;
  for (int i = 0; i < 5; ++i) {
    acknowledge(first, read_until(first, "picture", &of_first));
    acknowledge(second, read_until(second, "picture", &of_second));
  }
  EXPECT_EQ(of_first, (std::map<int, int>{{11, 5}}));
  EXPECT_EQ(of_second, (std::map<int, int>{{20, 5}}));
  EXPECT_EQ(fixture.server->num_pages(), 2);

  const Json answer = command(first, {{"id", 5}, {"command", "pause"}});
  EXPECT_EQ(answer, (Json{{"type", "answer"}, {"id", 5}, {"ok", true}}));
  Json state = Json::object();
  for (int i = 0; i < 40 && !state.value("paused", false); ++i) {
    state = read_until(second, "state");
  }
  EXPECT_EQ(state["paused"], true);
  EXPECT_EQ(state["pages"], 2);
}

TEST(ViewServer, HasRoomForSoManyPages) {
  const Fixture fixture({}, {.max_pages = 2});
  auto first = std::make_unique<PageClient>(fixture.port);
  PageClient second(fixture.port);
  EXPECT_EQ(PageClient(fixture.port).status(), 503);
  EXPECT_TRUE(comes_true([&] { return fixture.server->num_pages() == 2; }));
  first.reset();
  EXPECT_TRUE(comes_true([&] { return fixture.server->num_pages() == 1; }));
  EXPECT_EQ(PageClient(fixture.port).status(), 101);
}

TEST(ViewServer, RestsWhenNobodyLooks) {
  const Fixture fixture;
  sleep_for(0.1);
  const double begin = monotonic_now();
  const std::int64_t before = fixture.source.num_polls();
  sleep_for(1);
  const std::int64_t num_polls = fixture.source.num_polls() - before;
  EXPECT_LE(static_cast<double>(num_polls), 6 * (monotonic_now() - begin));
}

TEST(ViewServer, EndsWhilePagesAreOpenAndBeginsAgainAtOnce) {
  auto fixture = std::make_unique<Fixture>();
  const auto port = static_cast<std::uint16_t>(fixture->port);
  PageClient page(port);
  page.send(R"({"command": "show", "frames": true, "contacts": true, "surfaces": true})");
  read_until(page, "picture");
  RawSocket idle(port), half(port);
  half.send("GET / HT");
  fixture.reset();
  Received message;
  while (page.receive(message, 1)) {
  }
  EXPECT_FALSE(page.is_open());
  ScriptedSource source;
  const auto again = ViewServer::start(source, {.port = port});
  ASSERT_TRUE(again.has_value()) << again.error().message;
  EXPECT_EQ(PageClient(port).status(), 101);
}

// The hostile.

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

// Cost of the viewer.

/// The same large scene again and again, 30 times a second.
class BusySource : public ViewSource {
 public:
  BusySource()
      : inner_(test::big_scene(17000, 640, 480)), parts_(inner_.poll({true, true, true, false})) {}
  const ViewContent& content() const override { return inner_.content(); }
  ViewUpdate poll(const ViewSubscription& subscription) override {
    const double now = monotonic_now();
    ViewUpdate update = inner_.poll({.samples = subscription.samples});
    if (now >= next_) {
      next_ = std::max(next_ + 1.0 / 30, now);
      if (subscription.frames) update.frames = parts_.frames;
      if (subscription.contacts) update.contact = parts_.contact;
    }
    cpu_seconds = thread_cpu_now();
    nice = test::own_nice();
    return update;
  }
  std::string state() override { return inner_.state(); }
  std::string controls() override { return inner_.controls(); }
  Result<std::string> command(std::string_view json) override { return inner_.command(json); }

  std::atomic<double> cpu_seconds = 0;  // of the server's thread
  std::atomic<int> nice = 0;            // likewise

 private:
  ScriptedSource inner_;
  ViewUpdate parts_;
  double next_ = 0;
};

TEST(ViewServer, CostsLittle) {
  BusySource source;
  const auto server = ViewServer::start(source, {.port = 0});
  ASSERT_TRUE(server.has_value());
  PageClient page(port_of(**server));
  page.send(R"({"command": "show", "frames": true, "contacts": true, "samples": true})");
  read_until(page, "picture");
  page.send(R"({"ack": 1})");
  const double cpu = source.cpu_seconds, start = monotonic_now();
  std::map<int, int> kinds;
  while (monotonic_now() < start + 3) acknowledge(page, read_until(page, "picture", &kinds));
  const double seconds = monotonic_now() - start;
  std::cout << "server thread: " << 100 * (source.cpu_seconds - cpu) / seconds
            << " % of a core; per second " << kinds[10] / seconds << " frames, "
            << kinds[11] / seconds << " contacts, " << kinds[20] / seconds << " of samples\n";
  EXPECT_LT(source.cpu_seconds - cpu, (test::kIsSanitized ? 1 : 0.5) * seconds);
  // The server's thread has a lower priority than others.
  const int usual = test::own_nice();
  EXPECT_TRUE(source.nice > usual || usual == 19) << source.nice;
}

}  // namespace
}  // namespace palpate
