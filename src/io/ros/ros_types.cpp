#include "src/io/internal/ros_types.h"

#include <algorithm>
#include <charconv>
#include <map>
#include <utility>

#include "src/io/internal/hashes.h"

namespace palpate { inline namespace v0 {
namespace {

struct Definition {
  std::string_view type, text;
};
constexpr Definition kDefinitions[] = {
    {"builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"},
    {"builtin_interfaces/Duration", "int32 sec\nuint32 nanosec\n"},
    {"std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"},
    {"std_msgs/String", "string data\n"},
    {"std_msgs/Float32", "float32 data\n"},
    {"std_msgs/Float64", "float64 data\n"},
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
    {"visualization_msgs/MarkerArray", "visualization_msgs/Marker[] markers\n"},
    {"geometry_msgs/PoseStamped", "std_msgs/Header header\ngeometry_msgs/Pose pose\n"},
    {"geometry_msgs/TwistStamped", "std_msgs/Header header\ngeometry_msgs/Twist twist\n"},
    {"sensor_msgs/JointState",
     "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
     "float64[] effort\n"},
    {"diagnostic_msgs/KeyValue", "string key\nstring value\n"},
    {"diagnostic_msgs/DiagnosticStatus",
     "byte level\nstring name\nstring message\nstring hardware_id\n"
     "diagnostic_msgs/KeyValue[] values\n"},
    {"diagnostic_msgs/DiagnosticArray",
     "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status\n"},
    // As from ROS 2 Iron on; before, identifiers had 24 bytes.
    {"rmw_dds_common/Gid", "char[16] data\n"},
    {"rmw_dds_common/NodeEntitiesInfo",
     "string<=256 node_namespace\nstring<=256 node_name\nrmw_dds_common/Gid[] reader_gid_seq\n"
     "rmw_dds_common/Gid[] writer_gid_seq\n"},
    {"rmw_dds_common/ParticipantEntitiesInfo",
     "rmw_dds_common/Gid gid\nrmw_dds_common/NodeEntitiesInfo[] node_entities_info_seq\n"},
    {"palpate_msgs/Contact",
     "std_msgs/Header header\nuint8 state\nstring reason\nfloat64 volume\nfloat64 fraction\n"
     "float64 unseen\nfloat64 potential\nfloat64 max_stiffness\ngeometry_msgs/Wrench wrench\n"
     "float64[36] stiffness\nfloat64 depth_age\nfloat64 contact_age\nuint32 status\n"
     "float64 volume_std\ngeometry_msgs/Vector3 force_std\ngeometry_msgs/Vector3 torque_std\n"},
    {"palpate_msgs/Guard",
     "std_msgs/Header header\nuint8 state\nstring reason\nstring assumes\nfloat64 clearance\n"
     "string link\nfloat64 unseen\nfloat64 scale\nfloat64 depth_age\nbool held\n"
     "string[] joints\nstring[] links\nfloat64[] clearances\nfloat64[] rows\nfloat64[] bounds\n"},
};

std::string_view ros_definition(std::string_view type) {
  for (const auto& [name, text] : kDefinitions) {
    if (name == type) return text;
  }
  return {};
}

constexpr std::pair<std::string_view, RosBase> kBases[] = {
    {"int8", RosBase::int8},       {"uint8", RosBase::uint8},    {"int16", RosBase::int16},
    {"uint16", RosBase::uint16},   {"int32", RosBase::int32},    {"uint32", RosBase::uint32},
    {"int64", RosBase::int64},     {"uint64", RosBase::uint64},  {"float32", RosBase::float32},
    {"float64", RosBase::float64}, {"char", RosBase::character}, {"bool", RosBase::boolean},
    {"byte", RosBase::byte},       {"string", RosBase::text},
};

std::uint32_t number_of(std::string_view text) {
  std::uint32_t number = 0;
  std::from_chars(text.data(), text.data() + text.size(), number);
  return number;
}

/// "geometry_msgs/Point[] points" or "float64[9] k"; what follows the name is a default.
RosField field_of(std::string_view line) {
  RosField field;
  const std::size_t end = line.find(' ');
  std::string_view type = line.substr(0, end);
  field.name = std::string(line.substr(end + 1, line.find(' ', end + 1) - end - 1));
  if (const std::size_t at = type.find('['); at != std::string_view::npos) {
    field.count = number_of(type.substr(at + 1));
    field.shape = field.count > 0 ? RosField::Shape::array : RosField::Shape::sequence;
    type = type.substr(0, at);
  }
  if (const std::size_t at = type.find("<="); at != std::string_view::npos) {
    field.max_text = number_of(type.substr(at + 2));
    type = type.substr(0, at);
  }
  const auto base = std::ranges::find(kBases, type, &std::pair<std::string_view, RosBase>::first);
  if (base != std::end(kBases)) {
    field.base = base->second;
  } else {
    field.type = std::string(type);
  }
  return field;
}

/// FieldType: bounded texts are four, arrays 48 and sequences 144 above.
int type_number(const RosField& field) {
  const int base = static_cast<int>(field.base) + (field.max_text > 0 ? 4 : 0);
  if (field.shape == RosField::Shape::array) return base + 48;
  return field.shape == RosField::Shape::sequence ? base + 144 : base;
}

/// The JSON of one type whose SHA-256 the hash is: of fields, without defaults and constants.
std::string description_of(const std::string& type) {
  std::string fields;
  for (const RosField& field : ros_fields(type)) {
    fields +=
        (fields.empty() ? "" : ", ") +
        ("{\"name\": \"" + field.name + "\", \"type\": {\"type_id\": " +
         std::to_string(type_number(field)) + ", \"capacity\": " + std::to_string(field.count) +
         ", \"string_capacity\": " + std::to_string(field.max_text) + ", \"nested_type_name\": \"" +
         (field.type.empty() ? "" : ros_interface_name(field.type)) + "\"}}");
  }
  return "{\"type_name\": \"" + ros_interface_name(type) + "\", \"fields\": [" + fields + "]}";
}

/// The type and all types in it, each once.
std::vector<std::string> with_nested(const std::string& type) {
  std::vector<std::string> types{type};
  for (std::size_t i = 0; i < types.size(); ++i) {
    for (const RosField& field : ros_fields(types[i])) {
      if (field.type.empty() || std::ranges::find(types, field.type) != types.end()) continue;
      types.push_back(field.type);
    }
  }
  return types;
}

}  // namespace

const std::vector<RosField>& ros_fields(std::string_view type) {
  // Taken apart once: messages look up each of their elements.
  static const auto& all = *new std::map<std::string_view, std::vector<RosField>>([] {
    std::map<std::string_view, std::vector<RosField>> fields;
    for (auto [name, text] : kDefinitions) {
      while (!text.empty()) {
        const std::size_t end = text.find('\n');
        fields[name].push_back(field_of(text.substr(0, end)));
        text.remove_prefix(end + 1);
      }
    }
    return fields;
  }());
  static const std::vector<RosField> kNone;
  const auto found = all.find(type);
  return found == all.end() ? kNone : found->second;
}

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

std::string ros_type_hash(const std::string& type) {
  std::vector<std::string> types = with_nested(type);
  std::sort(types.begin() + 1, types.end(), [](const std::string& a, const std::string& b) {
    return ros_interface_name(a) < ros_interface_name(b);
  });
  std::string nested;
  for (std::size_t i = 1; i < types.size(); ++i) {
    nested += (nested.empty() ? "" : ", ") + description_of(types[i]);
  }
  return "RIHS01_" + sha256("{\"type_description\": " + description_of(type) +
                            ", \"referenced_type_descriptions\": [" + nested + "]}");
}

std::string ros_interface_name(std::string_view type) {
  const std::size_t slash = type.find('/');
  return std::string(type.substr(0, slash)) + "/msg" + std::string(type.substr(slash));
}

std::string dds_type_name(std::string_view type) {
  const std::size_t slash = type.find('/');
  return std::string(type.substr(0, slash)) +
         "::msg::dds_::" + std::string(type.substr(slash + 1)) + "_";
}

}}  // namespace palpate::v0
