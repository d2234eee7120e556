// Serves a scripted world to browser tests: the real server, the real page.
//
// usage: page_server SCRIPT
//
// SCRIPT is a JSON object: the world (tests/viewer/page/scripted_world.h) and "port", "token",
// "max_pages" of the server. One JSON object per line comes in: changes of the world, and
// {"server": "stop"} or "start"; each is answered with a line that begins with "done". What pages
// command is a line of its own, "command ...". The end of the input ends the program.
#include <ctime>
#include <fstream>
#include <iostream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>

#include "palpate/viewer/viewer.h"
#include "tests/viewer/page/scripted_world.h"

namespace {

using Json = nlohmann::json;

/// Lines from two threads.
void say(const std::string& line) {
  static std::mutex mutex;
  const std::lock_guard lock(mutex);
  std::cout << line << std::endl;
}

/// Memory of this process that is in RAM, KiB.
long resident_kib() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    long kib = 0;
    if (word == "VmRSS:" && status >> kib) return kib;
  }
  return 0;
}

/// Processor time that this process has used, s.
double processor_seconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

/// Returns the port in "http://127.0.0.1:8787/...".
std::uint16_t port_of(const std::string& url) {
  return static_cast<std::uint16_t>(std::stoi(url.substr(url.rfind(':') + 1)));
}

int serve(const Json& script) {
  using namespace palpate;
  auto world = ScriptedWorld::create(
      script, [](std::string_view json) { say("command " + std::string(json)); });
  if (!world) return say("failed " + world.error().message), 1;
  ViewServerOptions options;
  options.port = script.value("port", std::uint16_t{0});
  options.token = script.value("token", "");
  options.max_pages = script.value("max_pages", options.max_pages);

  std::unique_ptr<ViewServer> server;
  const auto start = [&] {
    auto started = ViewServer::start(**world, options);
    if (!started) return say("failed " + started.error().message), false;
    server = std::move(*started);
    options.port = port_of(server->url());  // where it comes back
    return true;
  };
  if (!start()) return 1;
  say("serving " + server->url());

  for (std::string line; std::getline(std::cin, line);) {
    const Json change = Json::parse(line);
    (*world)->apply(change);
    const std::string what = change.value("server", "");
    if (what == "stop") server.reset();
    if (what == "start" && !start()) return 1;
    say("done " + Json{{"rss_kib", resident_kib()},
                       {"cpu", processor_seconds()},
                       {"pages", server ? server->num_pages() : 0},
                       {"url", server ? server->url() : ""}}
                      .dump());
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: page_server SCRIPT\n";
    return 2;
  }
  return serve(Json::parse(argv[1]));
}
