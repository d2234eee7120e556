#include "palpate/viewer/viewer.h"

#include <gtest/gtest.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <map>
#include <memory>
#include <string>

#include "tests/test_util/own_nice.h"
#include "tests/test_util/sanitized.h"
#include "tests/viewer/served_page.h"

namespace palpate {
namespace {

using namespace test::served_page;  // NOLINT: all of it
using test::body_of;
using test::http_request;
using test::MessageReader;
using test::PageClient;
using test::RawSocket;
using test::Received;
using test::ScriptedSource;
using test::status_of;

constexpr const char* kToken = "0123456789abcdef";

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

TEST(ViewServer, ForAllNamesAnAddressOfThisComputer) {
  const Fixture fixture({}, {.address = "0.0.0.0", .token = kToken});
  const std::string url = fixture.server->url();
  const std::string host = url.substr(7, url.find(':', 7) - 7);
  boost::system::error_code error;
  const auto address = boost::asio::ip::make_address(host, error);
  if (error) GTEST_SKIP() << "no network: " << url;
  EXPECT_FALSE(address.is_unspecified());
  boost::asio::io_context context;
  boost::asio::ip::tcp::socket socket(context);
  EXPECT_NO_THROW(socket.connect({address, static_cast<std::uint16_t>(fixture.port)}));
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
