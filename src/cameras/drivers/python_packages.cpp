#include "src/cameras/drivers/python_packages.h"

#include <algorithm>
#include <filesystem>
#include <functional>
#include <system_error>

#include "src/core/internal/shared_library.h"

namespace palpate { inline namespace v0 {
namespace {

namespace fs = std::filesystem;

/// FOLDER/lib/python3.*/{site,dist}-packages.
std::vector<fs::path> package_folders() {
  std::vector<fs::path> roots;
  if (const std::string active = environment("VIRTUAL_ENV"); !active.empty()) {
    roots.emplace_back(active);
  }
  if (const std::string home = environment("HOME"); !home.empty()) {
    roots.emplace_back(fs::path(home) / ".local");
  }
  roots.insert(roots.end(), {"/usr/local", "/usr"});
  std::vector<fs::path> folders;
  std::error_code error;
  for (const fs::path& root : roots) {
    for (fs::directory_iterator it(root / "lib", error), end; !error && it != end;
         it.increment(error)) {
      if (!it->path().filename().native().starts_with("python3")) continue;
      folders.push_back(it->path() / "site-packages");
      folders.push_back(it->path() / "dist-packages");
    }
  }
  return folders;
}

}  // namespace

std::vector<std::string> files_of_python_package(const std::string& package,
                                                 std::string_view stem) {
  std::vector<std::string> files;
  std::error_code error;
  for (const fs::path& folder : package_folders()) {
    if (!fs::is_directory(folder / package, error)) continue;
    const auto more = library_files((folder / package).string(), stem);
    files.insert(files.end(), more.begin(), more.end());
  }
  std::erase_if(files, [](const std::string& file) { return file.ends_with(".debug"); });
  return files;
}

std::string python_library_of(std::string_view module) {
  constexpr std::string_view kTag = ".cpython-3";
  const std::size_t at = module.find(kTag);
  if (at == std::string_view::npos) return {};
  const std::string_view rest = module.substr(at + kTag.size());
  const auto end =
      std::find_if(rest.begin(), rest.end(), [](char c) { return c < '0' || c > '9'; });
  return "libpython3." + std::string(rest.begin(), end) + ".so.1.0";
}

}}  // namespace palpate::v0
