// Layout, all little endian, every section at a multiple of 8 bytes:
//   header          magic, format version, number of sections, length of the file
//   section table   per section: name, element size, offset, number of elements
//   sections        vertices, triangles, spheres, facts, edges, source, represented volumes and
//                   balls, tree nodes; of tools that have one the distance field, grid and values
//   checksum        XXH3-64 of everything before it
#include "palpate/io/files.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <optional>
#include <type_traits>
#include <utility>

#include "src/io/internal/atomic_file.h"
#include "src/io/internal/hashes.h"

namespace palpate { inline namespace v0 {
namespace {

static_assert(std::endian::native == std::endian::little, "tool files are little endian");

constexpr std::array<char, 8> kMagic{'\x89', 'P', 'A', 'L', 'P', '\r', '\n', '\x1a'};
constexpr std::uint32_t kVersion = 4;
constexpr std::size_t kAlignment = 8;
constexpr std::size_t kMaxSource = std::size_t(1) << 20;

struct Header {
  std::array<char, 8> magic = kMagic;
  std::uint32_t version = kVersion;
  std::uint32_t num_sections = 0;
  std::uint64_t file_bytes = 0;
};

enum class SectionName : std::uint32_t {
  vertices = 1,
  triangles,
  spheres,
  facts,
  edges,
  source,
  represented_volumes,
  tree_nodes,
  solid_grid,  // optional, both or neither
  solid_values,
  represented_balls
};
constexpr std::size_t kNeededSections = 9;

struct Section {
  SectionName name{};
  std::uint32_t element_bytes = 0;
  std::uint64_t offset = 0, num_elements = 0;
};

struct Facts {
  double mesh_volume = 0;
  std::uint32_t stop = 0;
  std::uint32_t num_bridges = 0;
  std::uint32_t num_components_before_bridging = 0;
  std::uint32_t gap_rule = 0;
};

struct SolidGrid {
  Vec3d origin;
  double spacing = 0;
  std::array<std::int32_t, 3> num_cells{};
  std::uint32_t zero = 0;
};

using Checksum = std::uint64_t;
using StoredEdge = std::array<std::uint32_t, 2>;
using StoredTriangle = std::array<std::uint32_t, 3>;

// These types are copied byte by byte, so they have no padding.
static_assert(sizeof(Header) == 24 && sizeof(Section) == 24 && sizeof(Facts) == 24);
static_assert(sizeof(Vec3d) == 24 && sizeof(Sphere) == 16 && sizeof(StoredTriangle) == 12);
static_assert(sizeof(IstNode) == 32 && sizeof(SolidGrid) == 48);

class Writer {
 public:
  explicit Writer(std::size_t num_sections)
      : content_(sizeof(Header) + num_sections * sizeof(Section), '\0') {}

  template <class T>
  void add(SectionName name, const T* elements, std::size_t count) {
    static_assert(std::is_trivially_copyable_v<T>);
    pad();
    sections_.push_back({name, sizeof(T), content_.size(), count});
    if (count > 0) content_.append(reinterpret_cast<const char*>(elements), count * sizeof(T));
  }

  std::string finish() {
    pad();
    const Header header{.num_sections = static_cast<std::uint32_t>(sections_.size()),
                        .file_bytes = content_.size() + sizeof(Checksum)};
    std::memcpy(content_.data(), &header, sizeof(header));
    std::memcpy(content_.data() + sizeof(header), sections_.data(),
                sections_.size() * sizeof(Section));
    const Checksum checksum = xxh3_of_long(content_);
    content_.append(reinterpret_cast<const char*>(&checksum), sizeof(checksum));
    return std::move(content_);
  }

 private:
  void pad() { content_.resize((content_.size() + kAlignment - 1) / kAlignment * kAlignment); }

  std::string content_;
  std::vector<Section> sections_;  // as many as were announced
};

template <class T>
T element(std::string_view bytes, std::size_t i) {
  T value;
  std::memcpy(&value, bytes.data() + i * sizeof(T), sizeof(T));
  return value;
}

class Reader {
 public:
  explicit Reader(std::string_view content) : content_(content) {}

  /// Magic, version, length and checksum: afterwards the file is what a program has written.
  std::optional<std::string> check_whole() {
    if (content_.size() < sizeof(kMagic) ||
        std::memcmp(content_.data(), kMagic.data(), sizeof(kMagic)) != 0)
      return "is not a tool file; make one with 'palpate pack'";
    if (content_.size() < kMinXxh3Bytes + sizeof(Checksum)) return truncated();
    std::memcpy(&header_, content_.data(), sizeof(header_));
    if (header_.version > kVersion)
      return "has format version " + std::to_string(header_.version) +
             ", this program reads up to " + std::to_string(kVersion) + "; use a newer program";
    if (header_.version < kVersion)
      return "has format version " + std::to_string(header_.version) + ", this program reads " +
             std::to_string(kVersion) + "; pack the mesh again";
    if (content_.size() < header_.file_bytes) return truncated();
    if (content_.size() > header_.file_bytes) return damaged("bytes follow its end");
    const std::size_t body_bytes = content_.size() - sizeof(Checksum);
    Checksum checksum;
    std::memcpy(&checksum, content_.data() + body_bytes, sizeof(checksum));
    if (checksum != xxh3_of_long(content_.substr(0, body_bytes)))
      return damaged("its checksum does not match");
    if (header_.num_sections > (body_bytes - sizeof(Header)) / sizeof(Section))
      return damaged("it has no room for its sections");
    return std::nullopt;
  }

