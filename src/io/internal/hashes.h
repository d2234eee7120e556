// Digests of contents.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace palpate { inline namespace v0 {

/// Returns the SHA-1 (FIPS 180-4) of a text, as the opening of a WebSocket requires it. Nothing
/// there is a secret: SHA-1 is no protection any more.
std::array<std::uint8_t, 20> sha1(std::string_view text);

/// Returns the SHA-256 (FIPS 180-4) of bytes as 64 hexadecimal digits: ROS 2 names message types by
/// it, and it tells whether files have changed.
std::string sha256(std::string_view bytes);

/// The algorithm is defined for every length; this is its part for contents longer than this.
inline constexpr std::size_t kMinXxh3Bytes = 241;

/// Returns the checksum of tool files, XXH3_64bits of at least kMinXxh3Bytes bytes, on
/// little-endian machines. About 5 GB/s. Source: Y. Collet, xxHash 0.8 specification.
std::uint64_t xxh3_of_long(std::string_view bytes);

}}  // namespace palpate::v0
