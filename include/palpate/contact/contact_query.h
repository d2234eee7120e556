// How much of the tool is inside the scene, and the wrench that follows (thesis sections 3.2, 3.3).
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <variant>

#include "palpate/contact/contact_result.h"
#include "palpate/contact/tool_index.h"
#include "palpate/core/isa.h"
#include "palpate/core/result.h"
#include "palpate/core/thread_pool.h"
#include "palpate/field/surface_timeline.h"

namespace palpate {

/// How spheres that no point touches get their plane.
enum class MethodKind {
  weighted,    ///< average over all boundary spheres (Alg. 3.3)
  simplified,  ///< the best boundary sphere only (Alg. 3.4)
  graph,       ///< along the leaf graph, away from the surface (Algs. 3.5-3.7)
  field,       ///< no points at all: every sphere asks the depth field (field/depth_field.h)
};
constexpr auto names_of(MethodKind) {
  return std::array{"weighted", "simplified", "graph", "field"};
}

/// What makes a boundary sphere a good one to take a plane from; d is the distance of the centres.
/// `simplified` takes the best one: by distance, square and gaussian the same. The thesis has the
/// first two and leaves the choice open (section 6).
enum class Priority {
  distance,   ///< 1 / d
  count,      ///< number of points inside the boundary sphere
  square,     ///< 1 / d^2
  gaussian,   ///< exp(-min(d^2 / 2 s^2, 40)), s a twelfth of the longest side of the tool's box
  agreement,  ///< a / d, a >= 0.001 the cosine between the sphere's normal and the way to it
  path,       ///< 1 / the shortest way along the leaf graph; tools of at most kMostSpheresOfPaths
};
constexpr auto names_of(Priority) {
  return std::array{"distance", "count", "square", "gaussian", "agreement", "path"};
}
inline constexpr std::size_t kMostSpheresOfPaths = 4096;  ///< a table of 64 MB

/// Volume of a sphere that the graph reaches.
enum class InsideVolume {
  full,  ///< the whole sphere (Alg. 3.7)
  cap,   ///< cut by the plane of its reference (footnote of Alg. 3.7)
};
constexpr auto names_of(InsideVolume) { return std::array{"full", "cap"}; }

/// What a sphere that is wholly inside counts.
enum class SphereVolumes {
  own,          ///< its own volume: all spheres together fill 80 to 90 % of the tool
  represented,  ///< the part of the tool that it stands for: together the volume of the mesh
};
constexpr auto names_of(SphereVolumes) { return std::array{"spheres", "represented"}; }

/// Where the surface ends towards something farther away, a camera does not see what is behind the
/// edge: an edge plane (thesis section 3.5), which contains the viewing ray, keeps planes of the
/// surface from reaching beyond it. Needs a cloud with depth-change vectors.
enum class Edges {
  none,
  centre,  ///< nothing is taken by spheres with their centre beyond the edge
  strict,  ///< nor by spheres that the edge plane cuts
  cut,     ///< every sphere is cut by its surface plane and by the edge plane: continuous
};
constexpr auto names_of(Edges) { return std::array{"none", "centre", "strict", "cut"}; }

/// How the point-hit methods smooth over points that enter and leave spheres. Kernel weights
/// w = (1 - |p - c|^2 / r^2)^2 vanish at the rim of a sphere with centre c.
enum class Continuity {
  none,
  kernel,  ///< planes through weighted means; the priority `count` is the sum of the weights W
  /// A boundary sphere counts as one by W / (W + 1/4) only, as donor and for its own volume; for
  /// the rest it is as if no point touched it.
  entry,
  both,
};
constexpr auto names_of(Continuity) { return std::array{"none", "kernel", "entry", "both"}; }

/// How two bodies are measured against each other, see contact/body_contact.h.
enum class BodyMethod {
  /// The spheres of each ask the smooth distance field of the other (packing/solid_field.h), with
  /// represented volumes and the arithmetic of the depth field: faces are felt as they are.
  field,
  /// What the spheres of the one share with those of the other, tree against tree (thesis section
  /// 3.1.1).
  spheres,
};
constexpr auto names_of(BodyMethod) { return std::array{"field", "spheres"}; }

/// The method and its options as settings: files and command lines name them one by one. See
/// contact_method.
struct ContactOptions {
  MethodKind method = MethodKind::field;
  Priority priority = Priority::distance;
  InsideVolume inside = InsideVolume::full;
  /// `represented` scales every V_s by represented / own volume of its sphere. nullopt: as fits the
  /// method, see `counted`.
  std::optional<SphereVolumes> volumes = std::nullopt;
  Edges edges = Edges::none;
  Continuity continuity = Continuity::none;
  BodyMethod bodies = BodyMethod::field;  ///< of objects; of all methods

