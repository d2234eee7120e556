// SHA-1 (FIPS 180-4) and base64 (RFC 4648), as the opening of a WebSocket requires them. Nothing
// here is a secret: SHA-1 is no protection any more.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace palpate { inline namespace v0 {

std::array<std::uint8_t, 20> sha1(std::string_view text);
std::string base64(std::span<const std::uint8_t> bytes);

}}  // namespace palpate::v0
