#include "tests/test_util/data.h"

#include <cstdlib>

namespace palpate::test {

std::optional<std::filesystem::path> data_folder() {
  const char* from_environment = std::getenv("PALPATE_DATA");
  const std::filesystem::path folder =
      from_environment != nullptr ? std::filesystem::path(from_environment)
                                  : std::filesystem::path(PALPATE_SOURCE_DIR) / "../shared/data";
  if (!std::filesystem::is_directory(folder)) return std::nullopt;
  return std::filesystem::weakly_canonical(folder);
}

}  // namespace palpate::test
