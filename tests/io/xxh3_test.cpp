// The checksum of tool files against the library that defines it.
#include "src/io/internal/hashes.h"

#include <gtest/gtest.h>
#include <xxhash.h>

#include <string>

namespace palpate {
namespace {

std::string noise(std::size_t length) {
  std::string bytes(length, '\0');
  std::uint64_t state = 88172645463325252u;
  for (char& byte : bytes) {
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    byte = static_cast<char>(state >> 32);
  }
  return bytes;
}

TEST(Xxh3, EqualsTheLibraryForEveryLength) {
  const std::string bytes = noise((std::size_t(1) << 20) + 77);
  // Every end of a stripe and of a block of 1024 bytes, and some long ones at odd places.
  for (std::size_t length = kMinXxh3Bytes; length < 3300; ++length) {
    ASSERT_EQ(xxh3_of_long({bytes.data() + length % 9, length}),
              XXH3_64bits(bytes.data() + length % 9, length))
        << length;
  }
  for (const std::size_t length : {std::size_t(65536), std::size_t(1000003), bytes.size()}) {
    EXPECT_EQ(xxh3_of_long({bytes.data(), length}), XXH3_64bits(bytes.data(), length)) << length;
  }
}

}  // namespace
}  // namespace palpate
