#include "src/viewer/protocol/messages.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <type_traits>
#include <utility>
#include "palpate/version.h"
#include "src/math/internal/farthest.h"

namespace palpate { inline namespace v0 {
namespace {

using Json = nlohmann::json;

static_assert(std::endian::native == std::endian::little, "messages are little-endian");

enum class Kind : std::uint16_t {
  spheres = 1,
  graph = 2,
  mesh = 3,
  tree = 4,
  objects = 5,
  frame = 10,
  contact = 11,
  normals = 12,
  edges = 13,
  samples = 20,
};

/// Appends values as they lie in memory.
class Writer {
 public:
  /// `size`: of all data after the header, as far as it is known.
  Writer(Kind kind, std::uint64_t number, double time, std::size_t size) {
    bytes_.reserve(16 + size);
    put(kind, std::uint16_t{kViewProtocol}, static_cast<std::uint32_t>(number), time);
  }

  template <class... Values>
  void put(const Values&... values) {
    (put_bytes(&values, 1), ...);
  }
  template <class Value>
  void put_all(std::span<const Value> values) {
    put_bytes(values.data(), values.size());
  }
  void put(const Vec3f& v) { put(v.x, v.y, v.z); }
  void put(const Sphere& s) { put(s.center.x, s.center.y, s.center.z, s.radius); }
  void put(const Pose& X) {
    const Vec3d& p = X.translation;
    const Quaternion& q = X.rotation;
    put(p.x, p.y, p.z, q.x, q.y, q.z, q.w);
  }
  void put(const TriangleMesh& mesh) {
    put_count(mesh.vertices.size());
    put_count(mesh.triangles.size());
    for (const Vec3d& vertex : mesh.vertices) put(to_float(vertex));
    for (const auto& triangle : mesh.triangles) put_all(std::span<const std::uint32_t>(triangle));
  }
  void put_count(std::size_t count) { put(static_cast<std::uint32_t>(count)); }
  /// Zeros up to a multiple of four.
  void pad() { bytes_.resize((bytes_.size() + 3) / 4 * 4, '\0'); }
  std::string take() { return std::move(bytes_); }

 private:
  template <class Value>
  void put_bytes(const Value* values, std::size_t count) {
    static_assert(std::is_arithmetic_v<Value> || std::is_enum_v<Value>);
    if (count > 0) bytes_.append(reinterpret_cast<const char*>(values), count * sizeof(Value));
  }

