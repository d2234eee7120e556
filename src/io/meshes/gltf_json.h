// Members of the JSON of a glTF file, each with the type that it must have. A file that has them
// otherwise is refused: these functions throw its Fault.
#pragma once

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

namespace palpate { inline namespace v0 { namespace gltf {

using Json = nlohmann::json;

/// Fault of a file, as the rest of a sentence that starts with its name. Caught by gltf_geometry.
struct Fault {
  std::string what;
};

/// Names one item of a list.
inline std::string item(const char* kind, std::size_t index) {
  return std::string(kind) + " " + std::to_string(index);
}

/// Returns a member that is a list; an absent one is empty.
inline const Json& list(const Json& object, const char* key) {
  static const Json kNone = Json::array();
  if (!object.is_object()) throw Fault{std::string("has no object where '") + key + "' belongs"};
  const auto found = object.find(key);
  if (found == object.end()) return kNone;
  if (!found->is_array()) throw Fault{std::string("has no list as '") + key + "'"};
  return *found;
}

/// Returns a whole number; `what`: name of the member that it is in.
inline std::uint64_t whole(const Json& value, const char* what) {
  if (value.is_number_unsigned()) return value.get<std::uint64_t>();
  throw Fault{std::string("has a '") + what + "' that is not a whole number"};
}

/// Returns a member that is a whole number, if there is one.
inline std::optional<std::uint64_t> whole_member(const Json& object, const char* key) {
  if (!object.is_object()) throw Fault{std::string("has no object where '") + key + "' belongs"};
  const auto found = object.find(key);
  if (found == object.end()) return std::nullopt;
  return whole(*found, key);
}

/// Returns the index of one of `size` items.
inline std::size_t index_into(std::size_t size, std::uint64_t index, const char* what) {
  if (index < size) return static_cast<std::size_t>(index);
  throw Fault{std::string("names ") + what + " " + std::to_string(index) + " of only " +
              std::to_string(size)};
}

/// Copies members that are there and are whole numbers.
inline void copy_whole(const Json& from, std::initializer_list<const char*> keys, Json& to) {
  for (const char* key : keys) {
    if (const auto value = whole_member(from, key)) to[key] = *value;
  }
}

}}}  // namespace palpate::v0::gltf
