// Tool files: the checksum and the length are put right, so that what they hide is reached.
#include <xxhash.h>

#include <cstring>

#include "palpate/io/files.h"
#include "tests/fuzz/target.h"
#include "tests/test_util/contact_scenes.h"

namespace palpate::fuzz {
namespace {

constexpr std::size_t kLengthAt = 16, kChecksumBytes = 8;

void seal(std::string& bytes) {
  if (bytes.size() < kLengthAt + 8 + kChecksumBytes) return;
  const std::uint64_t length = bytes.size();
  std::memcpy(bytes.data() + kLengthAt, &length, sizeof length);
  const std::uint64_t checksum = XXH3_64bits(bytes.data(), bytes.size() - kChecksumBytes);
  std::memcpy(bytes.data() + bytes.size() - kChecksumBytes, &checksum, sizeof checksum);
}

}  // namespace

std::vector<std::string> seeds() {
  return {*tool_to_bytes(test::random_tool(1, 0.03, 1)),
          *tool_to_bytes(test::random_tool(12, 0.03, 2))};
}

}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  using namespace palpate::fuzz;
  std::string bytes(text_of(data, size));
  seal(bytes);
  const auto tool = tool_from_bytes(bytes);
  if (!tool) return 0;
  const auto written = tool_to_bytes(*tool);
  require(written.has_value(), "a tool that was read can be written");
  const auto again = tool_from_bytes(*written);
  require(again.has_value(), "a tool that was written can be read");
  require(*tool_to_bytes(*again) == *written, "a tool comes back with the same bytes");
  return 0;
}
