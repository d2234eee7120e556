// Speaks the protocol of spacenavd on a socket of its own.
#pragma once

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstdint>
#include <cstring>
#include <string>

namespace palpate::test {

class FakeSpacenavd {
 public:
  FakeSpacenavd() : path_(::testing::TempDir() + "/spnav_" + std::to_string(::getpid())) {
    ::unlink(path_.c_str());
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, path_.c_str(), sizeof address.sun_path - 1);
    listener_ = ::socket(AF_UNIX, SOCK_STREAM, 0);
    EXPECT_EQ(::bind(listener_, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    EXPECT_EQ(::listen(listener_, 4), 0);
  }
  ~FakeSpacenavd() {
    hang_up();
    ::close(listener_);
    ::unlink(path_.c_str());
  }
  FakeSpacenavd(const FakeSpacenavd&) = delete;
  FakeSpacenavd& operator=(const FakeSpacenavd&) = delete;

  const std::string& path() const { return path_; }

  /// The next one in the queue.
  void accept() {
    hang_up();
    client_ = ::accept(listener_, nullptr, nullptr);
    EXPECT_GE(client_, 0);
  }
  void hang_up() {
    if (client_ >= 0) ::close(client_);
    client_ = -1;
  }

  void send_bytes(const void* bytes, std::size_t size) {
    EXPECT_EQ(::send(client_, bytes, size, MSG_NOSIGNAL), static_cast<ssize_t>(size));
  }
  void send(const std::array<std::int32_t, 8>& event) { send_bytes(event.data(), sizeof event); }
  void motion(int x, int y, int z, int rx, int ry, int rz) { send({0, x, y, z, rx, ry, rz, 16}); }
  void button(int number, bool is_pressed) { send({is_pressed ? 1 : 2, number, 0, 0, 0, 0, 0, 0}); }

 private:
  std::string path_;
  int listener_ = -1, client_ = -1;
};

}  // namespace palpate::test