  std::string bytes_;
};

std::size_t num_pixels(const ViewSurface& surface) {
  return static_cast<std::size_t>(surface.width) * static_cast<std::size_t>(surface.height);
}

/// Maps -1 to 1 to -127 to 127; NaN and infinity to 0.
std::int8_t to_byte(float value) {
  return std::isfinite(value)
             ? static_cast<std::int8_t>(std::lround(127 * std::clamp(value, -1.f, 1.f)))
             : std::int8_t{0};
}

/// True if a plane cuts a sphere: one that no point touches may have a plane beside it.
bool cuts(const Plane<float>& plane, const Sphere& sphere) {
  const bool has_plane = !(plane.normal == Vec3f{});
  return has_plane && std::abs(dot(plane.normal, sphere.center) - plane.offset) < sphere.radius;
}

// Columns of a sample.

constexpr std::size_t kNumColumns = 41;

std::array<float, kNumColumns> row_of(const ViewSample& s, double first_time) {
  std::array<double, kNumColumns> row;
  auto next = row.begin();
  const auto put = [&](auto... values) { ((*next++ = values), ...); };
  const auto put_vector = [&](const Vec3d& v) { put(v.x, v.y, v.z); };
  const auto put_pose = [&](const Pose& X) {
    put_vector(X.translation);
    put(X.rotation.x, X.rotation.y, X.rotation.z, X.rotation.w);
  };
  put(s.time - first_time);
  put_vector(s.F_H_B.force);
  put_vector(s.F_H_B.torque);
  put_vector(s.contact_W.force);
  put_vector(s.contact_W.torque);
  put(s.volume, 1e6 * s.compute_seconds, s.contact_age, s.sensor_age, s.stretch, s.gain, s.energy);
  put_pose(s.X_WT);
  put_pose(s.X_WT_hand);
  for (const double each : s.force_covariance) put(each);
  put(s.objects_volume);
  std::array<float, kNumColumns> rounded;
  std::transform(row.begin(), row.end(), rounded.begin(),
                 [](double value) { return static_cast<float>(value); });
  return rounded;
}

// Text.

/// Returns JSON as text; names of files may be in any encoding.
std::string dump(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Json parse_object(std::string_view text) {
  Json json = Json::parse(text, nullptr, false);
  return json.is_object() ? json : Json::object();
}

Json to_json(const Vec3d& v) { return {v.x, v.y, v.z}; }

Json to_json(const DepthStreamInfo& s) {
  return {{"name", s.name},        {"width", s.width},      {"height", s.height},
          {"fx", s.intrinsics.fx}, {"fy", s.intrinsics.fy}, {"cx", s.intrinsics.cx},
          {"cy", s.intrinsics.cy}, {"rate", s.rate},        {"is_moving", s.is_moving}};
}

/// Returns the pose x y z qx qy qz qw, not yet validated.
std::optional<Pose> pose_from(const Json& json) {
  if (!json.is_array() || json.size() != 7) return std::nullopt;
  std::array<double, 7> n;
  for (std::size_t i = 0; i < n.size(); ++i) {
    if (!json[i].is_number()) return std::nullopt;
    n[i] = json[i].get<double>();
  }
  return Pose{{n[0], n[1], n[2]}, {n[3], n[4], n[5], n[6]}};
}

}  // namespace

ViewMessage text_message(std::string text) {
  return {std::make_shared<const std::string>(std::move(text)), true};
}
ViewMessage binary_message(std::string bytes) {
  return {std::make_shared<const std::string>(std::move(bytes)), false};
}

std::string encode_spheres(std::span<const Sphere> spheres) {
  Writer writer(Kind::spheres, 0, 0, 4 + 16 * spheres.size());
  writer.put_count(spheres.size());
  for (const Sphere& sphere : spheres) writer.put(sphere);
  return writer.take();
}

std::string encode_graph(const LeafGraph& graph) {
  const std::vector<std::pair<int, int>> edges = graph.edges();
  Writer writer(Kind::graph, 0, 0, 4 + 8 * edges.size());
  writer.put_count(edges.size());
  for (const auto& [a, b] : edges)
    writer.put(static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b));
  return writer.take();
}

std::string encode_mesh(const TriangleMesh& mesh) {
  Writer writer(Kind::mesh, 0, 0, 8 + 12 * (mesh.vertices.size() + mesh.triangles.size()));
  writer.put(mesh);
  return writer.take();
}

std::string encode_objects(std::span<const std::shared_ptr<const Tool>> objects) {
  Writer writer(Kind::objects, 0, 0, 4);
  writer.put_count(objects.size());
  for (const std::shared_ptr<const Tool>& object : objects) writer.put(object->mesh());
  return writer.take();
}

std::string encode_tree(const InnerSphereTree& tree) {
  // A parent comes before its children.
  const std::span<const IstNode> nodes = tree.nodes();
  std::vector<std::uint8_t> levels(nodes.size()), inner_levels;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const std::int32_t parent = nodes[i].parent;
    levels[i] = static_cast<std::uint8_t>(parent < 0 ? 0 : levels[std::size_t(parent)] + 1);
    if (nodes[i].num_children > 0) inner_levels.push_back(levels[i]);
  }
  Writer writer(Kind::tree, 0, 0, 4 + 17 * inner_levels.size());
  writer.put_count(inner_levels.size());
  for (const IstNode& node : nodes)
    if (node.num_children > 0) writer.put(node.bound);
  writer.put_all(std::span<const std::uint8_t>(inner_levels));
  return writer.take();
}

std::string encode_frame(const ViewFrame& view) {
  const DepthFrame& frame = view.frame;
  Writer writer(Kind::frame, view.number, view.time, 72 + 2 * frame.pixels.size());
  writer.put(static_cast<std::uint16_t>(frame.width), static_cast<std::uint16_t>(frame.height));
  writer.put(static_cast<std::uint16_t>(view.camera), std::uint16_t{0});
  writer.put(frame.X_WC);
  writer.put(frame.unit);
  writer.put_all(std::span<const std::uint16_t>(frame.pixels));
  return writer.take();
}

std::string encode_contact(const ViewContact& contact, std::span<const Sphere> spheres,
                           std::uint64_t number) {
  constexpr std::uint8_t kIsCut = 4, kIsUnseen = 8, kCamera = 16;
  constexpr int kMaxListed = 15;
  const auto& [all_states, planes, deciders, unseen] = contact.spheres;
  const std::size_t count = std::min(all_states.size(), spheres.size());
  std::vector<std::uint8_t> states(count);
  std::vector<std::uint32_t> cut;
  for (std::size_t i = 0; i < count; ++i) {
    states[i] = static_cast<std::uint8_t>(all_states[i]);
    if (i < unseen.size() && unseen[i] != 0) states[i] |= kIsUnseen;
    if (all_states[i] == SphereState::outside) continue;
    if (i < deciders.size()) {
      const int camera = std::min(deciders[i] + 1, kMaxListed);
      states[i] |= static_cast<std::uint8_t>(kCamera * camera);
    }
    if (i >= planes.size() || !cuts(planes[i], spheres[i])) continue;
    states[i] |= kIsCut;
    cut.push_back(static_cast<std::uint32_t>(i));
  }
  Writer writer(Kind::contact, number, contact.time,
                76 + count + 16 * cut.size() + 56 * contact.objects.size());
  writer.put(contact.X_WT);
  writer.put_count(count);
  writer.put_all(std::span<const std::uint8_t>(states));
  writer.pad();
  writer.put_count(cut.size());
  for (const std::uint32_t i : cut) {
    writer.put(planes[i].normal);
    writer.put(planes[i].offset);
  }
  writer.put_count(contact.objects.size());
  for (const Pose& X_WB : contact.objects) writer.put(X_WB);
  return writer.take();
}

std::string encode_normals(const ViewSurface& surface, std::uint64_t number, double time) {
  const std::size_t count = std::min(num_pixels(surface), surface.normals.size());
  std::vector<std::int8_t> bytes(4 * num_pixels(surface));
  for (std::size_t i = 0; i < count; ++i) {
    if (!is_finite(surface.normals[i])) continue;
    for (int axis = 0; axis < 3; ++axis)
      bytes[4 * i + static_cast<std::size_t>(axis)] = to_byte(surface.normals[i][axis]);
  }
  Writer writer(Kind::normals, number, time, 4 + bytes.size());
  writer.put(static_cast<std::uint16_t>(surface.width), static_cast<std::uint16_t>(surface.height));
  writer.put_all(std::span<const std::int8_t>(bytes));
  return writer.take();
}

std::string encode_edges(const ViewSurface& surface, std::uint64_t number, double time) {
  const std::size_t count = std::min(surface.edges.size(), surface.points.size());
  std::vector<std::size_t> found;
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3f& edge = surface.edges[i];
    if (is_finite(edge) && !(edge == Vec3f{}) && is_finite(surface.points[i])) found.push_back(i);
  }
  Writer writer(Kind::edges, number, time, 4 + 24 * found.size());
  writer.put_count(found.size());
  for (const std::size_t i : found) {
    writer.put(surface.points[i]);
    writer.put(surface.edges[i]);
  }
  return writer.take();
}

