#include "src/session/internal/run_folder.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstdio>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/session/run.h"

namespace palpate { inline namespace v0 {
namespace fs = std::filesystem;
namespace {

/// Returns the number of a part, named "recording.mcap" or "recording-0002.mcap"; 0: no such name.
int part_number(std::string_view name) {
  constexpr std::string_view kBegin = "recording-", kEnd = ".mcap";
  if (name == kRecordingFile) return 1;
  if (!name.starts_with(kBegin) || !name.ends_with(kEnd)) return 0;
  name = name.substr(kBegin.size(), name.size() - kBegin.size() - kEnd.size());
  int number = 0;
  const auto [end, bad] = std::from_chars(name.data(), name.data() + name.size(), number);
  return bad == std::errc{} && end == name.data() + name.size() && number > 1 ? number : 0;
}

/// True if a run has a file of this name.
bool is_our_file(const std::string& name) {
  constexpr std::string_view kNames[] = {"wrench.csv", "wrench.csv.part", "summary.json",
                                         "report.html"};
  const bool is_left = name.starts_with(".palpate.") && name.ends_with(".part");  // of a killed run
  return is_left || part_number(name) > 0 ||
         std::find(std::begin(kNames), std::end(kNames), name) != std::end(kNames);
}

/// Returns the first entry of the folder that no run has there; empty if there is none.
fs::path find_foreign(const fs::path& folder, std::error_code& error) {
  for (auto entry = fs::directory_iterator(folder, error);
       !error && entry != fs::directory_iterator(); entry.increment(error)) {
    const fs::file_type type = entry->symlink_status(error).type();
    if (type != fs::file_type::regular || !is_our_file(entry->path().filename().string())) {
      return entry->path();
    }
  }
  return {};
}

/// Opens and locks the folder of a run against all other programs that write a run; -1: there is
/// none, or `is_taken`. File systems without locks never lock.
int lock_recording(const fs::path& folder, bool& is_taken) {
  const int file = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  is_taken = file >= 0 && flock(file, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
  if (is_taken) close(file);
  return is_taken ? -1 : file;
}

/// Checks that a folder may be replaced: absent, empty, or a run of ours and nothing else.
Status check_replaceable(const fs::path& folder) {
  std::error_code error;
  const fs::file_status status = fs::symlink_status(folder, error);
  if (status.type() == fs::file_type::not_found) return Done{};
  if (status.type() != fs::file_type::directory) {
    return Error{Errc::io_failure, "cannot write a run to " + folder.string() +
                                       ": it is not a folder; give a new name"};
  }
  if (fs::is_empty(folder, error) && !error) return Done{};
  const fs::path foreign = find_foreign(folder, error);
  if (!error && foreign.empty() && is_run(folder)) {
    bool is_taken = false;
    if (const int file = lock_recording(folder, is_taken); file >= 0) close(file);
    if (!is_taken) return Done{};
    return Error{Errc::io_failure, "another program is writing a run to " + folder.string() +
                                       "; give another folder, or wait until that has ended"};
  }
  const std::string what =
      foreign.empty() ? "" : " (" + foreign.lexically_relative(folder).string() + ")";
  return Error{Errc::io_failure, "cannot write a run to " + folder.string() +
                                     ": it contains files that are not of an earlier run" + what +
                                     "; give a new name"};
}

/// Removes leftovers of killed processes of the same run: NAME.partial-PID of a PID that is gone.
void clear_leftovers(const fs::path& target) {
  const std::string prefix = target.filename().string() + ".partial-";
  std::error_code error;
  std::vector<fs::path> leftovers;
  for (auto entry = fs::directory_iterator(target.parent_path(), error);
       !error && entry != fs::directory_iterator(); entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (!name.starts_with(prefix)) continue;
    pid_t process = 0;
    const char* const end = name.data() + name.size();
    const auto [stop, bad] = std::from_chars(name.data() + prefix.size(), end, process);
    if (bad != std::errc{} || process <= 0 || (stop != end && *stop != '-')) continue;
    const bool gone = kill(process, 0) != 0 && errno == ESRCH;
    if (gone && check_replaceable(entry->path())) leftovers.push_back(entry->path());
  }
  for (const fs::path& leftover : leftovers) fs::remove_all(leftover, error);
}

Error failure(const char* what, const fs::path& folder, const std::error_code& error) {
  return {Errc::io_failure, std::string(what) + " " + folder.string() + ": " + error.message() +
                                "; check the folder above it, its permissions and the free space"};
}

}  // namespace

std::string part_file(int number) {
  if (number <= 1) return kRecordingFile;
  char name[40];
  std::snprintf(name, sizeof name, "recording-%04d.mcap", number);
  return name;
}

std::vector<fs::path> recording_parts(const fs::path& folder, std::error_code* why) {
  std::vector<std::pair<int, fs::path>> found;
  std::error_code own;
  std::error_code& error = why != nullptr ? *why : own;
  for (auto entry = fs::directory_iterator(folder, error);
       !error && entry != fs::directory_iterator(); entry.increment(error)) {
    const int number = part_number(entry->path().filename().string());
    if (number > 0) found.emplace_back(number, entry->path());
  }
  std::sort(found.begin(), found.end());
  std::vector<fs::path> parts;
  for (auto& [number, path] : found) parts.push_back(std::move(path));
  return parts;
}

RunFolder::RunFolder(fs::path target, fs::path partial)
    : target_(std::move(target)), partial_(std::move(partial)) {}

RunFolder::RunFolder(RunFolder&& other) noexcept
    : target_(std::move(other.target_)),
      partial_(std::exchange(other.partial_, {})),
      lock_(std::exchange(other.lock_, -1)) {}

RunFolder::~RunFolder() {
  if (lock_ >= 0) close(lock_);
  std::error_code ignored;
  if (!partial_.empty()) fs::remove_all(partial_, ignored);
}

Result<RunFolder> RunFolder::create(const fs::path& name) {
  std::error_code error;
  if (name.empty()) {
    return Error{Errc::invalid_argument, "a run needs a name: give that of a new folder"};
  }
  // Absolute, so that it has a folder above it, where killed runs left theirs.
  fs::path target = fs::absolute(name, error);
  if (!error) target = fs::weakly_canonical(target, error);
  if (error) return failure("cannot find", name, error);
  if (!target.has_filename()) target = target.parent_path();
  if (!target.has_filename()) {
    return Error{Errc::invalid_argument,
                 "cannot write a run to '" + name.string() + "': give the name of a new folder"};
  }
  if (const Status status = check_replaceable(target); !status) return status.error();
  clear_leftovers(target);
  // A name of its own for every process, and for every run of a process.
  const std::string stem = target.string() + ".partial-" + std::to_string(getpid());
  for (int number = 1; number < 1000; ++number) {
    const fs::path partial = number == 1 ? stem : stem + "-" + std::to_string(number);
    const bool made = fs::create_directory(partial, error);
    if (error) return failure("cannot make the folder", partial, error);
    if (made) return RunFolder(std::move(target), partial);
  }
  return failure("cannot make the folder", stem, std::make_error_code(std::errc::file_exists));
}

Status RunFolder::commit() {
  std::error_code error, ignored;
  fs::path old = partial_;
  old += ".replaced";
  bool is_taken = false;
  if (lock_ < 0) lock_ = lock_recording(partial_, is_taken);
  // Tries again if another run of the same name gets in between.
  for (int attempt = 0; attempt < 20; ++attempt) {
    const bool replaces = fs::exists(target_, ignored);
    if (replaces) {
      // Something may have been added since the start.
      if (const Status status = check_replaceable(target_); !status) return status.error();
      fs::rename(target_, old, error);
      if (error == std::errc::no_such_file_or_directory) continue;
      if (error) return failure("cannot replace", target_, error);
    }
    fs::rename(partial_, target_, error);
    if (!error) {
      partial_.clear();
      if (replaces) fs::remove_all(old, ignored);
      return Done{};
    }
    const bool taken = error == std::errc::directory_not_empty || error == std::errc::file_exists;
    if (replaces && taken) fs::remove_all(old, ignored);
    if (replaces && !taken) fs::rename(old, target_, ignored);
    if (!taken) break;
  }
  return failure("cannot write", target_, error);
}

bool lies_inside(const fs::path& path, const fs::path& folder) {
  if (folder.empty()) return false;  // no folder, not the working directory
  std::error_code error;
  const fs::path inner = fs::weakly_canonical(path, error);
  if (error) return false;
  fs::path outer = fs::weakly_canonical(folder, error);
  if (error) return false;
  if (!outer.has_filename()) outer = outer.parent_path();
  return std::mismatch(outer.begin(), outer.end(), inner.begin(), inner.end()).first == outer.end();
}

}}  // namespace palpate::v0
