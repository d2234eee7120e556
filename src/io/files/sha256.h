// SHA-256 (FIPS 180-4): ROS 2 names message types by it.
#pragma once

#include <string>
#include <string_view>

namespace palpate { inline namespace v0 {

/// In 64 hexadecimal digits.
std::string sha256(std::string_view text);

}}  // namespace palpate::v0
