// Pages that hold the tool, over the real server: one at a time, and a page that goes away lets go.
#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "palpate/viewer/viewer.h"
#include "tests/test_util/wait_for.h"
#include "tests/viewer/held_source.h"
#include "tests/viewer/page_client.h"

namespace palpate {
namespace {

using test::HeldSource;
using test::PageClient;
using test::Received;
using test::wait_for;
using Json = nlohmann::json;

template <class Source>
struct Served {
  Served() {
    ViewServerOptions options;
    options.port = 0;
    auto started = ViewServer::start(source, options);
    EXPECT_TRUE(started) << started.error().message;
    server = *std::move(started);
    const std::string url = server->url();
    port = std::stoi(url.substr(url.rfind(':') + 1));
  }
  Source source{test::ScriptedScene{}};
  std::unique_ptr<ViewServer> server;
  int port = 0;
};

/// Sends a command and returns the answer.
Json requested(PageClient& page, const std::string& text) {
  EXPECT_TRUE(page.send(text));
  Received message;
  while (page.receive(message)) {
    if (!message.is_text) continue;
    Json json = Json::parse(message.bytes);
    if (json["type"] == "answer") return json;
  }
  ADD_FAILURE() << "no answer to " << text;
  return {};
}
constexpr const char* kHold = R"({"id": 1, "command": "hold"})";
constexpr const char* kLetGo = R"({"id": 2, "command": "release"})";
constexpr const char* kHand = R"({"hand": [0.1, 0.2, 0.3, 0, 0, 0, 1]})";

TEST(HeldTool, OnePageHoldsItUntilItLetsGo) {
  Served<HeldSource> served;
  PageClient first(served.port), second(served.port);
  EXPECT_EQ(requested(first, kHold), (Json{{"type", "answer"}, {"id", 1}, {"ok", true}}));
  const Json refused = requested(second, kHold);
  EXPECT_EQ(refused["ok"], false);
  EXPECT_NE(refused["error"].get<std::string>().find("another page"), std::string::npos);
  // A pose of a page that does not hold the tool is refused by an unsolicited answer.
  const Json unrequested = requested(second, kHand);
  EXPECT_EQ(unrequested["ok"], false);
  EXPECT_TRUE(unrequested["id"].is_null());

  ASSERT_TRUE(first.send(kHand));
  EXPECT_TRUE(wait_for([&] { return served.source.poses().size() == 1; }));
  const Pose pose{{0.1, 0.2, 0.3}, {}};
  EXPECT_EQ(served.source.poses()[0], pose);
  EXPECT_EQ(requested(second, kLetGo)["ok"], true);  // of what it does not hold
  EXPECT_EQ(requested(second, kHold)["ok"], false);
  EXPECT_EQ(requested(first, kLetGo)["ok"], true);
  EXPECT_EQ(requested(second, kHold)["ok"], true);
  EXPECT_EQ(requested(first, kHold)["ok"], false);
}

TEST(HeldTool, WhoGoesAwayLetsGo) {
  Served<HeldSource> served;
  PageClient second(served.port);
  {
    PageClient first(served.port);
    EXPECT_EQ(requested(first, kHold)["ok"], true);
    EXPECT_EQ(requested(second, kHold)["ok"], false);
  }
  EXPECT_TRUE(wait_for([&] { return !served.source.is_held(); }));
  EXPECT_EQ(requested(second, kHold)["ok"], true);
}

TEST(HeldTool, WhatIsNoPoseIsRefusedInWords) {
  Served<HeldSource> served;
  PageClient page(served.port);
  EXPECT_EQ(requested(page, kHold)["ok"], true);
  for (const char* bad :
       {R"({"hand": 7})", R"({"hand": []})", R"({"hand": [0,0,0,0,0,0]})",
        R"({"hand": [0,0,0,0,0,0,1,0]})", R"({"hand": [0,0,"x",0,0,0,1]})",
        R"({"hand": [0,0,null,0,0,0,1]})", R"({"hand": [0,0,1e308,0,0,0,1]})",
        R"({"hand": [0,0,0,0,0,0,0]})", R"({"hand": [0,0,0,0,0,1,1]})", R"({"hand": null})"}) {
    const Json answer = requested(page, bad);
    EXPECT_EQ(answer["ok"], false) << bad;
    EXPECT_GT(answer["error"].get<std::string>().size(), 20u) << bad;
  }
  EXPECT_TRUE(served.source.poses().empty());
  ASSERT_TRUE(page.send(kHand));
  EXPECT_TRUE(wait_for([&] { return served.source.poses().size() == 1; }));
  const Json leapt = requested(page, R"({"hand": [0.1, 0.2, 9, 0, 0, 0, 1]})");
  EXPECT_NE(leapt["error"].get<std::string>().find("jumped"), std::string::npos);
}

TEST(HeldTool, IsHeldOverAWebSocketOfThisOriginOnly) {
  Served<HeldSource> served;
  const PageClient stranger(served.port, "/ws", {{"Origin", "http://evil.example"}});
  EXPECT_EQ(stranger.status(), 403);
  const PageClient neighbor(served.port, "/ws", {{"Origin", "http://127.0.0.1:1"}});
  EXPECT_EQ(neighbor.status(), 403);
  for (const std::string body : {kHold, kHand, kLetGo}) {
    const std::string answer = test::http_request(
        served.port, "POST /api/command HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n" +
                         ("Content-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body));
    EXPECT_EQ(test::status_of(answer), 400) << body;
  }
  EXPECT_TRUE(served.source.poses().empty());
}

TEST(HeldTool, OfAnotherRunCannotBeHeld) {
  Served<test::ScriptedSource> served;
  PageClient page(served.port);
  for (const char* text : {kHold, kHand}) {
    const Json answer = requested(page, text);
    EXPECT_EQ(answer["ok"], false);
    EXPECT_NE(answer["error"].get<std::string>().find("--device page"), std::string::npos);
  }
}

}  // namespace
}  // namespace palpate