  /// The field measures the tool, the methods of the thesis measure its spheres.
  SphereVolumes counted() const {
    if (volumes) return *volumes;
    return method == MethodKind::field ? SphereVolumes::represented : SphereVolumes::own;
  }
  friend bool operator==(const ContactOptions&, const ContactOptions&) = default;
};
inline void add_settings(SettingTable& t, ContactOptions& o) {
  t.section("contact");
  t.add("method", o.method, "by the depth field, or by the points that are in the spheres");
  t.add("priority", o.priority, "what makes a boundary sphere a good reference");
  t.add("inside", o.inside, "graph: volume of a sphere that is reached");
  t.add("volumes", o.volumes,
        "what a sphere counts: itself, or the part of the tool that it stands for, which is auto "
        "for the field");
  t.add("edges", o.edges, "where the surface ends in front of something farther away");
  t.add("continuity", o.continuity,
        "how weighted, simplified and graph smooth over points that enter and leave spheres");
  t.add("bodies", o.bodies,
        "how objects are felt: by the distance fields of their meshes, or sphere against sphere");
}

/// A method with the options that it has, and no other.
struct FieldMethod {
  SphereVolumes volumes = SphereVolumes::represented;
};
struct WeightedMethod {
  Priority priority = Priority::distance;
  SphereVolumes volumes = SphereVolumes::own;
  Edges edges = Edges::none;
  Continuity continuity = Continuity::none;
};
struct SimplifiedMethod {
  Priority priority = Priority::distance;
  SphereVolumes volumes = SphereVolumes::own;
  Edges edges = Edges::none;
  Continuity continuity = Continuity::none;
};
struct GraphMethod {
  InsideVolume inside = InsideVolume::full;
  SphereVolumes volumes = SphereVolumes::own;
  Edges edges = Edges::none;
  Continuity continuity = Continuity::none;
};
using ContactMethod = std::variant<FieldMethod, WeightedMethod, SimplifiedMethod, GraphMethod>;

/// Options that the method does not have go to their defaults. Returns the names of those that did
/// not have them.
std::vector<std::string> drop_foreign_options(ContactOptions& options);
/// Error: an option that the method does not have is not at its default.
Result<ContactMethod> contact_method(const ContactOptions& options);
/// The way back.
ContactOptions contact_options(const ContactMethod& method);

/// What Penetration::volume is when the whole tool is inside, m3.
inline double full_volume(const Tool& tool, SphereVolumes volumes) {
  return volumes == SphereVolumes::own ? tool.sphere_mass().volume : tool.mesh_mass().volume;
}
inline double full_volume(const Tool& tool, const ContactOptions& options) {
  return full_volume(tool, options.counted());
}

/// State of one sphere after a query, for pictures and tests.
enum class SphereState : std::uint8_t { outside, boundary, inside };

/// What a measurement is to give beside the penetration, and where it goes.
struct ContactWants {
  /// By `field`, in closed form, with VolumeMoments; the other measures are not differentiable.
  bool stiffness = false;
  /// Of each sphere; empty if not wanted, else as many as the tool has spheres.
  std::span<SphereState> states{};
  /// In T, likewise: the plane that cuts a boundary sphere or that an inside sphere takes from a
  /// donor; normal zero if none or, by `weighted` and Continuity::entry, many.
  std::span<Plane<float>> planes{};
};

/// Measures one tool by one method. All memory is allocated at construction. One thread at a time.
class ContactQuery {
 public:
  virtual ~ContactQuery() = default;

