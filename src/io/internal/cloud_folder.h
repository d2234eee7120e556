// Folders of point clouds as streams of depth images.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "palpate/cloud/depth_source.h"
#include "src/cloud/internal/cloud_camera.h"
#include "src/io/internal/frame_list.h"

namespace palpate { inline namespace v0 {

/// Points of a file, and where their sensor stood.
struct PointsFile {
  CloudPoints cloud;
  Vec3d eye;  ///< m; VIEWPOINT of a PCD; else the origin
};
/// Reads a PLY or PCD with or without normals; a PCD with HEIGHT > 1 stays organized. `scale`:
/// meters per number; points become relative to `eye`, m. Errors: as of load_cloud, more than
/// kMaxCloudPoints.
Result<PointsFile> load_points(const std::filesystem::path& path, double scale = 1,
                               const Vec3d& eye = {});

struct CloudFolder {
  std::unique_ptr<DepthSource> images;
  std::optional<Pose> X_FC;  ///< of their camera in the frame of the points, if they are projected
};
/// Depth images of the PCD and PLY files of a list, in its order, by the camera of the first one.
/// Seen from its VIEWPOINT unless the options say from where. `scale`: meters per number. Reads
/// other files on demand. Errors: of the first file.
Result<CloudFolder> open_cloud_folder(const FrameList& list, const CloudCameraOptions& options,
                                      double scale, const std::string& name);

}}  // namespace palpate::v0
