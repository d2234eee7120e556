#include "src/io/internal/hashes.h"

#include <array>
#include <bit>
#include <cstring>

#include "src/core/internal/assert.h"

namespace palpate { inline namespace v0 {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr std::uint64_t kPrime32_1 = 0x9E3779B1, kPrime32_2 = 0x85EBCA77, kPrime32_3 = 0xC2B2AE3D;
constexpr std::uint64_t kPrime64_1 = 0x9E3779B185EBCA87, kPrime64_2 = 0xC2B2AE3D27D4EB4F,
                        kPrime64_3 = 0x165667B19E3779F9, kPrime64_4 = 0x85EBCA77C2B2AE63,
                        kPrime64_5 = 0x27D4EB2F165667C5;

/// The secret of the specification: 192 bytes that the content is mixed with.
constexpr std::array<std::uint64_t, 24> kSecret{
    0xbe4ba423396cfeb8, 0x1cad21f72c81017c, 0xdb979083e96dd4de, 0x1f67b3b7a4a44072,
    0x78e5c0cc4ee679cb, 0x2172ffcc7dd05a82, 0x8e2443f7744608b8, 0x4c263a81e69035e0,
    0xcb00c391bb52283c, 0xa32e531b8b65d088, 0x4ef90da297486471, 0xd8acdea946ef1938,
    0x3f349ce33f76faa8, 0x1d4f0bc7c7bbdcf9, 0x3159b4cd4be0518a, 0x647378d9c97e9fc8,
    0xc3ebd33483acc5ea, 0xeb6313faffa081c5, 0x49daf0b751dd0d17, 0x9e68d429265516d3,
    0xfca1477d58be162b, 0xce31d07ad1b8f88f, 0x280416958f3acb45, 0x7e404bbbcafbd7af};
constexpr std::size_t kSecretBytes = sizeof(kSecret);

/// Contents are read in stripes of eight words. Stripe n of a block starts n words later in the
/// secret; a block ends where the secret does.
constexpr std::size_t kStripe = 64, kStripesPerBlock = (kSecretBytes - kStripe) / 8,
                      kBlock = kStripe * kStripesPerBlock;
using Words = std::array<std::uint64_t, 8>;

Words words_at(const char* bytes) {
  Words words;
  std::memcpy(words.data(), bytes, sizeof(words));
  return words;
}

const char* secret_at(std::size_t byte) {
  return reinterpret_cast<const char*>(kSecret.data()) + byte;
}

void accumulate(Words& sums, const char* stripe, const char* secret) {
  const Words content = words_at(stripe), key = words_at(secret);
  for (std::size_t i = 0; i < 8; ++i) {
    const std::uint64_t mixed = content[i] ^ key[i];
    sums[i ^ 1] += content[i];
    sums[i] += (mixed & 0xffffffff) * (mixed >> 32);
  }
}

void scramble(Words& sums) {
  const Words key = words_at(secret_at(kSecretBytes - kStripe));
  for (std::size_t i = 0; i < 8; ++i) {
    sums[i] = (sums[i] ^ (sums[i] >> 47) ^ key[i]) * kPrime32_1;
  }
}

/// High and low half of the product of 128 bits, mixed.
std::uint64_t folded_product(std::uint64_t a, std::uint64_t b) {
  __extension__ using Wide = unsigned __int128;
  const Wide product = Wide(a) * b;
  return static_cast<std::uint64_t>(product) ^ static_cast<std::uint64_t>(product >> 64);
}

}  // namespace

std::uint64_t xxh3_of_long(std::string_view bytes) {
  PALPATE_ASSERT(bytes.size() >= kMinXxh3Bytes);
  Words sums{kPrime32_3, kPrime64_1, kPrime64_2, kPrime64_3,
             kPrime64_4, kPrime32_2, kPrime64_5, kPrime32_1};
  const std::size_t num_blocks = (bytes.size() - 1) / kBlock;
  for (std::size_t block = 0; block <= num_blocks; ++block) {
    const char* content = bytes.data() + block * kBlock;
    const std::size_t num_stripes =
        block < num_blocks ? kStripesPerBlock : (bytes.size() - 1 - block * kBlock) / kStripe;
    for (std::size_t n = 0; n < num_stripes; ++n) {
      accumulate(sums, content + n * kStripe, secret_at(n * 8));
    }
    if (block < num_blocks) scramble(sums);
  }
  // The last stripe may overlap the one before it.
  accumulate(sums, bytes.data() + bytes.size() - kStripe, secret_at(kSecretBytes - kStripe - 7));

  const Words key = words_at(secret_at(11));
  std::uint64_t hash = bytes.size() * kPrime64_1;
  for (std::size_t i = 0; i < 8; i += 2) {
    hash += folded_product(sums[i] ^ key[i], sums[i + 1] ^ key[i + 1]);
  }
  hash = (hash ^ (hash >> 37)) * 0x165667919E3779F9;
  return hash ^ (hash >> 32);
}

}}  // namespace palpate::v0