std::string encode_samples(std::span<const ViewSample> samples, std::uint64_t number) {
  const double first_time = samples.empty() ? 0 : samples.front().time;
  Writer writer(Kind::samples, number, first_time, 8 + 4 * kNumColumns * samples.size());
  writer.put_count(samples.size());
  writer.put_count(kNumColumns);
  for (const ViewSample& sample : samples)
    writer.put_all(std::span<const float>(row_of(sample, first_time)));
  return writer.take();
}

std::vector<std::string> sample_columns() {
  std::vector<std::string> names = {"time"};
  const auto add = [&names](const std::string& prefix, std::initializer_list<const char*> parts) {
    for (const char* part : parts) names.push_back(prefix + part);
  };
  for (const char* vector : {"force_", "torque_", "contact_force_", "contact_torque_"})
    add(vector, {"x", "y", "z"});
  add("", {"volume", "compute", "contact_age", "sensor_age", "stretch", "gain", "energy"});
  for (const char* pose : {"tool_", "hand_"}) add(pose, {"x", "y", "z", "qx", "qy", "qz", "qw"});
  add("contact_force_", {"xx", "xy", "xz", "yy", "yz", "zz"});
  add("", {"objects_volume"});
  return names;
}

double tool_radius(const Tool& tool) {
  const Vec3d& center = tool.sphere_mass().center_of_mass;
  return std::max(farthest(tool.mesh().vertices, center), farthest(tool.spheres(), center));
}

