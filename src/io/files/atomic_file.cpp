#include "src/io/internal/atomic_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <utility>

namespace palpate { inline namespace v0 {
namespace {

/// Closes its descriptor when it goes out of scope.
class File {
 public:
  explicit File(int descriptor) : descriptor_(descriptor) {}
  ~File() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  File(const File&) = delete;

  File& operator=(File&& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    return *this;
  }

  int get() const { return descriptor_; }
  bool close() { return ::close(std::exchange(descriptor_, -1)) == 0; }

 private:
  int descriptor_;
};

Error failure(Errc code, const char* what, const std::filesystem::path& path, const char* advice) {
  return {code,
          std::string(what) + " " + path.string() + ": " + std::strerror(errno) + "; " + advice};
}

Error cannot_open(const std::filesystem::path& path) {
  const Errc code = errno == ENOENT || errno == ENOTDIR ? Errc::not_found : Errc::io_failure;
  return failure(code, "cannot read", path, "check its name and permissions");
}

Error not_regular(const std::filesystem::path& path) {
  return {Errc::bad_input,
          "cannot read " + path.string() + ": it is not a regular file; give a file"};
}

bool write_all(int descriptor, std::string_view content) {
  while (!content.empty()) {
    const ssize_t count = ::write(descriptor, content.data(), content.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return false;
    content.remove_prefix(static_cast<std::size_t>(count));
  }
  return true;
}

std::filesystem::path folder_of(const std::filesystem::path& path) {
  return path.has_parent_path() ? path.parent_path() : ".";
}

/// Makes a file by `make(name)`, which returns 0 or more if it has, under a name in the folder that
/// no file has. Empty: errno tells why not.
template <class Make>
std::filesystem::path make_temporary(const std::filesystem::path& folder, const Make& make) {
  static std::atomic<unsigned> counter{0};
  constexpr int kMaxLeft = 10'000;  // by programs of the same number that were killed
  for (int i = 0; i < kMaxLeft; ++i) {
    const std::filesystem::path name = folder / (".palpate." + std::to_string(::getpid()) + "." +
                                                 std::to_string(counter++) + ".part");
    if (make(name.c_str()) >= 0) return name;
    if (errno != EEXIST) break;
  }
  return {};
}

/// A file that gets its name when it is whole. Until then it has none, so that nothing is left of
/// it whatever ends the program; or, where the file system has no such files, a temporary name.
class NewFile {
 public:
  NewFile(const std::filesystem::path& target, mode_t mode, bool has_name) : target_(target) {
    const std::filesystem::path folder = folder_of(target);
    if (has_name) {
      temporary_ = make_temporary(folder, [&](const char* name) {
        file_ = File(::open(name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode));
        return file_.get();
      });
    } else {
      file_ = File(::open(folder.c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, mode));
    }
  }
  ~NewFile() {
    if (!temporary_.empty()) ::unlink(temporary_.c_str());
  }
  NewFile(const NewFile&) = delete;
  NewFile& operator=(const NewFile&) = delete;

  int get() const { return file_.get(); }

  /// Gives it its name, in place of a file that has it. False: errno tells why.
  bool publish() {
    if (temporary_.empty()) {
      if (::linkat(AT_FDCWD, link().c_str(), AT_FDCWD, target_.c_str(), AT_SYMLINK_FOLLOW) == 0) {
        return file_.close();
      }
      if (errno != EEXIST) return false;
      temporary_ = make_temporary(folder_of(target_), [&](const char* name) {
        return ::linkat(AT_FDCWD, link().c_str(), AT_FDCWD, name, AT_SYMLINK_FOLLOW);
      });
      if (temporary_.empty()) return false;
    }
    if (!file_.close() || std::rename(temporary_.c_str(), target_.c_str()) != 0) return false;
    temporary_.clear();
    return true;
  }

 private:
  /// Path by which a file without a name is linked.
  std::string link() const { return "/proc/self/fd/" + std::to_string(file_.get()); }

  const std::filesystem::path& target_;
  std::filesystem::path temporary_;  // empty: it has no name
  File file_{-1};
};

}  // namespace

Status write_file_atomically(const std::filesystem::path& path, std::string_view content) {
  static constexpr const char* kAdvice = "check the folder, its permissions and the free space";
  std::error_code ignored;
  std::filesystem::path target = path;
  if (std::filesystem::is_symlink(path, ignored)) {
    target = std::filesystem::weakly_canonical(path, ignored);
  }
  const auto kind = std::filesystem::status(target, ignored).type();
  if (kind != std::filesystem::file_type::not_found &&
      kind != std::filesystem::file_type::regular) {
    return Error{Errc::io_failure, "cannot write " + path.string() +
                                       ": it is not a regular file; give the name of a new file"};
  }

  // A file that is replaced keeps its permissions, from the first byte on.
  struct stat earlier {};
  const bool replaces = ::stat(target.c_str(), &earlier) == 0;
  for (const bool has_name : {false, true}) {
    NewFile file(target, replaces ? earlier.st_mode & 0666 : 0666, has_name);
    const bool is_open = file.get() >= 0;
    const bool is_written = is_open &&
                            (!replaces || ::fchmod(file.get(), earlier.st_mode & 0777) == 0) &&
                            write_all(file.get(), content) && ::fsync(file.get()) == 0;
    if (is_written && file.publish()) break;
    // A file without a name cannot be given one everywhere: not without /proc, for instance.
    if (has_name || (is_open && !is_written)) {
      return failure(Errc::io_failure, "cannot write", path, kAdvice);
    }
  }
  // The new name itself reaches the disk with its folder; the content is safe either way.
  const std::filesystem::path folder = folder_of(target);
  const File directory(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (directory.get() >= 0) ::fsync(directory.get());
  return Done{};
}

Status check_regular_file(const std::filesystem::path& path) {
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0) return cannot_open(path);
  return S_ISREG(info.st_mode) ? Status(Done{}) : not_regular(path);
}

Result<std::string> read_file(const std::filesystem::path& path, std::size_t max_bytes) {
  const File file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (file.get() < 0) return cannot_open(path);
  struct stat info {};
  if (::fstat(file.get(), &info) != 0) {
    return failure(Errc::io_failure, "cannot read", path, "check the disk");
  }
  if (!S_ISREG(info.st_mode)) return not_regular(path);
  const auto size = static_cast<std::size_t>(info.st_size);
  if (size > max_bytes) {
    return Error{Errc::bad_input, path.string() + " has " + std::to_string(size) +
                                      " bytes, more than the " + std::to_string(max_bytes) +
                                      " that are read here; give a smaller file"};
  }
  std::string content(size, '\0');
  std::size_t done = 0;
  while (done < size) {
    const ssize_t count = ::read(file.get(), content.data() + done, size - done);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return failure(Errc::io_failure, "cannot read", path, "check the disk");
    if (count == 0) break;  // The file shrank while it was read.
    done += static_cast<std::size_t>(count);
  }
  content.resize(done);
  return content;
}

}}  // namespace palpate::v0
