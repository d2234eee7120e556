// Members of a glTF document, checked as they are read. A fault of the file is thrown as a Fault
// and caught where the file is read (gltf_mesh.cpp).
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include <nlohmann/json.hpp>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 { namespace gltf {

using Json = nlohmann::json;

/// Fault of a file: the rest of a sentence that begins with its name.
struct Fault {
  std::string what;
};

inline std::string item(const char* kind, std::size_t index) {
  return std::string(kind) + " " + std::to_string(index);
}

inline void require_object(const Json& value, const char* key) {
  if (!value.is_object()) throw Fault{std::string("has no object where '") + key + "' belongs"};
}

/// Returns a member that is a list; an absent one is empty.
inline const Json& list(const Json& object, const char* key) {
  static const Json kNone = Json::array();
  require_object(object, key);
  const auto found = object.find(key);
  if (found == object.end()) return kNone;
  if (!found->is_array()) throw Fault{std::string("has no list as '") + key + "'"};
  return *found;
}

inline std::uint64_t whole(const Json& value, const char* what) {
  if (value.is_number_unsigned()) return value.get<std::uint64_t>();
  throw Fault{std::string("has a '") + what + "' that is not a whole number"};
}

/// Returns a member that is a whole number; none if it is absent.
inline std::optional<std::uint64_t> whole_member(const Json& object, const char* key) {
  require_object(object, key);
  const auto found = object.find(key);
  if (found == object.end()) return std::nullopt;
  return whole(*found, key);
}

inline std::size_t index_into(std::size_t size, std::uint64_t index, const char* what) {
  if (index < size) return static_cast<std::size_t>(index);
  throw Fault{std::string("names ") + what + " " + std::to_string(index) + " of only " +
              std::to_string(size)};
}

}}}  // namespace palpate::v0::gltf
