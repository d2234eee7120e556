// palpate.Robot: links with spheres, asked in scenes by the positions of their joints.
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <memory>

#include "python/src/contact.h"
#include "python/src/made_array.h"
#include "python/src/robot.h"

namespace palpate::python {
namespace {

nb::object measure(PyRobot& self, nb::handle scene, nb::handle joints, double margin, bool contact,
                   bool clearance, double limit, const std::string& limits) {
  const HeldScene in = held_scene(scene);
  const GivenJoints given(self, joints, limits);
  const int gpu = given.poses.gpu;
  const std::size_t n = self.robot().joints().size(), num = given.num,
                    num_links = self.robot().links().size();
  nb::dict found;
  const auto make = [&]<class T>(const char* name, T*& to,
                                 std::initializer_list<std::size_t> shape) {
    Made<T> made(gpu, shape);
    to = made.at;
    found[name] = made.array;
  };
  RobotAnswers to;
  const Made<std::uint8_t> held(gpu, {num});
  to.held = held.at;
  if (clearance) {
    make("clearance", to.clearance, {num});
    make("link", to.link, {num});
    make("clearance_by_joint", to.clearance_by_joint, {num, n});
    to.clearance_limit = limit;
  }
  if (contact) {
    make("volume", to.volume, {num});
    make("wrench", to.wrench, {num, num_links, 6});
    make("joint_torque", to.joint_torque, {num, n});
    if (!in.scene.surfaces.empty()) make("unseen", to.unseen, {num});
  }
  check(self.alone([&](const RobotContact& all) {
    if (const Status status = given.wait(); !status) return status;
    return all.measure(in.scene, given.poses, to);
  }));
  found["held"] = held.bools(gpu);
  if (clearance && gpu == kHostMemory) {
    const Made<std::uint8_t> hits(gpu, {num});
    for (std::size_t i = 0; i < num; ++i) hits.at[i] = to.clearance[i] < margin ? 1 : 0;
    found["any"] = hits.bools(gpu);
  }
  return nb::module_::import_("types").attr("SimpleNamespace")(**found);
}

nb::object any(PyRobot& self, nb::handle scene, nb::handle joints, double margin,
               const std::string& limits) {
  const HeldScene in = held_scene(scene);
  const GivenJoints given(self, joints, limits);
  const Made<std::uint8_t> hits(given.poses.gpu, {given.num});
  check(self.alone([&](const RobotContact& all) {
    if (const Status status = given.wait(); !status) return status;
    return all.any(in.scene, given.poses, margin, hits.at);
  }));
  return hits.bools(given.poses.gpu);
}

nb::object free_motions(PyRobot& self, nb::handle scene, nb::handle from, nb::handle to,
                        std::optional<double> margin, const std::string& limits) {
  const HeldScene in = held_scene(scene);
  const GivenJoints starts(self, from, limits);
  const Doubles ends = joints_of(self, to, "end");
  const std::size_t num = starts.num;
  std::vector<std::uint8_t> is_free(num);
  std::vector<double> until(num);
  check(self.alone([&](const RobotContact& all) {
    return all.free_motions(in.scene, starts.poses, {ends.data(), ends.size()},
                            margin.value_or(self.robot().standoff()), is_free.data(), until.data());
  }));
  return nb::make_tuple(array_of(std::move(is_free), {num}).attr("view")("bool"),
                        array_of(std::move(until), {num}));
}

nb::object place(const PyRobot& self, nb::handle given) {
  const Doubles joints = joints_of(self, given, "joints");
  const std::size_t n = self.robot().joints().size(), num = joints.size() / n,
                    num_links = self.robot().links().size();
  std::vector<Pose> X_WL(num * num_links);
  for (std::size_t i = 0; i < num; ++i) {
    check(self.robot().place({joints.data() + i * n, n}, self.X_WB,
                             std::span(X_WL).subspan(i * num_links, num_links)));
  }
  std::vector<double> sevens;
  for (const Pose& X : X_WL) {
    const Vec3d& p = X.translation;
    const Quaternion& q = X.rotation;
    sevens.insert(sevens.end(), {p.x, p.y, p.z, q.x, q.y, q.z, q.w});
  }
  return array_of(std::move(sevens), {num, num_links, 7});
}

/// Returns the image without the robot, of the type that was given.
nb::object remove_from(const PyRobot& self, nb::handle depth, const PyCamera& camera,
                       nb::handle given, double padding) {
  const Doubles joints = joints_of(self, given, "joints");
  nb::object plain = plain_image(depth);
  const nb::module_ numpy = nb::module_::import_("numpy");
  const bool is_counts = nb::cast<std::string>(plain.attr("dtype").attr("name")) == "uint16";
  constexpr double kMillimeter = 1e-3, kFarthest = 65;  // m, for the mask alone
  if (!is_counts) {
    plain = numpy.attr("clip")(numpy.attr("nan_to_num")(plain), 0, kFarthest);
    plain = numpy.attr("ceil")(plain.attr("__truediv__")(kMillimeter));
  }
  using Counts = nb::ndarray<const std::uint16_t, nb::c_contig, nb::device::cpu>;
  const auto counts = nb::cast<Counts>(numpy.attr("ascontiguousarray")(plain, "uint16"));
  const Intrinsics& k = camera.camera.intrinsics;
  const auto wide = static_cast<std::size_t>(camera.camera.width),
             high = static_cast<std::size_t>(camera.camera.height);
  if (counts.ndim() != 2 || counts.shape(0) != high || counts.shape(1) != wide) {
    refuse_shape(
        "depth", shape_of(counts),
        ("(" + std::to_string(high) + ", " + std::to_string(wide) + "), that of the camera")
            .c_str());
  }
  if (camera.camera.distortion != Distortion{}) {
    throw nb::value_error("camera: it has distortion; undistort the image, and give its camera");
  }
  DepthFrame frame;
  frame.height = static_cast<int>(counts.shape(0));
  frame.width = static_cast<int>(counts.shape(1));
  frame.unit = is_counts ? camera.unit : kMillimeter;
  frame.X_WC = camera.X_WC;
  frame.pixels.assign(counts.data(), counts.data() + counts.size());
  check(self.robot().remove_from(frame, k, {joints.data(), joints.size()}, self.X_WB, padding));
  const std::size_t height = counts.shape(0), width = counts.shape(1);
  nb::object left = array_of(std::move(frame.pixels), {height, width});
  return numpy.attr("where")(left.attr("__gt__")(0), depth, 0)
      .attr("astype")(nb::handle(depth).attr("dtype"));
}

Robot opened(const std::filesystem::path& path, const RobotPacking& packing) {
  Result<Robot> robot = Error{};
  {
    const nb::gil_scoped_release no_gil;
    robot = Robot::open(path, packing);
  }
  Robot made = taken(std::move(robot));
  for (const std::string& note : made.notes()) {
    if (PyErr_WarnEx(PyExc_UserWarning, note.c_str(), 2) != 0) throw nb::python_error();
  }
  return made;
}

RobotGeometry geometry_of(const std::string& word) {
  if (word == "collision") return RobotGeometry::collision;
  if (word == "visual") return RobotGeometry::visual;
  throw nb::value_error(("geometry: '" + word + "' is not collision or visual").c_str());
}

nb::object limits_of(const PyRobot& self) {
  std::vector<double> limits;
  for (const Robot::Joint& joint : self.robot().joints()) {
    limits.insert(limits.end(), {joint.lower, joint.upper});
  }
  const std::size_t n = limits.size() / 2;
  return array_of(std::move(limits), {n, 2});
}

std::vector<std::string> joint_names(const PyRobot& self) {
  std::vector<std::string> names;
  for (const Robot::Joint& joint : self.robot().joints()) names.push_back(joint.name);
  return names;
}

std::vector<PyTool> tools_of(const PyRobot& self) {
  std::vector<PyTool> tools;
  for (std::size_t i = 0; i < self.robot().links().size(); ++i) {
    tools.push_back({std::make_shared<const Tool>(self.robot().tool(i))});
  }
  return tools;
}

}  // namespace

void bind_robot(nb::module_& m) {
  const std::string array = "palpate._types.Array";
  const std::string scene =
      "scene: Scene | Surface | Body | collections.abc.Sequence[Surface | Body], ";
  const std::string bools = "numpy.typing.NDArray[numpy.bool_]";
  nb::class_<PyRobot>(m, "Robot",
                      R"(A robot whose links are filled with spheres, measured in scenes.

path: a URDF, which is packed, or a robot that `save` or `palpate pack --robot` wrote.
standoff: m, of the surface of a link from the nearest sphere; spheres: at most so many in a shape.
geometry: "collision" or "visual"; skip: links without spheres; packages: folders for package://,
    separated by ":". base: X_WB, (4, 4) or (7,). place: "cpu", "cuda" or "cuda:1", where the clearance
    and `any` place the links, too; they take joints there (float64, DLPack), and answer there.
    threads: of the CPU; 0: one per core.
A link that cannot be filled is left out, and one that is thin may miss the standoff: a warning each.
palpate.Error: what is wrong in the file.
Configurations are (P, n): a number for each of joint_names, rad and m. Those beyond limits are held
there (`held`), or with limits="refuse" a palpate.Error, as are numbers that are not finite.)")
      .def(
          "__init__",
          [](PyRobot* self, const std::filesystem::path& path, double standoff, int spheres,
             const std::string& geometry, const std::vector<std::string>& skip,
             const std::string& packages, nb::handle base, const std::string& place_word,
             int threads) {
            const Pose X_WB = base.is_none() ? Pose{} : pose_of(base, "base");
            RobotPacking packing;
            packing.standoff = standoff;
            packing.max_spheres = spheres;
            packing.geometry = geometry_of(geometry);
            packing.skip = skip;
            packing.packages = packages;
            const int num = checked_threads(threads);
            new (self) PyRobot(opened(path, packing), X_WB, place_of(place_word), num);
          },
          nb::arg("path"), nb::kw_only(), nb::arg("standoff") = 0.01, nb::arg("spheres") = 500,
          nb::arg("geometry") = "collision", nb::arg("skip") = std::vector<std::string>(),
          nb::arg("packages") = "", nb::arg("base") = nb::none(), nb::arg("place") = "cpu",
          nb::arg("threads") = 0,
          nb::sig(
              "def __init__(self, path: str | os.PathLike[str], *, standoff: float = 0.01, "
              "spheres: int = 500, geometry: str = 'collision', "
              "skip: collections.abc.Sequence[str] = (), packages: str = '', "
              "base: palpate._types.Array | None = None, place: str = 'cpu', threads: int = 0) -> "
              "None"))
      .def("measure", measure, nb::arg("scene"), nb::arg("joints"), nb::arg("margin") = 0.0,
           nb::kw_only(), nb::arg("contact") = true, nb::arg("clearance") = true,
           nb::arg("limit") = kClearanceLimit, nb::arg("limits") = "hold",
           nb::sig(("def measure(self, " + scene + "joints: " + array +
                    ", margin: float = 0.0, *, contact: bool = True, clearance: bool = True, "
                    "limit: float = 0.1, limits: str = 'hold') -> types.SimpleNamespace")
                       .c_str()),
           R"(Measures configurations: arrays with a row for each.

clearance (P,) m from -`limit` to `limit`, any (P,) below `margin`, link (P,) that decides (of
link_names; -1: none is nearer than `limit`), clearance_by_joint (P, n); with contact: volume (P,) m3, wrench (P, L, 6) on each link about
its center of mass in W (m3, m4), joint_torque (P, n) = J^T of them, unseen (P,) share; held (P,).
Of joints on a GPU with contact=False alone, without `any`.)")
      .def("any", any, nb::arg("scene"), nb::arg("joints"), nb::arg("margin") = 0.0, nb::kw_only(),
           nb::arg("limits") = "hold",
           nb::sig(("def any(self, " + scene + "joints: " + array +
                    ", margin: float = 0.0, *, limits: str = 'hold') -> " + bools)
                       .c_str()),
           "(P,) whether the robot comes nearer than `margin` (m): several times faster.")
      .def(
          "free_motions", free_motions, nb::arg("scene"), nb::arg("start"), nb::arg("end"),
          nb::arg("margin") = nb::none(), nb::kw_only(), nb::arg("limits") = "hold",
          nb::sig(("def free_motions(self, " + scene + "start: " + array + ", end: " + array +
                   ", margin: float | None = None, *, limits: str = 'hold') -> tuple[" + bools +
                   ", numpy.typing.NDArray[numpy.float64]]")
                      .c_str()),
          R"(Whether straight motions between configurations are free, and until what share: (P,), (P,).

Proved by the clearance, not sampled: `any` is False at every point of a free one. margin: m, 0 or more;
None: the standoff. A motion that comes nearer to the margin than about 4 mm at 1 m is not proved.
palpate.Error: a scene with CAD bodies, whose distance is sampled: check samples with `any`; a motion of
more than 100 rad or m.)")
      .def("place", place, nb::arg("joints"),
           nb::sig(("def place(self, joints: " + array + ") -> numpy.typing.NDArray[numpy.float64]")
                       .c_str()),
           "X_WL of the links: (P, L, 7) tx ty tz qx qy qz qw.")
      .def(
          "remove_from", remove_from, nb::arg("depth"), nb::arg("camera"), nb::arg("joints"),
          nb::arg("padding") = 0.02,
          nb::sig(("def remove_from(self, depth: " + array + ", camera: Camera, joints: " + array +
                   ", padding: float = 0.02) -> numpy.ndarray")
                      .c_str()),
          R"(The image without what shows the robot, with a padding (m, 0 to 0.1), or lies behind it: 0 there.

ValueError: another size than the camera's; a camera with distortion: undistort the image first.)")
      .def(
          "with_tool",
          [](const PyRobot& self, const PyTool& tool, const std::string& name,
             const std::string& link, nb::handle pose) {
            const Pose X_LT = pose.is_none() ? Pose{} : pose_of(pose, "pose");
            return std::make_unique<PyRobot>(
                taken(self.robot().with_tool(*tool.tool, name, link, X_LT)), self.X_WB,
                self.place(), self.threads());
          },
          nb::arg("tool"), nb::arg("name"), nb::arg("link"), nb::arg("pose") = nb::none(),
          nb::sig(("def with_tool(self, tool: Tool, name: str, link: str, pose: " + array +
                   " | None = None) -> Robot")
                      .c_str()),
          "The robot that holds a tool at X_LT: one more link, fixed to `link`.")
      .def(
          "save",
          [](const PyRobot& self, const std::filesystem::path& path) {
            check(self.robot().save(path));
          },
          nb::arg("path"), "Writes a packed robot (.palprobot), completely or not at all.")
      .def_prop_rw(
          "base", [](const PyRobot& self) { return seven_of(self.X_WB); },
          [](PyRobot& self, nb::handle pose) { self.X_WB = pose_of(pose, "base"); },
          nb::for_getter(nb::sig(array_property("base").c_str())),
          nb::for_setter(nb::sig(("def base(self, pose: " + array + ") -> None").c_str())),
          "X_WB, (7,) tx ty tz qx qy qz qw.")
      .def_prop_ro("joint_names", joint_names, "The n joints that are moved.")
      .def_prop_ro("joint_limits", limits_of, nb::sig(array_property("joint_limits").c_str()),
                   "(n, 2) lower and upper.")
      .def_prop_ro(
          "link_names",
          [](const PyRobot& self) {
            return std::vector<std::string>(self.robot().links().begin(),
                                            self.robot().links().end());
          },
          "The L links that have spheres.")
      .def_prop_ro("tools", tools_of, "Spheres and shapes of the L links.")
      .def_prop_ro(
          "standoff", [](const PyRobot& self) { return self.robot().standoff(); },
          "m: how far a surface is from the spheres of its link, at most.")
      .def_prop_ro(
          "notes", [](const PyRobot& self) { return self.robot().notes(); },
          "Links that are left out or miss the standoff, and why.")
      .def("__repr__", [](const PyRobot& self) {
        const Robot& robot = self.robot();
        return "<palpate.Robot '" + robot.name().substr(0, 60) +
               "': " + std::to_string(robot.joints().size()) + " joints, " +
               std::to_string(robot.links().size()) + " links, " +
               std::to_string(robot.num_spheres()) + " spheres>";
      });
}

}  // namespace palpate::python