std::string hello_text(ViewSource& source, double radius) {
  const ViewContent& content = source.content();
  const Tool& tool = *content.tool;
  Json hello = {{"type", "hello"},
                {"protocol", kViewProtocol},
                {"version", PALPATE_VERSION},
                {"kind", content.kind},
                {"title", content.title},
                {"tool",
                 {{"spheres", tool.spheres().size()},
                  {"center_of_mass", to_json(tool.sphere_mass().center_of_mass)},
                  {"radius", radius},
                  {"volume", tool.mesh_mass().volume}}},
                {"streams", Json::array()},
                {"objects", content.objects.size()},
                {"handle", nullptr},
                {"columns", sample_columns()},
                {"controls", Json::parse(source.controls(), nullptr, false)}};
  if (content.handle_force) hello["handle"] = {{"max_force", *content.handle_force}};
  for (const DepthStreamInfo& stream : content.streams) {
    hello["streams"].push_back(to_json(stream));
  }
  if (!hello["controls"].is_array()) hello["controls"] = Json::array();
  return dump(hello);
}

std::string state_text(ViewSource& source, int num_pages) {
  Json state = parse_object(source.state());
  state["type"] = "state";
  state["pages"] = num_pages;
  return dump(state);
}

std::string picture_text(std::uint64_t number) {
  return R"({"type":"picture","number":)" + std::to_string(number) + '}';
}

std::string answer_text(const Json& id, std::string_view extra) {
  Json answer = parse_object(extra);
  answer["type"] = "answer";
  answer["id"] = id;
  answer["ok"] = true;
  return dump(answer);
}

std::string error_text(const Json& id, std::string_view error) {
  return dump({{"type", "answer"}, {"id", id}, {"ok", false}, {"error", error}});
}

ViewRequest parse_request(std::string_view text) {
  ViewRequest request{Json::parse(text, nullptr, false), nullptr, "", {}, ""};
  const Json& json = request.json;
  if (!json.is_object()) {
    request.error = R"(a message is one JSON object, e.g. {"id": 1, "command": "pause"})";
    return request;
  }
  if (json.contains("id")) {
    if (!json["id"].is_number()) {
      request.error = "\"id\" must be a number";
      return request;
    }
    request.id = json["id"];
  }
  if (json.contains("command")) {
    if (json["command"].is_string()) request.command = json["command"].get<std::string>();
    if (request.command.empty()) request.error = "\"command\" must be the name of a command";
  } else if (json.contains("hand")) {
    request.hand = pose_from(json["hand"]);
    if (!request.hand) request.error = "\"hand\" must be [x, y, z, qx, qy, qz, qw]";
  } else if (!json.contains("ack")) {
    request.error = "\"command\" is missing";
  } else if (!json["ack"].is_number_unsigned()) {
    request.error = "\"ack\" must be the number of a picture";
  }
  return request;
}

}}  // namespace palpate::v0
