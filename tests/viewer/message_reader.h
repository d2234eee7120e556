// Binary messages taken apart, from nothing but docs/viewer-protocol.md.
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace palpate::test {

class MessageReader {
 public:
  explicit MessageReader(std::string bytes) : bytes_(std::move(bytes)) {
    kind = take<std::uint16_t>();
    protocol = take<std::uint16_t>();
    number = take<std::uint32_t>();
    time = take<double>();
  }

  template <class Value>
  Value take() {
    Value value{};
    EXPECT_LE(at_ + sizeof value, bytes_.size()) << "the message ends too early";
    if (at_ + sizeof value <= bytes_.size()) std::memcpy(&value, bytes_.data() + at_, sizeof value);
    at_ += sizeof value;
    return value;
  }
  template <class Value>
  std::vector<Value> take(std::size_t count) {
    std::vector<Value> values;
    for (std::size_t i = 0; i < count && at_ < bytes_.size(); ++i) values.push_back(take<Value>());
    return values;
  }
  bool is_at_end() const { return at_ == bytes_.size(); }
  std::size_t position() const { return at_; }

  int kind = 0, protocol = 0;
  std::uint32_t number = 0;
  double time = 0;

 private:
  std::string bytes_;
  std::size_t at_ = 0;
};

}  // namespace palpate::test
