// Faults of the system on purpose: a library that is loaded before the program (LD_PRELOAD) and
// stands between it and the C library. Nothing of it is in the program.
//
// PALPATE_FAULTS lists them with commas, each with the call at which it begins (from 1):
//   short          reads and writes of files take at most 7 bytes at a time, or a third
//   interrupted    every third read or write is interrupted (EINTR)
//   full@N         from the N-th write on the disk is full (ENOSPC); full@N-M: up to the M-th
//   broken@N       from the N-th write on the disk is broken (EIO)
//   nameless       no file that is open is given a name (EPERM)
//   unreadable@N   from the N-th read on it is (EIO)
//   unlisted       no folder can be listed (EIO)
//   slow           every write takes 50 ms longer
//   sluggish       every write takes 200 ms longer
//   stuck          a file that is to reach the disk never does; "stuck" on stderr says so
//   lazy           the disk takes two seconds longer for what is written (fdatasync)
//   unsynced@N     from the N-th time on the disk fails to take what is written (fdatasync: EIO)
//   threadless@N   the N-th thread and all later ones are refused (EAGAIN)
//   memoryless@N   the N-th allocation of 64 KiB or more is refused, and so are all later ones
//   yesterday@N    from the N-th look on, the calendar's clock goes wrong by a day
// Reads and writes are those of regular files.
//
// PALPATE_FAULTS_TOLD names a file: it gets a line with the name of each fault when that comes
// first.
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <new>

