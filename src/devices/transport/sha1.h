// SHA-1 (FIPS 180-4), as the opening of a WebSocket requires it. Nothing here is a secret: SHA-1 is
// no protection any more.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace palpate { inline namespace v0 {

std::array<std::uint8_t, 20> sha1(std::string_view text);

}}  // namespace palpate::v0
