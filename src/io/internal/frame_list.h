// Frames in a folder, with their times: by a list, or in name order.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "palpate/core/core.h"
#include "palpate/io/formats.h"

namespace palpate { inline namespace v0 {

struct FrameEntry {
  double time = 0;   ///< s
  std::string path;  ///< millions of fs::path would take seconds
};

struct FrameList {
  std::vector<FrameEntry> entries;  ///< by time, at least one
  double rate = 0;                  ///< Hz, that of the list's times
};

/// True for the name of a PCD or PLY file.
bool is_cloud_name(const std::string& path);

/// Frames by a file depth.txt of "timestamp path" lines, as the TUM RGB-D benchmark has them, or
/// all PNGs of the folder, else of its subfolder "depth", else all PCD and PLY files of the folder,
/// in name order ("frame2" before "frame10") at `rate`, without hidden ones. Errors: no such
/// folder, no frames, a bad list.
Result<FrameList> list_frames(const std::filesystem::path& folder, double rate);
/// open_depth_folder, of the PNGs of a list of that folder.
Result<std::unique_ptr<DepthSource>> open_depth_folder(const std::filesystem::path& folder,
                                                       const FrameList& list,
                                                       const DepthFolderOptions& options);

}}  // namespace palpate::v0