  /// One measurement at a pose, in the world that SurfaceView::X_WC says. O(points in the tool's
  /// image window + spheres), with stiffness half as much more, with states or planes twice as
  /// much. No allocation, no lock. The same input gives the same bits, whatever was asked before
  /// and for any number of threads. A GPU may be given views of host memory and of other GPUs: they
  /// are copied once for each stamp, with memory for the first ones of their size.
  ContactResult measure(const SurfaceView& surface, const Pose& X_WT,
                        const ContactWants& wants = {}) const noexcept {
    return measure(surface, surface, 1, X_WT, wants);
  }
  /// Between two surfaces: (1 - alpha) times the measure against `from` and alpha times that
  /// against `to`, whose are counts, states and planes. Whatever changed between the two, the force
  /// so goes from the one to the other, and with `field` it is at every alpha the exact gradient of
  /// one potential. With alpha = 1 `from` is not looked at; else it takes up to twice as long.
  ContactResult measure(const SurfaceView& from, const SurfaceView& to, double alpha,
                        const Pose& X_WT, const ContactWants& wants = {}) const noexcept {
    const SurfaceBlend camera{from, to, alpha};
    return measure({&camera, 1}, X_WT, wants);
  }

  /// Against what all cameras together know: the depth hull (docs/decisions/0029-depth-hull.md). A
  /// sphere is as deep as the camera says that has it least deep; cameras that do not see it
  /// abstain. By the field, force and torque still are the exact derivatives of one potential. At
  /// most K times as long with K cameras, and what one of them sees free in front of its surface
  /// costs nothing more. One camera is measured against as by the other calls. No surface of any
  /// camera, more than kMostCameras, several without SurfaceView::seen_free, or several by a method
  /// of points (which take `joined_clouds`): StepStatus::no_surface.
  ContactResult measure(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                        const ContactWants& wants = {}) const noexcept;

  const ContactMethod& method() const { return method_; }
  /// For other queries and bodies of the same tool.
  const std::shared_ptr<const ToolIndex>& index() const { return index_; }

 protected:
  ContactQuery() = default;
  ContactQuery(std::shared_ptr<const ToolIndex> index, const ContactMethod& method)
      : index_(std::move(index)), method_(method) {}

  /// Between two surfaces of one camera, in its frame.
  virtual ContactResult measure_one(const SurfaceView& from, const SurfaceView& to, double alpha,
                                    const Pose& X_CT, const ContactWants& wants) const noexcept = 0;
  /// More than one camera, or one with a memory; the pose is finite.
  virtual ContactResult measure_hull(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                                     const ContactWants& wants) const noexcept;

 private:
  ContactResult measure_camera(const SurfaceBlend& camera, const Pose& X_WT,
                               const ContactWants& wants) const noexcept;
  ContactResult measure_alone(SurfaceBlend camera, const Pose& X_WT,
                              const ContactWants& wants) const noexcept;

  std::shared_ptr<const ToolIndex> index_;
  ContactMethod method_;
};

struct ExecutionOptions {
  Isa isa = best_isa();
  ThreadPool* pool = nullptr;  ///< used inside one query; null: the caller's thread alone
  int gpu = 0;                 ///< which one, for the CUDA backend
};

/// Errors: the backend is not in this build or on this machine.
Result<std::unique_ptr<ContactQuery>> make_contact_query(Backend backend,
                                                         std::shared_ptr<const ToolIndex> index,
                                                         const ContactMethod& method,
                                                         const ExecutionOptions& capacities = {});
/// The same with an index of its own. `tool` must outlive the query.
Result<std::unique_ptr<ContactQuery>> make_contact_query(Backend backend, const Tool& tool,
                                                         const ContactMethod& method = {},
                                                         const ExecutionOptions& capacities = {});
Result<std::unique_ptr<ContactQuery>> make_contact_query(Backend, const Tool&&,
                                                         const ContactMethod& = {},
                                                         const ExecutionOptions& = {}) = delete;

}  // namespace palpate
