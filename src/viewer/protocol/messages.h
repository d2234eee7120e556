// Encodes the messages of docs/viewer-protocol.md.
#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/run/run_loop.h"
#include "palpate/viewer/viewer.h"

namespace palpate { inline namespace v0 {

inline constexpr int kViewProtocol = 3;

/// A message, made once and shared by all pages that it goes to. Null: none.
struct ViewMessage {
  std::shared_ptr<const std::string> bytes;
  bool is_text = false;

  explicit operator bool() const { return bytes != nullptr; }
};
ViewMessage text_message(std::string text);
ViewMessage binary_message(std::string bytes);

// Binary messages. `number` is the header's, and so is `time` where the argument has none.
std::string encode_spheres(std::span<const Sphere> spheres);
std::string encode_graph(const LeafGraph& graph);
std::string encode_mesh(const TriangleMesh& mesh);
std::string encode_tree(const InnerSphereTree& tree);
std::string encode_objects(std::span<const std::shared_ptr<const Tool>> objects);
std::string encode_frame(const ViewFrame& frame);
std::string encode_contact(const ViewContact& contact, std::span<const Sphere> spheres,
                           std::uint64_t number);
std::string encode_normals(const ViewSurface& surface, std::uint64_t number, double time);
std::string encode_edges(const ViewSurface& surface, std::uint64_t number, double time);
std::string encode_samples(std::span<const ViewSample> samples, std::uint64_t number);

// Text messages. A source's JSON counts as nothing where it is invalid.
std::string hello_text(ViewSource& source, double radius);
std::string state_text(ViewSource& source, int num_pages);
std::string picture_text(std::uint64_t number);
/// `id` is the command's; null if it had none. `extra`: the requested data, a JSON object.
std::string answer_text(const nlohmann::json& id, std::string_view extra);
std::string error_text(const nlohmann::json& id, std::string_view error);

/// Returns the radius of a ball around the center of mass that holds spheres and mesh, m. O(n).
double tool_radius(const Tool& tool);

/// Names of the columns of encode_samples.
std::vector<std::string> sample_columns();

/// A request of a page or script.
struct ViewRequest {
  nlohmann::json json;  ///< all of it, an object
  nlohmann::json id;    ///< a number, or null
  std::string command;  ///< empty: an acknowledgement, or a pose of the hand
  std::optional<Pose> hand;
  std::string error;  ///< empty: none so far
};
ViewRequest parse_request(std::string_view text);

/// `stages` of the protocol.
nlohmann::ordered_json stages_json(const LoopTimes& times);
nlohmann::ordered_json stage_json(const char* name, const LatencyHistogram& times);

}}  // namespace palpate::v0
