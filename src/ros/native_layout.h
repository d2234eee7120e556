// Messages as structures of C, which is how Cyclone DDS takes and gives them. Their layout follows
// from the definition of the type.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/core/core.h"
#include "src/io/internal/ros_types.h"

namespace palpate { inline namespace v0 {

class CdrReader;
class CdrWriter;

/// A message as a structure, with all that it points at.
class NativeMessage {
 public:
  explicit NativeMessage(std::size_t size) { add(size); }
  void* get() const { return blocks_.front().get(); }
  /// Zeros, aligned for every number; lives as long as the message.
  void* add(std::size_t size);

 private:
  std::vector<std::unique_ptr<std::uint64_t[]>> blocks_;
};

class NativeLayout {
 public:
  /// Computes the layout of a type that ros_types.h knows.
  explicit NativeLayout(const std::string& type);

  std::size_t size() const { return size_; }
  std::size_t align() const { return align_; }
  /// The description for Cyclone DDS.
  std::vector<std::uint32_t> program() const;

  /// Error: a damaged message.
  Result<NativeMessage> to_native(std::string_view message) const;
  std::string from_native(const void* native) const;

 private:
  struct Field {
    RosField what;
    std::size_t offset = 0, size = 0;      // of one element
    std::shared_ptr<NativeLayout> nested;  // of a nested type
  };
  void add_program(std::size_t offset, std::vector<std::uint32_t>& program) const;
  bool read(CdrReader& from, char* to, NativeMessage& message) const;
  void write(const char* from, CdrWriter& to) const;
  static bool read_one(const Field& field, CdrReader& from, char* to, NativeMessage& message);
  static void write_one(const Field& field, const char* from, CdrWriter& to);

  std::vector<Field> fields_;
  std::size_t size_ = 0, align_ = 1;
};

}}  // namespace palpate::v0
