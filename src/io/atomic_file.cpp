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
  File& operator=(const File&) = delete;

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
  const std::filesystem::path temporary = temporary_beside(target);
  File file(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC,
                   replaces ? earlier.st_mode & 0666 : 0666));
  if (file.get() < 0) return failure(Errc::io_failure, "cannot write", path, kAdvice);
  if ((replaces && ::fchmod(file.get(), earlier.st_mode & 0777) != 0) ||
      !write_all(file.get(), content) || ::fsync(file.get()) != 0 || !file.close() ||
      std::rename(temporary.c_str(), target.c_str()) != 0) {
    const Error error = failure(Errc::io_failure, "cannot write", path, kAdvice);
    ::unlink(temporary.c_str());
    return error;
  }
  // The new name itself reaches the disk with its folder; the content is safe either way.
  const std::filesystem::path folder = target.has_parent_path() ? target.parent_path() : ".";
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
