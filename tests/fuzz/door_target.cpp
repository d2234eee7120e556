// Messages of a stranger to the viewer: HTTP, and frames on a WebSocket that has been opened. Bytes
// go through a real connection to a real server; the first one says which.
#include "palpate/viewer/viewer.h"
#include "tests/fuzz/target.h"
#include "tests/viewer/held_source.h"
#include "tests/viewer/page_client.h"

namespace palpate::fuzz {
namespace {

constexpr char kHttp = 'h', kFrames = 'w';

constexpr const char* kHost = "Host: 127.0.0.1\r\n";

std::string upgrade() {
  return std::string("GET /ws HTTP/1.1\r\n") + kHost +
         "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
         "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n";
}

std::string frame(std::string_view payload, char first = '\x81') {
  std::string bytes{first, static_cast<char>(0x80 | payload.size())};
  return bytes.append(4, '\0').append(payload);
}

}  // namespace

std::vector<std::string> seeds() {
  const auto http = [](const std::string& line, const std::string& rest) {
    return std::string(1, kHttp) + line + " HTTP/1.1\r\n" + kHost + "Connection: close\r\n" + rest;
  };
  const std::string body = R"({"command":"pause","id":1})";
  return {
      http("GET /api/state", "\r\n"),
      http("GET /api/hello?token=x", "Origin: http://127.0.0.1\r\nAccept-Encoding: gzip\r\n\r\n"),
      http("POST /api/command",
           "Content-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body),
      http("POST /api/command", "Transfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n"),
      http("GET /", "\r\n"),
      kFrames + frame(R"({"command":"show","frames":true})") + frame("x", '\x89') +
          frame("", '\x88'),
      kFrames + frame(R"({"comm)", '\x01') + frame(R"(and":"get","what":"spheres"})", '\x80'),
      kFrames + frame(R"({"ack":1})"),
      kFrames + frame(R"({"id":1,"command":"hold"})") + frame(R"({"hand":[0.1,0,0.5,0,0,0,1]})") +
          frame(R"({"hand":[0,1e300,0,2,0,0,1]})") + frame(R"({"id":2,"command":"release"})")};
}

}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  using namespace palpate::fuzz;
  struct Door {
    test::HeldSource source;
    std::unique_ptr<ViewServer> server = *ViewServer::start(source, {.port = 0});
    int port = std::stoi(server->url().substr(server->url().rfind(':') + 1));
  };
  static Door& door = *new Door;  // its thread ends with the program
  if (size == 0 || (data[0] != kHttp && data[0] != kFrames)) return 0;
  test::RawSocket socket(door.port);
  require(socket.is_open(), "the server takes connections");
  const std::string bytes(text_of(data + 1, size - 1));
  (void)socket.send(data[0] == kFrames ? upgrade() + bytes : bytes);
  socket.end();
  (void)socket.receive(5);
  require(socket.is_closed(), "the server closes a connection that has ended");
  return 0;
}
