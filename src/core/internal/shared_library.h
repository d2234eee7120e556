// Drivers that are found when the program runs: nothing of a vendor is needed to build Palpate.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// A loaded library. It stays loaded until the program ends: drivers have threads of their own, and
/// some fail when they are loaded a second time.
class SharedLibrary {
 public:
  /// Definition that a library uses of a symbol that this program has, too. Some libraries contain
  /// others (LZ4, xxHash, ...) of another version, and need their own.
  enum class Symbols { of_the_program, their_own_first };

  /// The first of `candidates` (paths, or names for the loader's own search) that loads. Errors:
  /// none does; every one of them and what was wrong with it.
  static Result<SharedLibrary> open(std::span<const std::string> candidates,
                                    Symbols symbols = Symbols::of_the_program);

  /// The name that it was opened by.
  const std::string& path() const { return path_; }

  /// The function of this name; null, and noted as missing, if there is none.
  template <class Function>
  void require(const char* name, Function*& function) {
    find(name, function);
    if (function == nullptr) missing_.emplace_back(name);
  }
  /// The same for a function that need not be there.
  template <class Function>
  void find(const char* name, Function*& function) const {
    function = reinterpret_cast<Function*>(symbol(name));
  }
  /// Refuses a library that lacks what was required. `remedy` ends the error: "; install ...".
  Status check(const std::string& remedy) const;

 private:
  SharedLibrary(std::string path, void* handle) : path_(std::move(path)), handle_(handle) {}
  void* symbol(const char* name) const;

  std::string path_;
  void* handle_;
  std::vector<std::string> missing_;
};

/// The files of `folder` whose names begin with `stem` ("libX.so", "libX.so.3", ...), longest
/// version first; the path of `stem` itself if there are none, so that errors name it.
std::vector<std::string> library_files(const std::string& folder, std::string_view stem);

/// "1.4.2" of ".../libX.so.1.4.2"; empty if the name has none.
std::string version_of_file(std::string_view path);

/// The value of an environment variable; empty if it is not set.
std::string environment(const char* variable);
/// The same as a list; empty if it is not set.
std::vector<std::string> given_by(const char* variable);

/// "a, b, c".
std::string listed(std::span<const std::string> names);

}}  // namespace palpate::v0
