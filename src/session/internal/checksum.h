// Checksums of files, to detect changes.
#pragma once

#include <string>
#include <string_view>

namespace palpate { inline namespace v0 {

/// XXH3 of the bytes, 128 bits in hexadecimal: equal for equal bytes, and for nothing else that
/// happens by accident.
std::string checksum(std::string_view bytes);

}}  // namespace palpate::v0
