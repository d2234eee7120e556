// Parts of every fuzz target: an entry, seeds, and promises that end the program when they do not
// hold.
#pragma once

#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

/// Reads `size` bytes as a stranger would send them. Always 0; ends the program on a fault.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace palpate::fuzz {

/// Good inputs to start from, made by our own writers: defined by every target.
std::vector<std::string> seeds();

/// `promise` is what does not hold, as a sentence.
inline void require(bool holds, const char* promise) {
  if (holds) return;
  std::fprintf(stderr, "fuzz: a promise is broken: %s\n", promise);
  std::abort();
}

inline std::string_view text_of(const std::uint8_t* data, std::size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

/// A file in memory where the system has such, with one name for as long as it exists.
class ScratchFile {
 public:
  explicit ScratchFile(const std::string& extension) {
    std::error_code ignored;
    const std::filesystem::path memory = "/dev/shm";
    const bool has_memory = std::filesystem::is_directory(memory, ignored);
    path_ = (has_memory ? memory : std::filesystem::temp_directory_path()) /
            ("palpate-fuzz-" + std::to_string(::getpid()) + extension);
  }
  ~ScratchFile() {
    std::error_code ignored;
    std::filesystem::remove(path_, ignored);
  }
  ScratchFile(const ScratchFile&) = delete;
  ScratchFile& operator=(const ScratchFile&) = delete;

  const std::filesystem::path& write(std::string_view bytes) {
    std::FILE* const file = std::fopen(path_.c_str(), "wb");
    require(file != nullptr, "the scratch file can be written");
    std::fwrite(bytes.data(), 1, bytes.size(), file);
    std::fclose(file);
    return path_;
  }
  std::string read() const {
    std::string bytes;
    if (std::FILE* const file = std::fopen(path_.c_str(), "rb")) {
      char part[4096];
      for (std::size_t n; (n = std::fread(part, 1, sizeof part, file)) > 0;) bytes.append(part, n);
      std::fclose(file);
    }
    return bytes;
  }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace palpate::fuzz
