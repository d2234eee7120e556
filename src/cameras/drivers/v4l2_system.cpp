#include "src/cameras/drivers/v4l2_system.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <utility>

#include "src/io/internal/text_scanner.h"

namespace palpate { inline namespace v0 { namespace v4l2 {
namespace {

class Kernel final : public System {
 public:
  std::vector<std::string> devices() override {
    constexpr std::string_view kStem = "video";
    std::vector<std::pair<int, std::string>> found;
    std::error_code error;
    for (std::filesystem::directory_iterator it("/dev", error), end; !error && it != end;
         it.increment(error)) {
      const std::string name = it->path().filename();
      if (!name.starts_with(kStem)) continue;
      const auto number = parse_number<int>(std::string_view(name).substr(kStem.size()));
      if (number) found.emplace_back(*number, it->path());
    }
    std::sort(found.begin(), found.end());
    std::vector<std::string> files;
    for (auto& [number, file] : found) files.push_back(std::move(file));
    return files;
  }
  int open(const std::string& file) override {
    return ::open(file.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  }
  void close(int device) override { ::close(device); }
  int control(int device, unsigned long request, void* data) override {
    int done = 0;
    do {
      done = ioctl(device, request, data);
    } while (done < 0 && errno == EINTR);
    return done;
  }
  void* map(int device, std::size_t num_bytes, std::size_t offset) override {
    void* const memory = mmap(nullptr, num_bytes, PROT_READ | PROT_WRITE, MAP_SHARED, device,
                              static_cast<off_t>(offset));
    return memory == MAP_FAILED ? nullptr : memory;
  }
  void unmap(void* memory, std::size_t num_bytes) override { munmap(memory, num_bytes); }
  int wait(int device, int milliseconds) override {
    pollfd one{device, POLLIN, 0};
    const int ready = poll(&one, 1, milliseconds);
    return ready < 0 && errno == EINTR ? 0 : ready;
  }
};

}  // namespace

System& kernel() {
  static Kernel system;
  return system;
}

}}}  // namespace palpate::v0::v4l2
