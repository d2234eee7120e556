#include "src/session/internal/checksum.h"

#include <xxhash.h>

#include <cstdio>

namespace palpate { inline namespace v0 {

std::string checksum(std::string_view bytes) {
  const XXH128_hash_t hash = XXH3_128bits(bytes.data(), bytes.size());
  char text[40];
  std::snprintf(text, sizeof text, "%016llx%016llx", static_cast<unsigned long long>(hash.high64),
                static_cast<unsigned long long>(hash.low64));
  return text;
}

}}  // namespace palpate::v0
