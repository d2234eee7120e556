#include "palpate/mesh/mesh.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "src/core/internal/message_text.h"
#include "src/mesh/mesh_repair.h"
#include "src/mesh/mesh_topology.h"
#include "src/mesh/self_intersection.h"
#include "src/mesh/shell_nesting.h"

namespace palpate { inline namespace v0 {
namespace {

Error bad_mesh(std::string message) { return {Errc::bad_input, std::move(message)}; }

std::string number(double x) { return number_text(x, 4); }

std::string point(const Vec3d& p) {
  return "(" + number(p.x) + ", " + number(p.y) + ", " + number(p.z) + ") m";
}

/// "1 face", "2 faces".
std::string count(std::size_t n, const std::string& noun) {
  return std::to_string(n) + " " + noun + (n == 1 ? "" : "s");
}

Vec3d face_center(const TriangleMesh& mesh, std::size_t face) {
  const Triangle& t = mesh.triangles[face];
  return (mesh.vertices[t[0]] + mesh.vertices[t[1]] + mesh.vertices[t[2]]) / 3;
}

std::optional<Error> check_numbers(const TriangleMesh& mesh) {
  if (mesh.triangles.empty()) {
    return bad_mesh("the mesh has no faces; export it as triangles or polygons");
  }
  // Faces and half-edges are counted with 32 bits.
  if (mesh.triangles.size() > std::numeric_limits<std::uint32_t>::max() / 4) {
    return bad_mesh("the mesh has " + count(mesh.triangles.size(), "face") +
                    ", too many to check; simplify it");
  }
  for (std::size_t face = 0; face < mesh.triangles.size(); ++face) {
    for (const std::uint32_t vertex : mesh.triangles[face]) {
      if (vertex >= mesh.vertices.size()) {
        return bad_mesh("face " + std::to_string(face) + " uses vertex " + std::to_string(vertex) +
                        " (counted from 0) but there are only " +
                        std::to_string(mesh.vertices.size()) + "; export the mesh again");
      }
      const Vec3d& p = mesh.vertices[vertex];
      if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) {
        return bad_mesh("a corner of face " + std::to_string(face) +
                        " (counted from 0) is not a finite number; remove that vertex and close "
                        "the hole in a mesh editor");
      }
    }
  }
  return std::nullopt;
}

std::optional<Error> check_extent(const TriangleMesh& mesh, const MeshCheckOptions& options) {
  const Bounds box = bounds(mesh);
  const Vec3d sides = box.high - box.low;
  const double longest = std::max({sides.x, sides.y, sides.z});
  if (longest > options.max_extent) {
    return bad_mesh("the mesh is " + number(longest) + " m long and a tool may have at most " +
                    number(options.max_extent) +
                    " m; give --unit mm if the file is in millimeters, or --scale");
  }
  if (longest < options.min_extent) {
    return bad_mesh("the mesh is " + number(longest) + " m long and a tool must have at least " +
                    number(options.min_extent) +
                    " m; give the right --unit (m if the file is in meters), or --scale");
  }
  return std::nullopt;
}

Error edge_error(const TriangleMesh& mesh, const EdgeFaults& faults) {
  std::string list;
  const auto add = [&](std::size_t n, const char* kind, const char* meaning) {
    if (n == 0) return;
    list += (list.empty() ? "" : ", ") + count(n, std::string(kind) + " edge") + meaning;
  };
  add(faults.open, "open", " (of one face only)");
  add(faults.non_manifold, "non-manifold", " (of more than two faces)");
  add(faults.inconsistent, "inconsistently oriented", " (whose two faces look to opposite sides)");
  const Vec3d middle = (mesh.vertices[faults.first.from] + mesh.vertices[faults.first.to]) * 0.5;
  std::string advice;
  if (faults.open) advice += "close the holes";
  if (faults.non_manifold)
    advice += (advice.empty() ? "" : ", ") + std::string("remove inner faces");
  if (faults.inconsistent)
    advice += (advice.empty() ? "" : ", ") + std::string("unify the normals");
  return bad_mesh("the mesh does not bound a solid: " + list + ", the first at " + point(middle) +
                  "; " + advice + " in a mesh editor");
}

/// Leaves a mesh whose edges are sound and whose faces have an area, or says why it cannot.
std::optional<Error> repair(SolidMesh& solid, double tolerance) {
  TriangleMesh& mesh = solid.mesh;
  std::size_t num_dropped = weld_vertices(mesh, 0);
  const std::size_t num_distinct = mesh.vertices.size();
  num_dropped += weld_vertices(mesh, tolerance);
  if (mesh.vertices.size() < num_distinct) {
    solid.warnings.push_back("joined " +
                             count(num_distinct - mesh.vertices.size(), "stray corner") +
                             " to others less than " + number(tolerance) + " m away");
  }

  EdgeFaults faults = find_edge_faults(mesh.triangles);
  if (!faults.none()) {
    // Faces without area may be the ones in excess.
    std::vector<Triangle> others = mesh.triangles;
    const std::size_t num_needles =
        std::erase_if(others, [&](const Triangle& t) { return is_needle(mesh, t, tolerance); });
    if (num_needles == 0 || !find_edge_faults(others).none()) return edge_error(mesh, faults);
    mesh.triangles = std::move(others);
    num_dropped += num_needles;
  }
  num_dropped += remove_needles(mesh, tolerance);
  if (num_dropped > 0) {
    solid.warnings.push_back("dropped " + count(num_dropped, "face") +
                             " without area; the surface stays closed");
  }
  drop_unused_vertices(mesh);
  if (mesh.triangles.empty()) {
    return bad_mesh("no face of the mesh has an area; export it again, perhaps in another unit");
  }
  for (std::size_t face = 0; face < mesh.triangles.size(); ++face) {
    if (!is_needle(mesh, mesh.triangles[face], tolerance)) continue;
    return bad_mesh("a face at " + point(face_center(mesh, face)) +
                    " has no area and cannot be dropped without opening the surface; dissolve "
                    "degenerate faces in a mesh editor");
  }
  return std::nullopt;
}

std::optional<Error> check_crossings(const TriangleMesh& mesh) {
  const auto search = find_self_intersection(mesh);
  if (!search) return search.error();
  const std::optional<FacePair>& pair = *search;
  if (!pair) return std::nullopt;
  const std::vector<std::uint32_t> shell = shell_of_faces(mesh.triangles);
  const std::string where = point(face_center(mesh, pair->first));
  if (shell[pair->first] != shell[pair->second]) {
    return bad_mesh("two parts of the mesh touch or overlap near " + where +
                    "; unite them (Boolean union) in a mesh editor");
  }
  return bad_mesh("the surface of the mesh crosses or touches itself near " + where +
                  "; remove the self-intersection (remesh or Boolean union) in a mesh editor");
}

void flip_triangles(TriangleMesh& mesh, Shell& shell) {
  for (const std::uint32_t face : shell.faces) {
    std::swap(mesh.triangles[face][1], mesh.triangles[face][2]);
  }
  shell.signed_volume = -shell.signed_volume;
}

/// Bodies look outwards and their cavities inwards. A body that is inside out is turned together
/// with everything in it; after that, anything wrong is the user's to decide.
std::optional<Error> orient(SolidMesh& solid, std::vector<Shell> shells) {
  const auto nesting = find_nesting(solid.mesh, shells);
  if (!nesting) return nesting.error();
  std::vector<bool> is_turned(shells.size());
  for (std::size_t i = 0; i < shells.size(); ++i) {
    is_turned[i] = (*nesting)[i].num_around == 0 && shells[i].signed_volume <= 0;
  }
  for (std::size_t i = 0; i < shells.size(); ++i) {
    if (is_turned[(*nesting)[i].outermost]) flip_triangles(solid.mesh, shells[i]);
  }
  const auto num_turned =
      static_cast<std::size_t>(std::count(is_turned.begin(), is_turned.end(), true));
  if (num_turned > 0) {
    solid.warnings.push_back((shells.size() == 1 ? "the mesh was inside out: all faces were turned"
                                                 : "turned " + count(num_turned, "part") +
                                                       " of the mesh that looked inside out"));
  }
  for (std::size_t i = 0; i < shells.size(); ++i) {
    const bool is_cavity = (*nesting)[i].num_around % 2 == 1;
    if ((shells[i].signed_volume < 0) == is_cavity) continue;
    return bad_mesh("a closed part of the mesh at " + point(shells[i].sample) +
                    " is inside another one with the same orientation; remove it, or flip its "
                    "normals if it is a cavity");
  }
  return std::nullopt;
}

std::optional<Error> check_volume(const std::vector<Shell>& shells, double tolerance) {
  for (const Shell& shell : shells) {
    if (std::abs(shell.signed_volume) > tolerance * shell.area) continue;
    return bad_mesh("a part of the mesh at " + point(shell.sample) +
                    " encloses no volume; remove it or give it a thickness in a mesh editor");
  }
  return std::nullopt;
}

}  // namespace

Result<SolidMesh> check_solid(const TriangleMesh& raw, const MeshCheckOptions& options) {
  if (auto error = check_numbers(raw)) return *error;
  SolidMesh solid{raw, {}};
  drop_unused_vertices(solid.mesh);
  if (auto error = check_extent(solid.mesh, options)) return *error;

  const Bounds box = bounds(solid.mesh);
  const double tolerance = options.weld_fraction * norm(box.high - box.low);
  if (auto error = repair(solid, tolerance)) return *error;

  std::vector<Shell> shells = find_shells(solid.mesh);
  if (auto error = check_volume(shells, tolerance)) return *error;
  if (auto error = check_crossings(solid.mesh)) return *error;
  if (auto error = orient(solid, std::move(shells))) return *error;
  return solid;
}

}}  // namespace palpate::v0
