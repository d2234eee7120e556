#include "src/ros/native_layout.h"

#include <algorithm>
#include <cstring>

#include "src/core/internal/assert.h"
#include "src/io/internal/cdr.h"
#include "src/ros/internal/dds_api.h"

namespace palpate { inline namespace v0 {
namespace {

using Shape = RosField::Shape;

/// Bytes of a number.
std::size_t size_of(RosBase base) {
  switch (base) {
    case RosBase::int16:
    case RosBase::uint16: return 2;
    case RosBase::int32:
    case RosBase::uint32:
    case RosBase::float32: return 4;
    case RosBase::int64:
    case RosBase::uint64:
    case RosBase::float64: return 8;
    case RosBase::text: return sizeof(char*);
    default: return 1;
  }
}

dds::Type type_of(const RosField& field) {
  if (field.base == RosBase::nested) return dds::kStruct;
  if (field.base == RosBase::text) return dds::kString;
  switch (size_of(field.base)) {
    case 1: return dds::k1Byte;
    case 2: return dds::k2Bytes;
    case 4: return dds::k4Bytes;
    default: return dds::k8Bytes;
  }
}

std::size_t aligned(std::size_t offset, std::size_t align) {
  return (offset + align - 1) / align * align;
}

}  // namespace

void* NativeMessage::add(std::size_t size) {
  return blocks_.emplace_back(std::make_unique<std::uint64_t[]>(size / 8 + 1)).get();
}

NativeLayout::NativeLayout(const std::string& type) {
  for (const RosField& field : ros_fields(type)) {
    Field& added = fields_.emplace_back();
    added.what = field;
    std::size_t align = added.size = size_of(added.what.base);
    if (added.what.base == RosBase::nested) {
      added.nested = std::make_shared<NativeLayout>(added.what.type);
      added.size = added.nested->size();
      align = added.nested->align();
    }
    std::size_t size = added.size;
    if (added.what.shape == Shape::array) size *= added.what.count;
    if (added.what.shape == Shape::sequence) {
      size = sizeof(dds::Sequence);
      align = alignof(dds::Sequence);
    }
    added.offset = aligned(size_, align);
    size_ = added.offset + size;
    align_ = std::max(align_, align);
  }
  PALPATE_ASSERT(!fields_.empty());  // no such type
  size_ = aligned(size_, align_);
}

std::vector<std::uint32_t> NativeLayout::program() const {
  std::vector<std::uint32_t> program;
  add_program(0, program);
  program.push_back(dds::kReturn);
  return program;
}

void NativeLayout::add_program(std::size_t base, std::vector<std::uint32_t>& program) const {
  for (const Field& field : fields_) {
    const std::size_t offset = base + field.offset;
    const dds::Type type = type_of(field.what);
    if (field.what.shape == Shape::single) {
      if (field.nested) {
        field.nested->add_program(offset, program);
        continue;
      }
      program.push_back(dds::kAddress | type << 16);
      program.push_back(static_cast<std::uint32_t>(offset));
      continue;
    }
    const bool is_array = field.what.shape == Shape::array;
    PALPATE_ASSERT(!is_array || !field.nested);  // not needed so far
    program.push_back(dds::kAddress | (is_array ? dds::kArray : dds::kSequence) << 16 | type << 8);
    program.push_back(static_cast<std::uint32_t>(offset));
    if (is_array) program.push_back(field.what.count);
    if (!field.nested) continue;
    // The program of an element follows, and how to get there and past it.
    std::vector<std::uint32_t> element = field.nested->program();
    program.push_back(static_cast<std::uint32_t>(field.size));
    program.push_back(static_cast<std::uint32_t>(4 + element.size()) << 16 | 4);
    program.insert(program.end(), element.begin(), element.end());
  }
}

Result<NativeMessage> NativeLayout::to_native(std::string_view message) const {
  CdrReader from(message);
  NativeMessage native(size_);
  if (read(from, static_cast<char*>(native.get()), native) && from.is_good()) return native;
  return Error{Errc::bad_input, "a message is damaged"};
}

bool NativeLayout::read(CdrReader& from, char* to, NativeMessage& message) const {
  for (const Field& field : fields_) {
    char* const place = to + field.offset;
    if (field.what.shape != Shape::sequence) {
      const std::uint32_t num = field.what.shape == Shape::array ? field.what.count : 1;
      for (std::uint32_t i = 0; i < num; ++i) {
        if (!read_one(field, from, place + i * field.size, message)) return false;
      }
      continue;
    }
    dds::Sequence sequence;
    if (!field.nested && field.size == 1) {
      const std::string_view bytes = from.bytes();
      sequence.length = static_cast<std::uint32_t>(bytes.size());
      sequence.buffer = const_cast<char*>(bytes.data());  // read only
    } else {
      sequence.length = from.number<std::uint32_t>();
      if (sequence.length > from.num_left()) return false;  // an element has a byte or more
      sequence.buffer = message.add(sequence.length * field.size);
      for (std::uint32_t i = 0; i < sequence.length; ++i) {
        char* const element = static_cast<char*>(sequence.buffer) + i * field.size;
        if (!read_one(field, from, element, message)) return false;
      }
    }
    sequence.maximum = sequence.length;
    std::memcpy(place, &sequence, sizeof sequence);
  }
  return from.is_good();
}

bool NativeLayout::read_one(const Field& field, CdrReader& from, char* to, NativeMessage& message) {
  const auto copy = [to](auto number) { std::memcpy(to, &number, sizeof number); };
  switch (type_of(field.what)) {
    case dds::kStruct: return field.nested->read(from, to, message);
    case dds::kString: {
      const std::string_view text = from.text();
      char* const place = static_cast<char*>(message.add(text.size() + 1));
      std::copy(text.begin(), text.end(), place);
      copy(place);
      break;
    }
    case dds::k1Byte: copy(from.number<std::uint8_t>()); break;
    case dds::k2Bytes: copy(from.number<std::uint16_t>()); break;
    case dds::k4Bytes: copy(from.number<std::uint32_t>()); break;
    default: copy(from.number<std::uint64_t>());
  }
  return from.is_good();
}

std::string NativeLayout::from_native(const void* native) const {
  CdrWriter to;
  write(static_cast<const char*>(native), to);
  return to.take();
}

void NativeLayout::write(const char* from, CdrWriter& to) const {
  for (const Field& field : fields_) {
    const char* place = from + field.offset;
    std::uint32_t num = field.what.shape == Shape::array ? field.what.count : 1;
    if (field.what.shape == Shape::sequence) {
      dds::Sequence sequence;
      std::memcpy(&sequence, place, sizeof sequence);
      if (!field.nested && field.size == 1) {
        to.bytes(sequence.buffer, sequence.length);
        continue;
      }
      to.number(sequence.length);
      num = sequence.length;
      place = static_cast<const char*>(sequence.buffer);
    }
    for (std::uint32_t i = 0; i < num; ++i) write_one(field, place + i * field.size, to);
  }
}

void NativeLayout::write_one(const Field& field, const char* from, CdrWriter& to) {
  const auto put = [&]<class Number>(Number number) {
    std::memcpy(&number, from, sizeof number);
    to.number(number);
  };
  switch (type_of(field.what)) {
    case dds::kStruct: field.nested->write(from, to); break;
    case dds::kString: {
      const char* text = nullptr;
      std::memcpy(&text, from, sizeof text);
      to.text(text == nullptr ? "" : text);
      break;
    }
    case dds::k1Byte: put(std::uint8_t{}); break;
    case dds::k2Bytes: put(std::uint16_t{}); break;
    case dds::k4Bytes: put(std::uint32_t{}); break;
    default: put(std::uint64_t{});
  }
}

}}  // namespace palpate::v0
