// SHA-256 (FIPS 180-4): ROS 2 names message types by it, and it tells whether files have changed.
#pragma once

#include <string>
#include <string_view>

namespace palpate { inline namespace v0 {

/// Returns the digest as 64 hexadecimal digits.
std::string sha256(std::string_view bytes);

}}  // namespace palpate::v0
