// Files of meshes, depth images and clouds, in the formats of others.
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

namespace palpate::inline v0 {

// Meshes on disk.

/// Reads OBJ, STL, PLY, OFF, glTF or GLB; all parts become one mesh; polygons are triangulated;
/// coordinates are multiplied by `scale` (e.g. 0.001 for a file in millimetres). The mesh is not
/// checked: see check_solid. Errors: no such file, not a mesh, truncated, indices out of range.
Result<TriangleMesh> load_mesh(const std::filesystem::path& path, double scale = 1.0);

/// Writes by extension: .ply (binary) or .stl (binary) or .obj. Never leaves half a file.
Status save_mesh(const TriangleMesh& mesh, const std::filesystem::path& path);

/// A mesh in one colour, for pictures.
struct ColouredMesh {
  std::string name;
  std::array<std::uint8_t, 3> rgb{};  ///< sRGB
  TriangleMesh mesh;
};

/// Writes by extension: .ply (binary; all parts in one mesh, each vertex with its colour) or .glb
/// (each part a node and a material of its name; single precision). Coordinates as they are, in
/// metres: programs that take y for up, as glTF does, show them so. Parts without faces are left
/// out. Error: no part has any. Never leaves half a file.
Status save_coloured_meshes(std::span<const ColouredMesh> parts, const std::filesystem::path& path);

// Depth frames and clouds on disk.

/// A 16-bit greyscale PNG; 0 = no measurement. Errors: not such a PNG, larger than kMaxImage*.
Result<DepthFrame> load_depth_png(const std::filesystem::path& path, double unit = 0.001);
/// Never leaves half a file.
Status save_depth_png(const DepthFrame& frame, const std::filesystem::path& path);
/// The same in memory; `name` is what errors call the image.
Result<DepthFrame> decode_depth_png(std::string_view content, const std::string& name,
                                    double unit = 0.001);
Result<std::string> encode_depth_png(const DepthFrame& frame, const std::string& name);

/// A label for each pixel: what is seen there, by numbers of the caller's.
struct LabelImage {
  int width = 0, height = 0;
  std::vector<std::uint8_t> labels;  ///< row-major, width * height
};
/// A PNG of 8 bits a pixel, greyscale or with a palette, whose indices count. Errors: not such a
/// PNG, larger than kMaxImage*.
Result<LabelImage> load_label_png(const std::filesystem::path& path);

struct DepthFolderOptions {
  Intrinsics intrinsics;
  double unit = 0.001;  ///< metres per count
  double rate = 30;     ///< frames per second, where the folder holds no time stamps
};

/// A folder of 16-bit PNGs: TUM layout (a file depth.txt of "timestamp path" lines) or plain (all
/// *.png of the folder, or of its subfolder "depth", in name order, at `rate`). Only the list is
/// read now; frames are read when asked for. Errors: no such folder, no frames, sizes differ.
Result<std::unique_ptr<DepthSource>> open_depth_folder(const std::filesystem::path& folder,
                                                       const DepthFolderOptions& options);

/// A cloud with normals from a PLY (ascii or binary; properties x y z nx ny nz) or PCD (ascii,
/// binary, binary_compressed; fields x y z normal_x normal_y normal_z). A PCD with height > 1 stays
/// organised. Clouds without normals: Error that says so. Errors also for truncated files and
/// counts that the file cannot hold (checked before allocating).
Result<PointCloud> load_cloud(const std::filesystem::path& path);

/// Depth image of an organised PCD without normals: z as 16-bit counts of `unit`.
Result<DepthFrame> load_depth_pcd(const std::filesystem::path& path, double unit = 0.001);

/// Binary PLY with x y z nx ny nz of all valid points. Never leaves half a file.
Status save_cloud_ply(const PointCloudView& cloud, const std::filesystem::path& path);

}  // namespace palpate::inline v0
