#include "src/core/internal/shared_library.h"

#include <dlfcn.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <system_error>

namespace palpate { inline namespace v0 {
namespace {

namespace fs = std::filesystem;

// Not with sanitizers, which GCC and Clang announce in different ways.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || !defined(RTLD_DEEPBIND)
constexpr int kTheirOwnFirst = 0;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || \
    __has_feature(memory_sanitizer)
constexpr int kTheirOwnFirst = 0;
#else
constexpr int kTheirOwnFirst = RTLD_DEEPBIND;
#endif
#else
constexpr int kTheirOwnFirst = RTLD_DEEPBIND;
#endif

/// Why `candidate` did not load, in few words: most candidates are simply not there.
std::string complaint(const std::string& candidate, const char* loader_said) {
  const bool is_path = candidate.find('/') != std::string::npos;
  std::error_code ignored;
  if (is_path && !fs::exists(candidate, ignored)) return candidate;
  if (!is_path) return candidate + " (by the loader)";
  return candidate + " (" + (loader_said == nullptr ? "not loadable" : loader_said) + ")";
}

}  // namespace

Result<SharedLibrary> SharedLibrary::open(std::span<const std::string> candidates,
                                          Symbols symbols) {
  std::vector<std::string> complaints;
  for (const std::string& candidate : candidates) {
    const int binding = symbols == Symbols::their_own_first ? kTheirOwnFirst : 0;
    void* const handle = dlopen(candidate.c_str(), RTLD_NOW | RTLD_LOCAL | binding);
    if (handle != nullptr) return SharedLibrary(candidate, handle);
    complaints.push_back(complaint(candidate, dlerror()));
  }
  return Error{Errc::not_found, "tried " + listed(complaints)};
}

void* SharedLibrary::symbol(const char* name) const { return dlsym(handle_, name); }

Status SharedLibrary::check(const std::string& remedy) const {
  if (missing_.empty()) return Done{};
  return Error{Errc::unavailable, path_ + " lacks " + listed(missing_) + remedy};
}

std::vector<std::string> library_files(const std::string& folder, std::string_view stem) {
  std::vector<std::string> files;
  std::error_code error;
  fs::directory_iterator entry(folder, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    if (entry->path().filename().native().starts_with(stem)) files.push_back(entry->path());
  }
  std::sort(files.begin(), files.end(), std::greater<>());
  if (files.empty()) files.push_back(folder + "/" + std::string(stem));
  return files;
}

std::string version_of_file(std::string_view path) {
  constexpr std::string_view kMark = ".so.";
  const std::size_t at = path.rfind(kMark);
  return at == std::string_view::npos ? "" : std::string(path.substr(at + kMark.size()));
}

std::string environment(const char* variable) {
  const char* value = std::getenv(variable);
  return value == nullptr ? "" : value;
}

std::vector<std::string> given_by(const char* variable) {
  std::string value = environment(variable);
  return value.empty() ? std::vector<std::string>() : std::vector{std::move(value)};
}

std::string listed(std::span<const std::string> names) {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
  return list;
}

}}  // namespace palpate::v0