namespace {

/// The call at which a fault begins; 0: it is not requested.
long begin_of(const char* name) {
  const char* const faults = std::getenv("PALPATE_FAULTS");
  const char* const found = faults == nullptr ? nullptr : std::strstr(faults, name);
  if (found == nullptr) return 0;
  const char* const end = found + std::strlen(name);
  return *end == '@' ? std::atol(end + 1) : 1;
}

/// The last call that it concerns.
long end_of(const char* name) {
  const char* const faults = std::getenv("PALPATE_FAULTS");
  const char* const found = faults == nullptr ? nullptr : std::strstr(faults, name);
  const char* const from = found == nullptr ? nullptr : found + std::strlen(name);
  if (from == nullptr || *from != '@') return std::numeric_limits<long>::max();
  char* rest = nullptr;
  std::strtol(from + 1, &rest, 10);
  return *rest == '-' ? std::atol(rest + 1) : std::numeric_limits<long>::max();
}

/// Appends `name` to the log by system calls, which never fail here and need no memory.
void tell(const char* name) {
  const char* const path = std::getenv("PALPATE_FAULTS_TOLD");
  if (path == nullptr) return;
  const int before = errno;
  const long file =
      syscall(SYS_openat, AT_FDCWD, path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  const iovec line[] = {{const_cast<char*>(name), std::strlen(name)}, {const_cast<char*>("\n"), 1}};
  syscall(SYS_writev, file, line, 2);
  syscall(SYS_close, file);
  errno = before;
}

/// Counts calls and says whether the fault has begun, for one call of `every`.
class Fault {
 public:
  explicit Fault(const char* name, long every = 1) : name_(name), every_(every) {}
  bool comes() {
    if (begin_ < 0) {
      end_ = end_of(name_);
      begin_ = begin_of(name_);
    }
    if (begin_ == 0) return false;
    const long call = ++calls_;
    if (call < begin_ || call > end_ || call % every_ != 0) return false;
    if (!is_told_.exchange(true)) tell(name_);
    return true;
  }

 private:
  const char* name_;
  const long every_;
  std::atomic<bool> is_told_ = false;
  std::atomic<long> begin_ = -1, end_ = 0, calls_ = 0;
};

template <class Function>
Function* next(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

bool is_file(int descriptor) {
  struct stat status {};
  return fstat(descriptor, &status) == 0 && S_ISREG(status.st_mode);
}

std::size_t shortened(std::size_t size) {
  return size <= 1 ? size : std::max<std::size_t>(std::min<std::size_t>(size, 7), size / 3);
}

bool is_interrupted() {
  static Fault interrupted("interrupted", 3);
  return interrupted.comes();
}

/// Why a read of a file fails; 0: it does not.
int read_error() {
  static Fault unreadable("unreadable");
  if (unreadable.comes()) return EIO;
  return is_interrupted() ? EINTR : 0;
}

}  // namespace

extern "C" ssize_t write(int descriptor, const void* data, size_t size) {
  static auto* const real = next<ssize_t(int, const void*, size_t)>("write");
  static Fault shorter("short"), full("full"), broken("broken"), slow("slow"), sluggish("sluggish");
  if (!is_file(descriptor)) return real(descriptor, data, size);
  const bool is_full = full.comes();
  if (is_full || broken.comes()) {
    errno = is_full ? ENOSPC : EIO;
    return -1;
  }
  if (is_interrupted()) {
    errno = EINTR;
    return -1;
  }
  if (slow.comes()) usleep(50'000);
  if (sluggish.comes()) usleep(200'000);
  return real(descriptor, data, shorter.comes() ? shortened(size) : size);
}

extern "C" int fsync(int descriptor) {
  static auto* const real = next<int(int)>("fsync");
  static Fault stuck("stuck");
  if (!is_file(descriptor) || !stuck.comes()) return real(descriptor);
  constexpr char kWords[] = "stuck\n";
  (void)!write(STDERR_FILENO, kWords, sizeof kWords - 1);
  for (;;) pause();
}

extern "C" int fdatasync(int descriptor) {
  static auto* const real = next<int(int)>("fdatasync");
  static Fault lazy("lazy"), unsynced("unsynced");
  if (!is_file(descriptor)) return real(descriptor);
  if (lazy.comes()) usleep(2'000'000);
  if (!unsynced.comes()) return real(descriptor);
  errno = EIO;
  return -1;
}

extern "C" int linkat(int from, const char* old_name, int to, const char* new_name, int flags) {
  static auto* const real = next<int(int, const char*, int, const char*, int)>("linkat");
  static Fault nameless("nameless");
  if (!nameless.comes()) return real(from, old_name, to, new_name, flags);
  errno = EPERM;
  return -1;
}

extern "C" ssize_t read(int descriptor, void* data, size_t size) {
  static auto* const real = next<ssize_t(int, void*, size_t)>("read");
  static Fault shorter("short");
  if (!is_file(descriptor)) return real(descriptor, data, size);
  if (const int error = read_error(); error != 0) {
    errno = error;
    return -1;
  }
  return real(descriptor, data, shorter.comes() ? shortened(size) : size);
}

// As SQLite reads.
extern "C" ssize_t pread64(int descriptor, void* data, size_t size, off64_t place) {
  static auto* const real = next<ssize_t(int, void*, size_t, off64_t)>("pread64");
  if (const int error = is_file(descriptor) ? read_error() : 0; error != 0) {
    errno = error;
    return -1;
  }
  return real(descriptor, data, size, place);
}

extern "C" dirent* readdir(DIR* folder) {
  static auto* const real = next<dirent*(DIR*)>("readdir");
  static Fault unlisted("unlisted");
  if (!unlisted.comes()) return real(folder);
  errno = EIO;
  return nullptr;
}

extern "C" int pthread_create(pthread_t* thread, const pthread_attr_t* attributes,
                              void* (*body)(void*), void* argument) {
  static auto* const real =
      next<int(pthread_t*, const pthread_attr_t*, void* (*)(void*), void*)>("pthread_create");
  static Fault threadless("threadless");
  return threadless.comes() ? EAGAIN : real(thread, attributes, body, argument);
}

extern "C" int clock_gettime(clockid_t clock, struct timespec* time) {
  static auto* const real = next<int(clockid_t, struct timespec*)>("clock_gettime");
  static Fault yesterday("yesterday");
  const int result = real(clock, time);
  if (clock == CLOCK_REALTIME && yesterday.comes()) time->tv_sec -= 86400;
  return result;
}

void* operator new(std::size_t size) {
  static Fault memoryless("memoryless");
  constexpr std::size_t kLarge = std::size_t(64) << 10;
  void* const memory = size >= kLarge && memoryless.comes() ? nullptr : std::malloc(size);
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
