// The calls of the kernel's Video4Linux, which tests can replace.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "src/cameras/stream/camera_source.h"

namespace palpate { inline namespace v0 { namespace v4l2 {

/// As open(2), close(2), ioctl(2), mmap(2), munmap(2) and poll(2), with errno.
class System {
 public:
  virtual ~System() = default;
  /// Files of devices, "/dev/video0" first.
  virtual std::vector<std::string> devices() = 0;
  virtual int open(const std::string& file) = 0;
  virtual void close(int device) = 0;
  virtual int control(int device, unsigned long request, void* data) = 0;
  /// Null: none.
  virtual void* map(int device, std::size_t num_bytes, std::size_t offset) = 0;
  virtual void unmap(void* memory, std::size_t num_bytes) = 0;
  /// Above 0: there is a frame, or something is wrong; 0: neither yet.
  virtual int wait(int device, int milliseconds) = 0;
};
System& kernel();

Result<RawStream> open_camera(System& system, const CameraUri& uri);
FoundCameras find_cameras(System& system);

}}}  // namespace palpate::v0::v4l2
