// Files that are either whole or absent.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// Writes a file without a name in the same folder, flushes it to disk and gives it the name
/// `path`: a program that ends meanwhile, by Ctrl-C too, leaves the earlier file there. (Some
/// network file systems have no files without a name: there, .palpate.PID.N.part may be left.) A
/// symbolic link is followed; a file that is replaced keeps its permissions; anything but a regular
/// file in the way is an error.
Status write_file_atomically(const std::filesystem::path& path, std::string_view content);

/// Checks that a file can be read to its end; opening a pipe waits for its writer. Errors:
/// absent, a folder, a pipe, a device.
Status check_regular_file(const std::filesystem::path& path);

/// Whole file as bytes. Error: absent, a directory, larger than `max_bytes`.
Result<std::string> read_file(const std::filesystem::path& path,
                              std::size_t max_bytes = std::size_t(4) << 30);

}}  // namespace palpate::v0
