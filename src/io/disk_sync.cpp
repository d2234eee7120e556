#include "src/io/internal/disk_sync.h"

#include <unistd.h>

#include <cerrno>
#include <system_error>

namespace palpate::inline v0 {

DiskSync::DiskSync(int file) : file_(file) {
  try {
    thread_ = std::thread([this] { serve(); });
  } catch (const std::system_error&) {  // none to be had
  }
}

DiskSync::~DiskSync() { end(); }

int DiskSync::request() {
  if (!thread_.joinable()) return error_ = error_ != 0 ? error_ : sync();
  const std::lock_guard lock(mutex_);
  is_requested_ = true;
  changed_.notify_all();
  return error_;
}

int DiskSync::finish() {
  end();
  return error_ = error_ != 0 ? error_ : sync();
}

/// Pipes and read-only places have nothing to bring anywhere.
int DiskSync::sync() const {
  return ::fdatasync(file_) == 0 || errno == EINVAL || errno == EROFS ? 0 : errno;
}

void DiskSync::serve() {
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait(lock, [this] { return is_requested_ || is_ending_; });
    if (is_ending_) return;
    is_requested_ = false;
    lock.unlock();
    const int error = sync();
    lock.lock();
    if (error_ == 0) error_ = error;
  }
}

void DiskSync::end() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    is_ending_ = true;
    changed_.notify_all();
  }
  thread_.join();
}

}  // namespace palpate::inline v0