  /// The bytes of a section with elements of type T; nullopt if it is missing, stored twice, or
  /// outside of the file.
  template <class T>
  std::optional<std::string_view> find(SectionName name) const {
    static_assert(std::is_trivially_copyable_v<T>);
    std::optional<Section> found;
    for (std::uint32_t i = 0; i < header_.num_sections; ++i) {
      const auto section = element<Section>(content_.substr(sizeof(Header)), i);
      if (section.name != name) continue;
      if (found) return std::nullopt;
      found = section;
    }
    const std::size_t body_bytes = content_.size() - sizeof(Checksum);
    if (!found || found->element_bytes != sizeof(T) || found->offset > body_bytes ||
        found->num_elements > (body_bytes - found->offset) / sizeof(T))
      return std::nullopt;
    return content_.substr(found->offset, found->num_elements * sizeof(T));
  }

  bool has(SectionName name) const {
    for (std::uint32_t i = 0; i < header_.num_sections; ++i) {
      if (element<Section>(content_.substr(sizeof(Header)), i).name == name) return true;
    }
    return false;
  }

  /// All elements of a section, under the same conditions.
  template <class T>
  std::optional<std::vector<T>> take(SectionName name) const {
    const auto bytes = find<T>(name);
    if (!bytes) return std::nullopt;
    std::vector<T> elements(bytes->size() / sizeof(T));
    if (!elements.empty()) std::memcpy(elements.data(), bytes->data(), bytes->size());
    return elements;
  }

  static std::string damaged(const std::string& how) {
    return "is damaged: " + how + "; copy it again or pack the mesh again";
  }

 private:
  static std::string truncated() { return "is truncated; copy it again or pack the mesh again"; }

  std::string_view content_;
  Header header_;
};

/// The edges as (a, b) with a < b < num_spheres, strictly ascending; nullopt otherwise.
std::optional<std::vector<std::pair<int, int>>> checked_edges(std::string_view stored,
                                                              std::size_t num_spheres) {
  std::vector<std::pair<int, int>> edges;
  edges.reserve(stored.size() / sizeof(StoredEdge));
  std::uint64_t last = 0;  // (0, 0) is no edge, and all others come after it
  for (std::size_t i = 0; i < stored.size() / sizeof(StoredEdge); ++i) {
    const auto [a, b] = element<StoredEdge>(stored, i);
    const std::uint64_t edge = std::uint64_t(a) << 32 | b;
    if (a >= b || b >= num_spheres || edge <= last) return std::nullopt;
    last = edge;
    edges.emplace_back(static_cast<int>(a), static_cast<int>(b));
  }
  return edges;
}

/// Null if the file has none.
Result<std::shared_ptr<const SolidField>> parse_solid_field(const Reader& reader) {
  if (!reader.has(SectionName::solid_grid) && !reader.has(SectionName::solid_values)) {
    return std::shared_ptr<const SolidField>();
  }
  const auto grid = reader.take<SolidGrid>(SectionName::solid_grid);
  const auto values = reader.take<float>(SectionName::solid_values);
  if (!grid || !values || grid->size() != 1) {
    return Error{Errc::bad_input, Reader::damaged("its distance field does not fit")};
  }
  const SolidGrid& stored = grid->front();
  auto field = SolidField::restore({stored.origin, stored.spacing, stored.num_cells}, *values);
  if (!field) return Error{Errc::bad_input, "is damaged: " + field.error().message};
  return std::make_shared<const SolidField>(*std::move(field));
}

Result<Tool> parse_tool(std::string_view content) {
  const auto bad = [](std::string message) { return Error{Errc::bad_input, std::move(message)}; };
  Reader reader(content);
  if (auto trouble = reader.check_whole()) return bad(*trouble);
  auto vertices = reader.take<Vec3d>(SectionName::vertices);
  auto triangles = reader.take<StoredTriangle>(SectionName::triangles);
  auto spheres = reader.take<Sphere>(SectionName::spheres);
  const auto facts = reader.take<Facts>(SectionName::facts);
  const auto stored_edges = reader.find<StoredEdge>(SectionName::edges);
  const auto source = reader.take<char>(SectionName::source);
  auto volumes = reader.take<float>(SectionName::represented_volumes);
  auto balls = reader.take<Sphere>(SectionName::represented_balls);
  auto tree_nodes = reader.take<IstNode>(SectionName::tree_nodes);
  if (!vertices || !triangles || !spheres || !facts || !stored_edges || !source || !volumes ||
      !balls || !tree_nodes)
    return bad(Reader::damaged("a section is missing or does not fit"));
  if (facts->size() != 1 || source->size() > kMaxSource)
    return bad(Reader::damaged("a section has the wrong size"));

  const Facts& fact = facts->front();
  if (fact.stop > static_cast<std::uint32_t>(PackStop::standoff) ||
      fact.gap_rule > static_cast<std::uint32_t>(GapRule::relative) ||
      fact.num_bridges > stored_edges->size() / sizeof(StoredEdge) ||
      std::uint64_t(fact.num_bridges) + 1 != fact.num_components_before_bridging ||
      fact.num_components_before_bridging > spheres->size())
    return bad(Reader::damaged("its facts are out of range"));
  const auto edges = checked_edges(*stored_edges, spheres->size());
  if (!edges) return bad(Reader::damaged("its edges are out of range"));

  auto solid_field = parse_solid_field(reader);
  if (!solid_field) return solid_field.error();

  LeafGraph graph(spheres->size(), *edges, static_cast<int>(fact.num_bridges),
                  static_cast<int>(fact.num_components_before_bridging));
  SpherePacking packing{std::move(*spheres), fact.mesh_volume, static_cast<PackStop>(fact.stop)};
  Tool::StoredParts parts{std::move(graph),
                          static_cast<GapRule>(fact.gap_rule),
                          {std::move(*volumes), std::move(*balls)},
                          std::move(*tree_nodes),
                          *std::move(solid_field)};
  auto tool = Tool::restore({std::move(*vertices), std::move(*triangles)}, std::move(packing),
                            std::move(parts), std::string(source->begin(), source->end()));
  if (!tool) return bad("holds a bad tool: " + tool.error().message);
  return tool;
}

}  // namespace

Result<std::string> tool_to_bytes(const Tool& tool) {
  if (tool.source().size() > kMaxSource)
    return Error{Errc::invalid_argument, "the name of the tool's source is longer than 1 MiB"};
  const TriangleMesh& mesh = tool.mesh();
  const LeafGraph& graph = tool.graph();
  std::vector<StoredEdge> edges;
  edges.reserve(static_cast<std::size_t>(graph.num_edges()));
  for (const auto& [a, b] : graph.edges())
    edges.push_back({static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b)});
  const Facts facts{tool.packing().mesh_volume, static_cast<std::uint32_t>(tool.packing().stop),
                    static_cast<std::uint32_t>(graph.num_bridges()),
                    static_cast<std::uint32_t>(graph.num_components_before_bridging()),
                    static_cast<std::uint32_t>(tool.gap_rule())};

