#include "src/c/handles.h"

#include "palpate/io/files.h"
#include "palpate/version.h"

using namespace palpate;

namespace {

palpate_tool* handle_of(Result<Tool> made, palpate_error* error) {
  if (made) return new palpate_tool{*std::move(made)};
  fail(error, made.error());
  return nullptr;
}

palpate_tool* packed(const TriangleMesh& raw, const char* source, const char* options,
                     palpate_progress progress, void* context, palpate_error* error) {
  PackOptions packing;
  if (const Status status = read_options(options, packing); !status)
    return fail(error, status.error()), nullptr;
  auto solid = check_solid(raw);
  if (!solid) return fail(error, solid.error()), nullptr;
  if (progress != nullptr) {
    packing.progress = [=](const PackProgress& now) {
      return progress(context, now.num_spheres, now.fill) != 0;
    };
  }
  return handle_of(Tool::pack(std::move(solid->mesh), packing, {.source = source}), error);
}

}  // namespace

extern "C" {

const char* palpate_version(void) { return PALPATE_VERSION; }

palpate_tool* palpate_tool_pack(const double* vertices, size_t num_vertices,
                                const uint32_t* triangles, size_t num_triangles,
                                const char* options, palpate_progress progress, void* context,
                                palpate_error* error) {
  return guarded_call(error, static_cast<palpate_tool*>(nullptr), [&]() -> palpate_tool* {
    if (vertices == nullptr || triangles == nullptr)
      return fail(error, "a mesh has no vertices or no triangles: give both arrays"), nullptr;
    TriangleMesh mesh;
    mesh.vertices.reserve(num_vertices);
    for (size_t i = 0; i < num_vertices; ++i) mesh.vertices.push_back(vector_of(vertices + 3 * i));
    mesh.triangles.reserve(num_triangles);
    for (size_t i = 0; i < 3 * num_triangles; i += 3)
      mesh.triangles.push_back({triangles[i], triangles[i + 1], triangles[i + 2]});
    return packed(mesh, "arrays", options, progress, context, error);
  });
}

palpate_tool* palpate_tool_pack_shape(const char* shape, double size, const char* options,
                                      palpate_error* error) {
  return guarded_call(error, static_cast<palpate_tool*>(nullptr), [&]() -> palpate_tool* {
    if (shape == nullptr) return fail(error, "a shape has no name: give one"), nullptr;
    const auto mesh = make_shape(shape, size);
    if (!mesh) return fail(error, mesh.error()), nullptr;
    return packed(*mesh, shape, options, nullptr, nullptr, error);
  });
}

palpate_tool* palpate_tool_load(const void* bytes, size_t num_bytes, palpate_error* error) {
  return guarded_call(error, static_cast<palpate_tool*>(nullptr), [&]() -> palpate_tool* {
    if (bytes == nullptr) return fail(error, "a tool file has no bytes: give them"), nullptr;
    auto tool = tool_from_bytes({static_cast<const char*>(bytes), num_bytes});
    if (tool) return handle_of(std::move(tool), error);
    return fail(error, Error{tool.error().code, "the tool file " + tool.error().message}), nullptr;
  });
}

size_t palpate_tool_save(const palpate_tool* tool, void* bytes, size_t capacity,
                         palpate_error* error) {
  return guarded_call(error, size_t(0), [&]() -> size_t {
    if (tool == nullptr) return fail(error, "there is no tool to save: pack or load one"), 0;
    const auto file = tool_to_bytes(tool->tool);
    if (!file) return fail(error, file.error()), 0;
    if (bytes != nullptr && file->size() <= capacity)
      std::memcpy(bytes, file->data(), file->size());
    return file->size();
  });
}

palpate_tool* palpate_tool_prefix(const palpate_tool* tool, int32_t num_spheres,
                                  palpate_error* error) {
  return guarded_call(error, static_cast<palpate_tool*>(nullptr), [&]() -> palpate_tool* {
    if (tool == nullptr)
      return fail(error, "there is no tool to make coarser: pack or load one"), nullptr;
    return handle_of(tool->tool.prefix(num_spheres), error);
  });
}

void palpate_tool_free(palpate_tool* tool) { delete tool; }

void palpate_tool_describe(const palpate_tool* tool, palpate_tool_info* info) {
  if (tool == nullptr || !is_given(info)) return;
  const Tool& t = tool->tool;
  palpate_tool_info all{};
  all.num_spheres = static_cast<int32_t>(t.spheres().size());
  all.num_vertices = static_cast<int32_t>(t.mesh().vertices.size());
  all.num_triangles = static_cast<int32_t>(t.mesh().triangles.size());
  all.volume = t.mesh_mass().volume;
  put(t.sphere_mass().center_of_mass, all.center_of_mass);
  for (const Vec3d& p : t.mesh().vertices)
    all.radius = std::max(all.radius, norm(p - t.sphere_mass().center_of_mass));
  const Bounds box = bounds(t.mesh());
  put(box.low, all.low);
  put(box.high, all.high);
  give(all, info);
}

void palpate_tool_spheres(const palpate_tool* tool, float* spheres) {
  if (tool == nullptr || spheres == nullptr) return;
  for (const Sphere& s : tool->tool.spheres()) {
    for (int axis = 0; axis < 3; ++axis) *spheres++ = s.center[axis];
    *spheres++ = s.radius;
  }
}

void palpate_tool_mesh(const palpate_tool* tool, float* vertices, uint32_t* triangles) {
  if (tool == nullptr) return;
  const TriangleMesh& mesh = tool->tool.mesh();
  if (vertices != nullptr) {
    for (const Vec3d& p : mesh.vertices)
      for (int axis = 0; axis < 3; ++axis) *vertices++ = static_cast<float>(p[axis]);
  }
  if (triangles != nullptr) {
    for (const auto& triangle : mesh.triangles)
      triangles = std::copy(triangle.begin(), triangle.end(), triangles);
  }
}

}  // extern "C"
