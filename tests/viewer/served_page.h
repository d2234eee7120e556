// A server of a scripted source, and what a page says to it.
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "palpate/viewer/viewer.h"
#include "src/core/internal/monotonic_clock.h"
#include "tests/viewer/message_reader.h"
#include "tests/viewer/page_client.h"
#include "tests/viewer/scripted_source.h"

namespace palpate::test::served_page {

using Json = nlohmann::json;

inline void sleep_for(double seconds) { sleep_until(monotonic_now() + seconds); }

/// Waits for it, at most a minute.
inline bool comes_true(const std::function<bool()>& condition) {
  for (const double deadline = monotonic_now() + 60; monotonic_now() < deadline; sleep_for(0.005))
    if (condition()) return true;
  return condition();
}

inline int port_of(const ViewServer& server) {
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
inline Json read_until(PageClient& page, const std::string& type,
                       std::map<int, int>* kinds = nullptr,
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

inline Json command(PageClient& page, const Json& json) {
  EXPECT_TRUE(page.send(json.dump()));
  return read_until(page, "answer");
}

inline void acknowledge(PageClient& page, const Json& picture) {
  page.send(Json{{"ack", picture["number"]}}.dump());
}

}  // namespace palpate::test::served_page
