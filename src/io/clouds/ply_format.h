// The parts of PLY that meshes and clouds share: the header and the numbers behind it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

enum class PlyType { i8, u8, i16, u16, i32, u32, f32, f64 };

struct PlyProperty {
  std::string name;
  std::optional<PlyType> list_count;  ///< set for lists
  PlyType type;
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;
};

enum class PlyEncoding { text, little_endian, big_endian };

struct PlyHeader {
  PlyEncoding encoding = PlyEncoding::text;
  std::vector<PlyElement> elements;
};

/// Takes the header off `content`. Errors are the rest of a sentence that starts with the name of
/// the file.
Result<PlyHeader> take_ply_header(std::string_view& content);

/// Reads one value after the other; every PLY number fits into a double.
class PlyValues {
 public:
  PlyValues(std::string_view rest, PlyEncoding encoding) : rest_(rest), encoding_(encoding) {}

  std::size_t bytes_left() const { return rest_.size(); }

  /// nullopt at the end, or if the text there is no number.
  std::optional<double> next(PlyType type);

  /// Length of a list; nullopt if there is no number, or the rest of the file is too short for it.
  std::optional<std::size_t> list_size(const PlyProperty& property);

  /// Passes over a list; false if it does not end.
  bool skip_list(const PlyProperty& property);

  /// The least bytes that a value can take.
  std::size_t min_bytes(PlyType type) const;

 private:
  template <class T>
  std::optional<double> binary();

  std::string_view rest_;
  PlyEncoding encoding_;
};

/// Refuses counts that the rest of the file cannot hold, before anything is allocated for them.
std::optional<Error> check_ply_count(const PlyElement& element, const PlyValues& values);

}}  // namespace palpate::v0
