#include "src/io/internal/atomic_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <utility>

namespace palpate::inline v0 {
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

/// A name in the same folder that no other process or thread uses.
std::filesystem::path temporary_beside(const std::filesystem::path& path) {
  static std::atomic<unsigned> counter{0};
  std::filesystem::path result = path;
  for (const unsigned long part :
       {static_cast<unsigned long>(::getpid()), static_cast<unsigned long>(counter++)}) {
    result += '.';
    result += std::to_string(part);
  }
  result += ".part";
  return result;
}

/// A file that gets its name when it is whole. Until then it has none, so that nothing is left of
/// it whatever ends the program; where the file system has no such files, it has a temporary name.
class NewFile {
 public:
  NewFile(const std::filesystem::path& target, mode_t mode) : target_(target) {
    const std::filesystem::path folder = folder_of(target);
    file_ = File(::open(folder.c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, mode));
    if (file_.get() >= 0 && ::access(link().c_str(), F_OK) == 0) return;
    temporary_ = temporary_beside(target);
    file_ = File(::open(temporary_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode));
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
      const std::filesystem::path name = temporary_beside(target_);
      if (::linkat(AT_FDCWD, link().c_str(), AT_FDCWD, name.c_str(), AT_SYMLINK_FOLLOW) != 0) {
        return false;
      }
      temporary_ = name;
    }
    if (!file_.close() || std::rename(temporary_.c_str(), target_.c_str()) != 0) return false;
    temporary_.clear();
    return true;
  }

 private:
  /// By which a file without a name is linked.
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
  NewFile file(target, replaces ? earlier.st_mode & 0666 : 0666);
  if (file.get() < 0) return failure(Errc::io_failure, "cannot write", path, kAdvice);
  if ((replaces && ::fchmod(file.get(), earlier.st_mode & 0777) != 0) ||
      !write_all(file.get(), content) || ::fsync(file.get()) != 0 || !file.publish()) {
    return failure(Errc::io_failure, "cannot write", path, kAdvice);
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

}  // namespace palpate::inline v0
