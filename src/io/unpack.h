// Compressed parts of recordings, by libraries that are found when the program runs.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "palpate/core/core.h"

namespace palpate::inline v0 {

/// Depth images are packed to a tenth: error if so few bytes would become so many that nobody has
/// packed them, or more than 1 GiB.
Status check_unpacked_size(std::uint64_t packed, std::uint64_t size);

/// LZ4 frames (liblz4) and bzip2 (libbz2): `size` bytes that were packed into `packed`. Memory is
/// taken as it is filled, whatever `size` says. Errors: the library is not there, the bytes are
/// damaged or too few.
Status unpack_lz4(std::string_view packed, std::uint64_t size, std::string& to);
Status unpack_bzip2(std::string_view packed, std::uint64_t size, std::string& to);

}  // namespace palpate::inline v0
