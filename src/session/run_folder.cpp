#include "palpate/session/run_folder.h"

#include <string>
#include <utility>

namespace palpate {
namespace fs = std::filesystem;
namespace {

/// Nothing, an empty folder, or a run of ours: what may be replaced.
Status check_replaceable(const fs::path& folder) {
  std::error_code error;
  const fs::file_status status = fs::symlink_status(folder, error);
  if (status.type() == fs::file_type::not_found) return Done{};
  if (status.type() != fs::file_type::directory) {
    return Error{Errc::io_failure, "cannot write a run to " + folder.string() +
                                       ": it is not a folder; give a new name"};
  }
  if (fs::is_empty(folder, error) && !error) return Done{};
  if (fs::is_regular_file(folder / kRecordingFolder / kRecordingManifest, error)) return Done{};
  return Error{Errc::io_failure,
               "cannot write a run to " + folder.string() +
                   ": it holds other things than an earlier run; give a new name"};
}

Error failure(const char* what, const fs::path& folder, const std::error_code& error) {
  return {Errc::io_failure, std::string(what) + " " + folder.string() + ": " + error.message() +
                                "; check the folder above it, its permissions and the free space"};
}

}  // namespace

RunFolder::RunFolder(fs::path target, fs::path partial)
    : target_(std::move(target)), partial_(std::move(partial)) {}

RunFolder::RunFolder(RunFolder&& other) noexcept
    : target_(std::move(other.target_)), partial_(std::exchange(other.partial_, {})) {}

RunFolder::~RunFolder() {
  std::error_code ignored;
  if (!partial_.empty()) fs::remove_all(partial_, ignored);
}

Result<RunFolder> RunFolder::create(const fs::path& name) {
  std::error_code error;
  fs::path target = fs::weakly_canonical(name, error);
  if (error) return failure("cannot find", name, error);
  if (!target.has_filename()) target = target.parent_path();
  if (!target.has_filename()) {
    return Error{Errc::invalid_argument,
                 "cannot write a run to '" + name.string() + "': give the name of a new folder"};
  }
  fs::path partial = target;
  partial += ".partial";
  for (const fs::path& folder : {target, partial}) {
    if (const Status status = check_replaceable(folder); !status) return status.error();
  }
  // A run that was killed leaves its partial folder behind.
  fs::remove_all(partial, error);
  if (!error) fs::create_directory(partial, error);
  if (error) return failure("cannot make the folder", partial, error);
  return RunFolder(std::move(target), std::move(partial));
}

Status RunFolder::commit() {
  std::error_code error, ignored;
  fs::path old = target_;
  old += ".replaced";
  const bool replaces = fs::exists(target_, ignored);
  if (replaces) {
    if (const Status status = check_replaceable(old); !status) return status.error();
    fs::remove_all(old, error);
    if (!error) fs::rename(target_, old, error);
    if (error) return failure("cannot replace", target_, error);
  }
  fs::rename(partial_, target_, error);
  if (error) {
    if (replaces) fs::rename(old, target_, ignored);
    return failure("cannot write", target_, error);
  }
  partial_.clear();
  if (replaces) fs::remove_all(old, ignored);
  return Done{};
}

}  // namespace palpate
