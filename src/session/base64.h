// Bytes as text (RFC 4648).
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace palpate {

std::string base64(const std::string& bytes);
/// Nothing if the text is not base64, padded to a multiple of four.
std::optional<std::string> from_base64(std::string_view text);

}  // namespace palpate
