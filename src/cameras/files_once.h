// Files that others name again and again: each is read once.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <system_error>
#include <utility>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

template <class Content>
class FilesOnce {
 public:
  /// Returns the content that `load` makes of the file; `load` is called once. Error: as of `load`.
  template <class Load>
  Result<std::shared_ptr<const Content>> get(const std::filesystem::path& path, const Load& load) {
    std::shared_ptr<const Content>& named = contents_[path.string()];
    if (named) return named;
    // A file may be spelled in several ways.
    std::error_code error;
    const std::filesystem::path file = std::filesystem::canonical(path, error);
    std::shared_ptr<const Content>& found = error ? named : contents_[file.string()];
    if (!found) {
      auto loaded = load(path);
      if (!loaded) return loaded.error();
      found = std::make_shared<const Content>(*std::move(loaded));
    }
    return named = found;
  }

 private:
  std::map<std::string, std::shared_ptr<const Content>> contents_;  // by path
};

}}  // namespace palpate::v0
