// palpate.Tool: packing meshes, tool files, and the parts of a tool.
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include "palpate/io/files.h"
#include "palpate/io/formats.h"
#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"
#include "python/src/arrays.h"
#include "python/src/bindings.h"

namespace palpate::python {
namespace {

constexpr const char* kUnits[] = {"m", "mm", "cm", "in"};
constexpr double kMeters[] = {1, 0.001, 0.01, 0.0254};

double meters_of(const std::string& unit) {
  for (std::size_t i = 0; i < std::size(kUnits); ++i) {
    if (unit == kUnits[i]) return kMeters[i];
  }
  throw nb::value_error(("unit: '" + unit + "' is not m, mm, cm or in").c_str());
}

TriangleMesh mesh_of(nb::handle vertices, nb::handle triangles, double scale) {
  const Doubles points = doubles_of(vertices, "vertices");
  if (points.ndim() != 2 || points.shape(1) != 3) {
    refuse_shape("vertices", shape_of(points), "(V, 3)");
  }
  const auto faces = numbers_of<std::int64_t>(triangles, "triangles", "int64");
  if (faces.ndim() != 2 || faces.shape(1) != 3) {
    refuse_shape("triangles", shape_of(faces), "(F, 3)");
  }
  TriangleMesh mesh;
  for (std::size_t i = 0; i < points.shape(0); ++i) {
    const double* p = points.data() + 3 * i;
    mesh.vertices.push_back({p[0] * scale, p[1] * scale, p[2] * scale});
  }
  const auto num_vertices = static_cast<std::int64_t>(mesh.vertices.size());
  for (std::size_t i = 0; i < faces.shape(0); ++i) {
    const std::int64_t* f = faces.data() + 3 * i;
    for (int k = 0; k < 3; ++k) {
      if (f[k] >= 0 && f[k] < num_vertices) continue;
      throw nb::value_error(("triangles: row " + std::to_string(i) + " names vertex " +
                             std::to_string(f[k]) + ", but there are " +
                             std::to_string(num_vertices) + ", counted from 0")
                                .c_str());
    }
    mesh.triangles.push_back({static_cast<std::uint32_t>(f[0]), static_cast<std::uint32_t>(f[1]),
                              static_cast<std::uint32_t>(f[2])});
  }
  return mesh;
}

struct PackRequest {
  PackOptions options;
  GapRule gap_rule = GapRule::relative;
};

PackRequest request_of(int spheres, std::uint64_t seed, int threads, const nb::dict& keywords) {
  PackRequest request;
  SettingTable table = settings_of(request.options);
  check(table.set("packing.spheres", double(spheres)));
  request.options.seed = seed;
  request.options.num_threads = threads;
  apply(keywords, table);
  return request;
}

/// Turns warnings about the mesh into Python warnings.
void warn(const std::vector<std::string>& warnings) {
  for (const std::string& text : warnings) {
    if (PyErr_WarnEx(PyExc_UserWarning, text.c_str(), 2) != 0) throw nb::python_error();
  }
}

/// Packs without the GIL, except to call `progress` and to poll Ctrl-C.
PyTool packed(const TriangleMesh& raw, PackRequest request, const nb::object& progress,
              const std::string& source) {
  request.options.progress = [&](const PackProgress& now) {
    const nb::gil_scoped_acquire gil;
    if (is_interrupted()) return false;
    if (progress.is_none()) return true;
    try {
      return !progress(now.num_spheres, now.fill, now.last_radius).is(nb::bool_(false));
    } catch (nb::python_error& error) {
      error.restore();
      return false;
    }
  };
  Result<SolidMesh> solid = Error{};
  Result<Tool> tool = Error{};
  {
    const nb::gil_scoped_release no_gil;
    solid = check_solid(raw);
    if (solid) {
      tool = Tool::pack(solid->mesh, request.options,
                        {request.gap_rule, source, request.options.num_threads});
      if (tool) tool = std::move(*tool).with_solid_field(request.options.num_threads);
    }
  }
  if (PyErr_Occurred() != nullptr) throw nb::python_error();
  if (!solid) throw PalpateError(source + ": " + solid.error().message);
  warn(solid->warnings);
  if (!tool) throw PalpateError(source + ": " + tool.error().message);
  PyTool made{std::make_shared<const Tool>(*std::move(tool))};
  if (is_interrupted()) throw nb::python_error();
  return made;
}

const Tool& tool_of(nb::handle self) { return *nb::cast<PyTool&>(self).tool; }

}  // namespace

void bind_tool(nb::module_& m) {
  nb::class_<PyTool>(m, "Tool", nb::is_weak_referenceable(),
                     R"(A rigid tool: its mesh and the spheres that fill it, in the tool frame T.

Immutable. Made by `pack`, `pack_file` or `load_tool`. Arrays are read-only views.)")
      .def_prop_ro(
          "spheres",
          [](nb::handle self) {
            const auto spheres = tool_of(self).spheres();
            static_assert(sizeof(Sphere) == 4 * sizeof(float));
            return view_of(&spheres.data()->center.x, {spheres.size(), 4}, self);
          },
          nb::sig("def spheres(self) -> numpy.typing.NDArray[numpy.float32]"),
          "(N, 4) float32: center x y z in T and radius of each sphere, m, in the order of the "
          "packing.")
      .def_prop_ro(
          "edges",
          [](nb::handle self) {
            auto& edges = nb::cast<PyTool&>(self).edges;
            if (edges == nullptr) {
              auto numbers = std::make_shared<std::vector<std::int32_t>>();
              for (const auto& [a, b] : tool_of(self).graph().edges()) {
                numbers->insert(numbers->end(), {a, b});
              }
              edges = std::move(numbers);
            }
            return view_of(edges->data(), {edges->size() / 2, 2}, self);
          },
          nb::sig("def edges(self) -> numpy.typing.NDArray[numpy.int32]"),
          "(E, 2) int32: neighboring spheres, each pair once, the lower index first.")
      .def_prop_ro(
          "volume", [](const PyTool& self) { return self.tool->mesh_mass().volume; },
          "Volume of the mesh, m3.")
      .def_prop_ro(
          "sphere_volume", [](const PyTool& self) { return self.tool->sphere_mass().volume; },
          "Volume of all spheres, m3.")
      .def_prop_ro(
          "center_of_mass",
          [](nb::handle self) {
            static_assert(sizeof(Vec3d) == 3 * sizeof(double));
            return view_of(&tool_of(self).sphere_mass().center_of_mass.x, {3}, self);
          },
          nb::sig("def center_of_mass(self) -> numpy.typing.NDArray[numpy.float64]"),
          "(3,) m in T: center of mass of the spheres, the reference point of all torques.")
      .def_prop_ro(
          "inertia",
          [](nb::handle self) {
            return view_of(&tool_of(self).sphere_mass().inertia.m[0][0], {3, 3}, self);
          },
          nb::sig("def inertia(self) -> numpy.typing.NDArray[numpy.float64]"),
          "(3, 3) kg m2 of the spheres at 1 kg/m3, about their center of mass, axes of T.")
      .def_prop_ro(
          "mesh",
          [](nb::handle self) {
            const TriangleMesh& mesh = tool_of(self).mesh();
            return nb::make_tuple(
                view_of(&mesh.vertices.data()->x, {mesh.vertices.size(), 3}, self),
                view_of(mesh.triangles.data()->data(), {mesh.triangles.size(), 3}, self));
          },
          nb::sig("def mesh(self) -> tuple[numpy.typing.NDArray[numpy.float64], "
                  "numpy.typing.NDArray[numpy.uint32]]"),
          "Vertices (V, 3) float64, m in T, and triangles (F, 3) uint32.")
      .def_prop_ro(
          "source", [](const PyTool& self) { return self.tool->source(); },
          "Origin of the mesh, e.g. its file name.")
      .def("__len__", [](const PyTool& self) { return self.tool->spheres().size(); })
      .def("__repr__",
           [](const PyTool& self) {
             char text[160];
             std::snprintf(text, sizeof text, "<palpate.Tool '%.60s': %zu spheres, %.4g cm3>",
                           self.tool->source().c_str(), self.tool->spheres().size(),
                           self.tool->mesh_mass().volume * 1e6);
             return std::string(text);
           })
      .def(
          "prefix",
          [](const PyTool& self, int num_spheres) {
            Result<Tool> tool = Error{};
            {
              const nb::gil_scoped_release no_gil;
              tool = self.tool->prefix(num_spheres);
            }
            return PyTool{std::make_shared<const Tool>(taken(std::move(tool)))};
          },
          nb::arg("spheres"), "A coarser tool: the first `spheres` spheres.")
      .def(
          "save",
          [](const PyTool& self, const std::filesystem::path& path) {
            Status status = Done{};
            {
              const nb::gil_scoped_release no_gil;
              status = save_tool(*self.tool, path);
            }
            check(status);
          },
          nb::arg("path"), "Writes a tool file (.palp), completely or not at all.");

  m.def(
      "load_tool",
      [](const std::filesystem::path& path) {
        Result<Tool> tool = Error{};
        {
          const nb::gil_scoped_release no_gil;
          tool = load_tool(path);
        }
        return PyTool{std::make_shared<const Tool>(taken(std::move(tool)))};
      },
      nb::arg("path"), "Reads a tool file (.palp). palpate.Error: not one, damaged, or newer.");

  m.def(
      "pack",
      [](nb::handle vertices, nb::handle triangles, int spheres, double scale, std::uint64_t seed,
         nb::object progress, int threads, nb::kwargs limits) {
        const TriangleMesh mesh = mesh_of(vertices, triangles, scale);
        return packed(mesh, request_of(spheres, seed, threads, limits), progress, "mesh");
      },
      nb::arg("vertices"), nb::arg("triangles"), nb::arg("spheres") = 5000, nb::kw_only(),
      nb::arg("scale") = 1.0, nb::arg("seed") = 0, nb::arg("progress") = nb::none(),
      nb::arg("threads") = 0, nb::arg("limits"),
      nb::sig("def pack(vertices: palpate._types.Array, triangles: palpate._types.Array, "
              "spheres: int = 5000, *, scale: float = 1.0, seed: int = 0, "
              "progress: palpate._types.Progress | None = None, threads: int = 0, "
              "**limits: float) -> Tool"),
      R"(Fills a solid with disjoint spheres.

vertices: (V, 3) float; times `scale` they are meters in the tool frame T.
triangles: (F, 3) int, counter-clockwise seen from outside; they must enclose a solid.
spheres: maximum number of spheres.
seed: jitters the starting grid.
progress: called a few times a second as progress(spheres, fill, last_radius in m); False ends it.
threads: 0: one per core; the result has the same bits for any number.
limits: further ones of docs/settings.md [packing]: standoff, max_radius, min_radius, max_fill, max_seconds.

Releases the GIL; Ctrl-C ends it. palpate.Error: not a solid, with the defect and its place.)");

  m.def(
      "pack_file",
      [](const std::filesystem::path& path, int spheres, const std::string& unit, double scale,
         std::uint64_t seed, nb::object progress, int threads, nb::kwargs limits) {
        const double meters = meters_of(unit) * scale;
        Result<TriangleMesh> mesh = Error{};
        {
          const nb::gil_scoped_release no_gil;
          mesh = load_mesh(path, meters);
        }
        if (!mesh) raise(mesh.error());
        return packed(*mesh, request_of(spheres, seed, threads, limits), progress,
                      path.filename().string());
      },
      nb::arg("path"), nb::arg("spheres") = 5000, nb::kw_only(), nb::arg("unit") = "m",
      nb::arg("scale") = 1.0, nb::arg("seed") = 0, nb::arg("progress") = nb::none(),
      nb::arg("threads") = 0, nb::arg("limits"),
      nb::sig("def pack_file(path: str | os.PathLike[str], spheres: int = 5000, *, "
              "unit: str = 'm', scale: float = 1.0, seed: int = 0, "
              "progress: palpate._types.Progress | None = None, threads: int = 0, "
              "**limits: float) -> Tool"),
      R"(Fills the solid of a mesh file (OBJ, STL, PLY, OFF, glTF, GLB) with disjoint spheres.

unit: of its coordinates: "m", "mm", "cm" or "in". See `pack` for the other parameters.)");
  nb::class_<PyBody>(m, "Body",
                     R"(A fixed rigid body, for Contact.measure_batch.

shape: a Tool with a distance field; without one (older files) it is computed now, in about a second.
pose: X_WB, (4, 4) or (7,) tx ty tz qx qy qz qw, m; None: its frame is W. Bodies made by `at` share the
data of their shape.)")
      .def(
          "__init__",
          [](PyBody* self, const PyTool& shape, nb::handle pose) {
            const Pose X_WB = pose.is_none() ? Pose{} : pose_of(pose, "pose");
            const PyTool held = shape;
            const nb::gil_scoped_release no_gil;
            new (self) PyBody{held, {ToolIndex::create(*held.tool), X_WB}};
          },
          nb::arg("shape"), nb::arg("pose") = nb::none(),
          nb::sig(
              "def __init__(self, shape: Tool, pose: palpate._types.Array | None = None) -> None"))
      .def(
          "at",
          [](const PyBody& self, nb::handle pose) {
            return PyBody{self.shape, {self.placed.shape, pose_of(pose, "pose")}};
          },
          nb::arg("pose"), nb::sig("def at(self, pose: palpate._types.Array) -> Body"),
          "The same shape at another pose X_WB.")
      .def_prop_ro(
          "shape", [](const PyBody& self) { return self.shape; }, "The Tool with its shape.");
}

}  // namespace palpate::python
