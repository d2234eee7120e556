// Bytes as text (RFC 4648).
#pragma once

#include <string>

namespace palpate { inline namespace v0 {

std::string base64(const std::string& bytes);

}}  // namespace palpate::v0
