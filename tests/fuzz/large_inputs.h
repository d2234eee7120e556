// Inputs of any size for every reader: ordinary ones, and those that cost a careless reader most.
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "palpate/core/core.h"

namespace palpate::fuzz {

struct LargeInput {
  std::string reader, what;      ///< e.g. "OBJ", "triangles"
  std::optional<bool> is_taken;  ///< false: the reader refuses it; none: it depends on the size
  /// Makes a file, or a folder, of about so many bytes.
  std::function<void(const std::filesystem::path&, std::size_t)> make;
  /// Reads it as the program does.
  std::function<Status(const std::filesystem::path&)> read;
  std::string extension = ".bin";
  double max_seconds =
      10;  ///< for 100 MB; more where another's library or what is unpacked takes it
};

std::vector<LargeInput> large_meshes();
std::vector<LargeInput> large_images();      ///< depth images and clouds
std::vector<LargeInput> large_texts();       ///< paths, lists, joints, robots, settings
std::vector<LargeInput> large_recordings();  ///< MCAP, bags of ROS 1 and SQLite
std::vector<LargeInput> large_streams();     ///< what devices and pages send

/// Writes text, piece by piece, until it is so long; each(i) is the i-th piece.
void write_pieces(const std::filesystem::path& path, std::size_t num_bytes, const std::string& head,
                  const std::function<std::string(std::size_t)>& each,
                  const std::string& tail = "");
/// The whole file.
std::string file_bytes(const std::filesystem::path& path);

/// All images of a camera.
Status read_camera(const std::string& uri);

/// For readers whose answer does not matter here.
template <class T>
Status status_of(const Result<T>& result) {
  if (result) return Done{};
  return result.error();
}

}  // namespace palpate::fuzz
