// Names of links and joints as messages have them.
#pragma once

#include <string>
#include <string_view>

namespace palpate { inline namespace v0 {

/// Its first characters: a file may have megabytes of it, and a message comes with every frame.
inline std::string shown(std::string_view name) {
  constexpr std::size_t kMaxCharacters = 60;
  return std::string(name.substr(0, kMaxCharacters));
}

}}  // namespace palpate::v0
