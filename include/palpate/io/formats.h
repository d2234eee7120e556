// Readers and writers of meshes, depth images and clouds in common formats.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/cloud/point_cloud.h"
#include "palpate/core/core.h"
#include "palpate/mesh/mesh.h"

namespace palpate { inline namespace v0 {

// Mesh files.

/// Reads OBJ, STL, PLY, OFF, glTF or GLB; all parts become one mesh; polygons are triangulated;
/// coordinates are multiplied by `scale` (e.g. 0.001 for a file in millimeters). Does not check the
/// mesh: see check_solid. Errors: no such file, not a mesh, truncated, indices out of range.
Result<TriangleMesh> load_mesh(const std::filesystem::path& path, double scale = 1.0);

/// Writes .ply (binary), .stl (binary) or .obj, by extension. Never leaves half a file.
Status save_mesh(const TriangleMesh& mesh, const std::filesystem::path& path);

/// A mesh in one color, for display.
struct ColoredMesh {
  std::string name;
  std::array<std::uint8_t, 3> rgb{};  ///< sRGB
  TriangleMesh mesh;
};

/// Writes .ply (binary; all parts in one mesh, each vertex with its color) or .glb (each part a
/// node and a material of its name; single precision), by extension. Coordinates are written
/// unchanged, in meters: programs with y up, like glTF, show them so. Parts without faces are
/// omitted. Error: no part has any. Never leaves half a file.
Status save_colored_meshes(std::span<const ColoredMesh> parts, const std::filesystem::path& path);

// Files of depth frames and clouds.

/// Reads a 16-bit grayscale PNG; 0: no measurement. Errors: another format, over kMaxImage*.
Result<DepthFrame> load_depth_png(const std::filesystem::path& path, double unit = 0.001);
/// Never leaves half a file.
Status save_depth_png(const DepthFrame& frame, const std::filesystem::path& path);
/// The same in memory; `name` identifies the image in messages.
Result<DepthFrame> decode_depth_png(std::string_view content, const std::string& name,
                                    double unit = 0.001);
Result<std::string> encode_depth_png(const DepthFrame& frame, const std::string& name);

/// A label per pixel. The caller defines the meaning of the numbers.
struct LabelImage {
  int width = 0, height = 0;
  std::vector<std::uint8_t> labels;  ///< row-major, width * height
};
/// Reads a PNG of 8 bits per pixel, grayscale or palette (the indices are the labels). Errors:
/// another format, larger than kMaxImage*.
Result<LabelImage> load_label_png(const std::filesystem::path& path);

/// Properties of the images in a folder that their files do not contain.
struct DepthFolderOptions {
  Intrinsics intrinsics;
  double unit = 0.001;  ///< meters per count
  double rate = 30;     ///< frames per second, if the folder has no timestamps
  /// Folder of optical flow, DepthFrame::flow: NAME.flo (Middlebury's format) for NAME.png; frames
  /// without a file have none. Empty: there is none.
  std::filesystem::path flow = {};
};

/// A folder of 16-bit PNGs: TUM layout (a file depth.txt of "timestamp path" lines) or plain (all
/// *.png of the folder, or of its subfolder "depth", in name order, at `rate`). Reads only the list
/// now, and frames on demand. Errors: no such folder, no frames, sizes of the first 10,000 differ.
Result<std::unique_ptr<DepthSource>> open_depth_folder(const std::filesystem::path& folder,
                                                       const DepthFolderOptions& options);

/// A cloud that was read from a file.
struct CloudFile {
  PointCloud cloud;
  std::string note;  ///< remark on normals that were turned; empty: none
};
/// Reads a cloud with normals from a PLY (ascii or binary; properties x y z nx ny nz) or PCD
/// (ascii, binary, binary_compressed; fields x y z normal_x normal_y normal_z). A PCD with height >
/// 1 stays organized. Normals are turned toward the viewpoint: the VIEWPOINT of a PCD, which moves
/// no points, else the origin. Errors: no normals; truncated files; counts that the file cannot
/// hold (checked before allocating).
Result<CloudFile> load_cloud(const std::filesystem::path& path);

/// Depth image of an organized PCD without normals: z as 16-bit counts of `unit` (m).
Result<DepthFrame> load_depth_pcd(const std::filesystem::path& path, double unit = 0.001);

/// Writes all valid points as binary PLY with x y z nx ny nz. Never leaves half a file.
Status save_cloud_ply(const PointCloudView& cloud, const std::filesystem::path& path);

}}  // namespace palpate::v0
