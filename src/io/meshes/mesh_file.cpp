#include "palpate/io/formats.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <string>

#include "src/io/internal/atomic_file.h"
#include "src/io/internal/text_scanner.h"
#include "src/io/meshes/mesh_parsers.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kMaxBytes = std::size_t(2) << 30;

/// The extension in lower case, with its dot.
std::string extension_of(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

Result<TriangleMesh> parse(const std::filesystem::path& path, const std::string& extension,
                           std::string_view content) {
  const std::string_view text = without_mark(content);
  if (extension == ".obj") return parse_obj_mesh(text);
  if (extension == ".ply") return parse_ply_mesh(text);
  if (extension == ".off") return parse_off_mesh(text);
  if (extension == ".stl") {
    return is_text_stl(text) ? parse_text_stl(text) : parse_binary_stl(content);
  }
  // Some call a .glb .gltf, or a .gltf .glb.
  std::string_view words = text;
  const bool is_json = take_word(words).starts_with('{');
  const bool is_glb = extension == ".glb" ? !is_json : content.starts_with("glTF");
  if (is_glb) return parse_glb(content, path.parent_path());
  return parse_gltf(text, {}, path.parent_path(), content.size());
}

}  // namespace

Result<TriangleMesh> load_mesh(const std::filesystem::path& path, double scale) {
  if (!(scale > 0) || !std::isfinite(scale)) {
    return Error{Errc::invalid_argument,
                 "the scale of a mesh is " + std::to_string(scale) + "; give a number above zero"};
  }
  const std::string extension = extension_of(path);
  static constexpr std::string_view kKnown[] = {".obj", ".stl", ".ply", ".off", ".gltf", ".glb"};
  if (std::find(std::begin(kKnown), std::end(kKnown), extension) == std::end(kKnown)) {
    return Error{Errc::bad_input, "cannot read " + path.string() + ": '" + extension +
                                      "' is not a known mesh format; give a .obj, .stl, .ply, "
                                      ".off, .gltf or .glb file"};
  }
  const auto content = read_file(path, kMaxBytes);
  if (!content) return content.error();
  if (content->empty()) {
    return Error{Errc::bad_input, path.string() + " is empty; export the mesh again"};
  }
  auto mesh = parse(path, extension, *content);
  if (!mesh) {
    return Error{mesh.error().code,
                 path.string() + " " + mesh.error().message + "; export the mesh again"};
  }
  if (mesh->triangles.empty()) {
    return Error{Errc::bad_input,
                 path.string() + " has no faces; export it as a mesh of triangles or polygons"};
  }
  for (Vec3d& p : mesh->vertices) p *= scale;
  return mesh;
}

}}  // namespace palpate::v0
