#include "src/io/internal/disk_sync.h"

#include <unistd.h>

#include <cerrno>
#include <condition_variable>
#include <mutex>
#include <system_error>
#include <thread>

namespace palpate { inline namespace v0 {
namespace {

/// Returns an `errno`, or 0. Pipes and read-only places have nothing to bring anywhere.
int sync(int file) {
  while (::fdatasync(file) != 0) {
    if (errno == EINTR) continue;
    return errno == EINVAL || errno == EROFS ? 0 : errno;
  }
  return 0;
}

}  // namespace

/// State of the thread, which may outlive the DiskSync.
struct DiskSync::Work {
  explicit Work(int descriptor) : file(descriptor) {}
  ~Work() { ::close(file); }

  bool is_busy() const { return is_requested || is_under_way; }
  void serve();
  void bring(std::unique_lock<std::mutex>& lock);

  const int file;
  std::mutex mutex;  // guards the members below
  std::condition_variable changed;
  bool has_thread = false, is_requested = false, is_under_way = false, is_ending = false;
  std::uint64_t size = 0, size_on_disk = 0;  // bytes: requested, done
  int error = 0;                             // of the first that failed
};

void DiskSync::Work::serve() {
  std::unique_lock lock(mutex);
  for (;;) {
    changed.wait(lock, [this] { return is_requested || is_ending; });
    if (!is_requested) return;
    bring(lock);
  }
}

void DiskSync::Work::bring(std::unique_lock<std::mutex>& lock) {
  const std::uint64_t begun = size;
  is_requested = false;
  is_under_way = true;
  lock.unlock();
  const int result = sync(file);
  lock.lock();
  is_under_way = false;
  if (error == 0) error = result;
  if (error == 0) size_on_disk = begun;
  changed.notify_all();
}

DiskSync::DiskSync(int file) : work_(std::make_shared<Work>(file)) {
  try {
    std::thread([work = work_] { work->serve(); }).detach();
    work_->has_thread = true;
  } catch (const std::system_error&) {  // the system starts no thread
  }
}

DiskSync::~DiskSync() {
  const std::lock_guard lock(work_->mutex);
  work_->is_ending = true;
  work_->changed.notify_all();
}

void DiskSync::request(std::uint64_t size) {
  std::unique_lock lock(work_->mutex);
  work_->size = size;
  work_->is_requested = true;
  if (!work_->has_thread) return work_->bring(lock);
  work_->changed.notify_all();
}

bool DiskSync::is_busy() const {
  const std::lock_guard lock(work_->mutex);
  return work_->is_busy();
}

void DiskSync::wait() const {
  std::unique_lock lock(work_->mutex);
  work_->changed.wait(lock, [this] { return !work_->is_busy(); });
}

int DiskSync::error() const {
  const std::lock_guard lock(work_->mutex);
  return work_->error;
}

std::uint64_t DiskSync::size_on_disk() const {
  const std::lock_guard lock(work_->mutex);
  return work_->size_on_disk;
}

}}  // namespace palpate::v0
