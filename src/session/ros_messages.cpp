#include "src/session/ros_messages.h"

#include <array>
#include <vector>

#include "src/io/cdr.h"

namespace palpate {
namespace {

struct Definition {
  std::string_view type, text;
};
constexpr Definition kDefinitions[] = {
    {"builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"},
    {"builtin_interfaces/Duration", "int32 sec\nuint32 nanosec\n"},
    {"std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"},
    {"std_msgs/ColorRGBA", "float32 r\nfloat32 g\nfloat32 b\nfloat32 a\n"},
    {"geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"},
    {"geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"},
    {"geometry_msgs/Quaternion", "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n"},
    {"geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"},
    {"geometry_msgs/Twist", "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n"},
    {"geometry_msgs/Wrench", "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n"},
    {"geometry_msgs/WrenchStamped", "std_msgs/Header header\ngeometry_msgs/Wrench wrench\n"},
    {"geometry_msgs/Transform",
     "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"},
    {"geometry_msgs/TransformStamped",
     "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"},
    {"tf2_msgs/TFMessage", "geometry_msgs/TransformStamped[] transforms\n"},
    {"sensor_msgs/Image",
     "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\n"
     "uint32 step\nuint8[] data\n"},
    {"sensor_msgs/RegionOfInterest",
     "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n"},
    {"sensor_msgs/CameraInfo",
     "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\n"
     "float64[9] k\nfloat64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\n"
     "sensor_msgs/RegionOfInterest roi\n"},
    {"sensor_msgs/PointField", "string name\nuint32 offset\nuint8 datatype\nuint32 count\n"},
    {"sensor_msgs/PointCloud2",
     "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\n"
     "bool is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n"},
    {"sensor_msgs/CompressedImage", "std_msgs/Header header\nstring format\nuint8[] data\n"},
    {"visualization_msgs/UVCoordinate", "float32 u\nfloat32 v\n"},
    {"visualization_msgs/MeshFile", "string filename\nuint8[] data\n"},
    {"visualization_msgs/Marker",
     "std_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\n"
     "geometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\n"
     "builtin_interfaces/Duration lifetime\nbool frame_locked\ngeometry_msgs/Point[] points\n"
     "std_msgs/ColorRGBA[] colors\nstring texture_resource\nsensor_msgs/CompressedImage texture\n"
     "visualization_msgs/UVCoordinate[] uv_coordinates\nstring text\nstring mesh_resource\n"
     "visualization_msgs/MeshFile mesh_file\nbool mesh_use_embedded_materials\n"},
};

std::string_view ros_definition(std::string_view type) {
  for (const auto& [name, text] : kDefinitions) {
    if (name == type) return text;
  }
  return {};
}

void put(CdrWriter& to, std::uint64_t time) {
  constexpr std::uint64_t kSecond = 1'000'000'000;
  to.number(static_cast<std::int32_t>(time / kSecond));
  to.number(static_cast<std::uint32_t>(time % kSecond));
}
void put(CdrWriter& to, const RosHeader& header) {
  put(to, header.time);
  to.text(header.frame);
}
void put(CdrWriter& to, const Vec3d& v) {
  for (int axis = 0; axis < 3; ++axis) to.number(v[axis]);
}
void put(CdrWriter& to, const Pose& X) {
  put(to, X.translation);
  for (const double value : {X.rotation.x, X.rotation.y, X.rotation.z, X.rotation.w}) {
    to.number(value);
  }
}

}  // namespace

std::string message_schema(const std::string& type,
                           const std::function<std::string(const std::string&)>& more) {
  std::vector<std::string> types{type};
  std::string all;
  for (std::size_t i = 0; i < types.size(); ++i) {
    std::string text(ros_definition(types[i]));
    if (text.empty()) text = more(types[i]);
    for (std::size_t at = 0; at < text.size(); at = text.find('\n', at) + 1) {
      const std::string field = text.substr(at, text.find_first_of(" [", at) - at);
      if (field.find('/') == std::string::npos) continue;
      if (std::find(types.begin(), types.end(), field) == types.end()) types.push_back(field);
    }
    if (i > 0) all += std::string(80, '=') + "\nMSG: " + types[i] + "\n";
    all += text;
  }
  return all;
}

std::string image_message(const RosHeader& header, const DepthFrame& frame) {
  CdrWriter to;
  put(to, header);
  to.number(static_cast<std::uint32_t>(frame.height));
  to.number(static_cast<std::uint32_t>(frame.width));
  to.text("16UC1");
  to.number(std::uint8_t{0});
  to.number(static_cast<std::uint32_t>(2 * frame.width));
  to.bytes(frame.pixels.data(), 2 * frame.pixels.size());
  return to.take();
}

std::string camera_info_message(const RosHeader& header, const DepthStreamInfo& stream) {
  const auto& [fx, fy, cx, cy] = stream.intrinsics;
  CdrWriter to;
  put(to, header);
  to.number(static_cast<std::uint32_t>(stream.height));
  to.number(static_cast<std::uint32_t>(stream.width));
  to.text("plumb_bob");
  to.number(std::uint32_t{5});
  for (int i = 0; i < 5; ++i) to.number(0.0);
  for (const double k : {fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0}) to.number(k);
  for (const double r : {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}) to.number(r);
  for (const double p : {fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0}) to.number(p);
  for (int i = 0; i < 6; ++i) to.number(std::uint32_t{0});
  to.number(false);
  return to.take();
}

std::string points_message(const RosHeader& header, const DepthFrame& frame,
                           const Intrinsics& intrinsics) {
  constexpr std::uint8_t kFloat32 = 7;
  const auto [fx, fy, cx, cy] = intrinsics;
  int step = 1;
  while (((frame.width + step - 1) / step) * ((frame.height + step - 1) / step) >
         kMostRecordedPoints) {
    ++step;
  }
  std::vector<Vec3f> points;
  for (int v = 0; v < frame.height; v += step) {
    for (int u = 0; u < frame.width; u += step) {
      const int count = frame.pixels[static_cast<std::size_t>(v * frame.width + u)];
      if (count == 0 || count == 65535) continue;
      const double z = count * frame.unit;
      points.push_back(to_float(Vec3d{(u - cx) / fx * z, (v - cy) / fy * z, z}));
    }
  }
  const auto num_points = static_cast<std::uint32_t>(points.size());
  CdrWriter to;
  put(to, header);
  to.number(std::uint32_t{1});
  to.number(num_points);
  to.number(std::uint32_t{3});
  for (std::uint32_t axis = 0; axis < 3; ++axis) {
    to.text(std::string_view("xyz").substr(axis, 1));
    to.number(static_cast<std::uint32_t>(axis * sizeof(float)));
    to.number(kFloat32);
    to.number(std::uint32_t{1});
  }
  to.number(false);
  to.number(static_cast<std::uint32_t>(sizeof(Vec3f)));
  to.number(static_cast<std::uint32_t>(num_points * sizeof(Vec3f)));
  to.bytes(points.data(), num_points * sizeof(Vec3f));
  to.number(true);
  return to.take();
}

std::string transform_message(std::uint64_t time, std::span<const RosTransform> transforms) {
  CdrWriter to;
  to.number(static_cast<std::uint32_t>(transforms.size()));
  for (const auto& [parent, child, X_PC] : transforms) {
    put(to, RosHeader{time, parent});
    to.text(child);
    put(to, X_PC);
  }
  return to.take();
}

std::string wrench_message(const RosHeader& header, const Wrench& wrench) {
  CdrWriter to;
  put(to, header);
  put(to, wrench.force);
  put(to, wrench.torque);
  return to.take();
}

std::string tool_marker_message(const RosHeader& header, const TriangleMesh& mesh) {
  constexpr std::size_t kMostTriangles = 20000;
  constexpr std::int32_t kTriangleList = 11, kAdd = 0;
  const std::size_t step = (mesh.triangles.size() + kMostTriangles - 1) / kMostTriangles;
  CdrWriter to;
  put(to, header);
  to.text("tool");
  for (const std::int32_t number : {0, kTriangleList, kAdd}) to.number(number);
  put(to, Pose{});
  put(to, Vec3d{1, 1, 1});
  for (const float color : {0.35f, 0.6f, 0.85f, 1.0f}) to.number(color);
  put(to, std::uint64_t{0});  // for ever
  to.number(true);            // in its frame, wherever that goes
  std::vector<std::size_t> shown;
  for (std::size_t i = 0; i < mesh.triangles.size(); i += step) shown.push_back(i);
  to.number(static_cast<std::uint32_t>(3 * shown.size()));
  for (const std::size_t i : shown) {
    for (const auto corner : mesh.triangles[i]) {
      put(to, mesh.vertices[static_cast<std::size_t>(corner)]);
    }
  }
  to.number(std::uint32_t{0});  // colors
  to.text("");
  put(to, RosHeader{});  // texture
  to.text("");
  to.number(std::uint32_t{0});
  to.number(std::uint32_t{0});  // coordinates on it
  to.text("");
  to.text("");
  to.text("");  // mesh file
  to.number(std::uint32_t{0});
  to.number(false);
  return to.take();
}

}  // namespace palpate
