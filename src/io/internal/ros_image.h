// Depth images and point clouds as ROS sends them.
#pragma once

#include <string_view>
#include <vector>

#include "palpate/cloud/depth_source.h"

namespace palpate { inline namespace v0 {

class CdrReader;
struct CloudPoints;

/// sensor_msgs/Image, 16UC1 (mm) or 32FC1 (numbers of `scale` meters, in counts of `unit`).
/// DepthFrame::timestamp is the header's. Errors: another encoding, a damaged message.
Result<DepthFrame> read_depth_image(std::string_view message, double unit, double scale = 1);
/// Reads sensor_msgs/PointCloud2: x, y, z, and normal_x, normal_y, normal_z where it has all three,
/// wherever they lie in a point, of any number type, in either byte order; `scale`: meters per
/// number; `eye`: m, subtracted in double. Nothing is allocated before all sizes are checked
/// against the message; the memory of `points` is used again. Errors: damaged, no points, more than
/// kMaxCloudPoints, a coordinate that is missing, there twice, or outside of its point.
Status read_point_cloud(std::string_view message, double scale, const Vec3d& eye,
                        CloudPoints& points);
/// As flow_message writes it: DepthFrame::flow. Error: damaged.
Result<std::vector<float>> read_flow_image(std::string_view message);

/// std_msgs/Header.
struct RosStamp {
  double time = 0;         ///< s
  std::string_view frame;  ///< of coordinates
};
RosStamp read_ros_header(CdrReader& from);

/// Reads counts that are compressed by runs of zeros and differences (Wilson, Fast Lossless Depth
/// Image Compression, ISS 2017), as ROS's compressedDepth sends them.
///
/// Width and height, uint32 little-endian; then 32-bit little-endian words of eight nibbles each,
/// the highest first. A nibble holds three bits of a number, the lowest first, and whether more
/// follow. Numbers are, in turn: how many zeros, how many others, and of each other one its
/// difference to the one before, with the sign in the lowest bit. Errors: damaged; memory is
/// bounded by the limits of images. `what`: whose image it is, for errors. DepthFrame::timestamp is
/// 0.
Result<DepthFrame> decode_depth_rvl(std::string_view data, std::string_view what, double unit);

}}  // namespace palpate::v0
