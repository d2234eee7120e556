// How contact is measured, what may be asked, and what a measurement gives.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "palpate/core/core.h"
#include "palpate/math/geometry.h"
#include "palpate/settings/setting_table.h"
#include "palpate/tool/tool.h"

namespace palpate::inline v0 {

/// Levers l_s go from the tool's centre of mass to the spheres, in W.
struct VolumeMoments {
  double first[3][3] = {};  ///< sum of l_s (V_s n_s)^T, m4
  double polar = 0;  ///< sum of V_s |l_s x n_s|^2 and of what cut balls have of their own, m5
};

// What a measurement gives: volume, wrench, stiffness, and what the caller has to know about them.

/// Things a caller may want to know about a measurement.
enum class StepStatus : std::uint32_t {
  ok = 0,
  non_finite_pose = 1,    ///< the pose was not finite: nothing was measured, all zero
  ambiguous_normals = 2,  ///< a boundary sphere's points disagree (|mean normal| < 0.5)
  /// The GPU did not answer in time or is lost: nothing was measured, all zero. It stays so.
  backend_failed = 4,
  /// There is no surface of the kind that the method asks, a cloud or a field: nothing was measured
  /// against it.
  no_surface = 8,
  no_edge_vectors = 16,  ///< edges are wanted, but the cloud tells none: measured without
  /// Some of the tool may be seen outside of the window that the depth field was made for
  /// (DepthFieldView::asked): nothing was measured against it.
  outside_window = 32,
};

/// Any number of them.
struct ContactStatus {
  std::uint32_t bits = 0;

  constexpr ContactStatus() = default;
  constexpr ContactStatus(StepStatus one) : bits(static_cast<std::uint32_t>(one)) {}

  constexpr bool has(StepStatus one) const { return (bits & static_cast<std::uint32_t>(one)) != 0; }
  /// Whether the result says nothing about the surface.
  constexpr bool is_unmeasured() const {
    return has(StepStatus::non_finite_pose) || has(StepStatus::backend_failed) ||
           has(StepStatus::no_surface) || has(StepStatus::outside_window);
  }
  constexpr ContactStatus& operator|=(ContactStatus other) {
    bits |= other.bits;
    return *this;
  }
  friend constexpr bool operator==(ContactStatus, ContactStatus) = default;
};

/// Newtons per volume times direction. The thesis: the device's largest force at an eighth of the
/// tool's volume.
struct VolumeStiffness {
  double newtons_per_cubic_metre = 0;

  /// N and N m.
  friend constexpr Wrench operator*(VolumeStiffness k, const VolumeWrench& measure) {
    return {measure.force * k.newtons_per_cubic_metre, measure.torque * k.newtons_per_cubic_metre};
  }
};

/// What lies closer behind a seen surface counts as seen, m.
inline constexpr double kSeenBehind = 0.02;

/// The measure for one pose.
struct Penetration {
  double volume = 0;  ///< m3: sum of V_s, kept apart from |force|
  /// force: sum V_s n_s; torque: sum (c_s - C) x V_s n_s about the tool's centre of mass C; both in
  /// W. |force| <= volume for the point methods, 1.05 volume for field.
  VolumeWrench measure_W;
  /// field: U with measure_W = -dU/dpose where no gradient had to be shortened, m4; else 0
  double potential = 0;
  int num_boundary_spheres = 0;  ///< spheres that contain at least one point
  int num_inside_spheres = 0;    ///< untouched spheres with V_s > 0
  int num_points = 0;            ///< points inside some sphere
  ContactStatus status;
  /// field: the part of the tool that lies more than kSeenBehind behind all that any camera has
  /// seen, or where none looks, m3. Of a camera without SurfaceView::seen_free only if it was
  /// wanted; else 0.
  double unseen_volume = 0;
};

/// How the measure changes with the pose: moved by `shift` and turned by the small rotation vector
/// `turn` about C (both in W), (force, torque) becomes (force, torque) - m (shift, turn). Rows and
/// columns: x, y, z of force / shift, then of torque / turn. m2, m3 and m4.
struct Stiffness {
  double m[6][6] = {};

  Stiffness& operator+=(const Stiffness& other) {
    for (int row = 0; row < 6; ++row) {
      for (int column = 0; column < 6; ++column) m[row][column] += other.m[row][column];
    }
    return *this;
  }
};

struct ContactResult {
  Penetration penetration;
  std::optional<Stiffness> stiffness;  ///< if it was wanted and the method has one
  VolumeMoments moments = {};          ///< with the stiffness; else zero
};

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
  /// The spheres of each ask the smooth distance field of the other (packing/packing.h), with
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
  /// Penetration::unseen_volume also of a camera that has no SurfaceView::seen_free, on a CPU: what
  /// lies behind the surface of its own pixel, where that shows none, or outside of the image.
  bool unseen_volume = false;
  /// Of each sphere; empty if not wanted, else as many as the tool has spheres.
  std::span<SphereState> states{};
  /// In T, likewise: the plane that cuts a boundary sphere or that an inside sphere takes from a
  /// donor; normal zero if none or, by `weighted` and Continuity::entry, many.
  std::span<Plane<float>> planes{};
  /// Of each sphere that is felt, by `field`, which of the cameras of the call decided how deep it
  /// is, by what it sees or remembers; kNoCamera where none looks, and of spheres that are not
  /// felt. A camera that is alone decides all.
  std::span<std::int8_t> deciders{};
  /// Of each sphere, by `field`, whether its centre lies in what unseen_volume counts: 1, else 0.
  std::span<std::uint8_t> unseen{};

  bool has_spheres() const {
    return !(states.empty() && planes.empty() && deciders.empty() && unseen.empty());
  }
};
inline constexpr std::int8_t kNoCamera = -1;

/// How each sphere of a tool is, for pictures; see ContactWants.
struct SpherePicture {
  std::vector<SphereState> states;
  std::vector<Plane<float>> planes;
  std::vector<std::int8_t> deciders;
  std::vector<std::uint8_t> unseen;

  /// To be filled by a query of a tool of so many spheres.
  ContactWants wants(std::size_t num_spheres) {
    states.resize(num_spheres);
    planes.resize(num_spheres);
    deciders.resize(num_spheres);
    unseen.resize(num_spheres);
    return {.states = states, .planes = planes, .deciders = deciders, .unseen = unseen};
  }
};

}  // namespace palpate::inline v0