  const SolidField* field = tool.solid_field().get();
  Writer writer(kNeededSections + (field != nullptr ? 2 : 0));
  writer.add(SectionName::vertices, mesh.vertices.data(), mesh.vertices.size());
  writer.add(SectionName::triangles, mesh.triangles.data(), mesh.triangles.size());
  writer.add(SectionName::spheres, tool.spheres().data(), tool.spheres().size());
  writer.add(SectionName::facts, &facts, 1);
  writer.add(SectionName::edges, edges.data(), edges.size());
  writer.add(SectionName::source, tool.source().data(), tool.source().size());
  writer.add(SectionName::represented_volumes, tool.represented_volumes().data(),
             tool.represented_volumes().size());
  writer.add(SectionName::represented_balls, tool.represented_balls().data(),
             tool.represented_balls().size());
  writer.add(SectionName::tree_nodes, tool.tree().nodes().data(), tool.tree().nodes().size());
  if (field != nullptr) {
    const SolidField::Layout& layout = field->layout();
    const SolidGrid grid{layout.origin, layout.spacing, layout.num_cells};
    writer.add(SectionName::solid_grid, &grid, 1);
    writer.add(SectionName::solid_values, field->values().data(), field->values().size());
  }
  return writer.finish();
}

Result<Tool> tool_from_bytes(std::string_view bytes) { return parse_tool(bytes); }

Status save_tool(const Tool& tool, const std::filesystem::path& path) {
  const auto bytes = tool_to_bytes(tool);
  if (!bytes) {
    return Error{bytes.error().code,
                 "cannot write " + path.string() + ": " + bytes.error().message};
  }
  return write_file_atomically(path, *bytes);
}

namespace {

/// Returns the command that makes a tool of a file; of no mesh, its beginning.
std::string pack_command(const std::string& file) {
  const std::size_t dot = std::min(file.rfind('.'), file.size());
  constexpr std::string_view kMeshes[] = {".obj", ".stl", ".ply", ".off", ".gltf", ".glb"};
  if (std::ranges::find(kMeshes, file.substr(dot)) == std::end(kMeshes)) return "palpate pack";
  return "palpate pack " + file + " -o " + file.substr(0, dot) + ".palp";
}

}  // namespace

Result<Tool> load_tool(const std::filesystem::path& path) {
  const auto content = read_file(path);
  if (!content) return content.error();
  auto tool = parse_tool(*content);
  if (tool) return tool;
  std::string what = path.string() + " " + tool.error().message;
  constexpr std::string_view kCommand = "palpate pack";
  if (const std::size_t at = what.rfind(kCommand); what.ends_with("'palpate pack'")) {
    what.replace(at, kCommand.size(), pack_command(path.string()));
  }
  return Error{tool.error().code, what};
}

}}  // namespace palpate::v0
