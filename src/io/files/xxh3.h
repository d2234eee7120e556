// XXH3, 64 bits, of long contents: the checksum of tool files, without a library.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

namespace palpate { inline namespace v0 {

/// The algorithm is defined for every length; this is its part for contents longer than this.
inline constexpr std::size_t kMinXxh3Bytes = 241;

/// XXH3_64bits of at least kMinXxh3Bytes bytes, on little-endian machines. About 5 GB/s.
/// Source: Y. Collet, xxHash 0.8 specification.
std::uint64_t xxh3_of_long(std::string_view bytes);

}}  // namespace palpate::v0
