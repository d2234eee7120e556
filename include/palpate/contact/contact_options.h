// Contact methods with their options, requested outputs, and results of a measurement.
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

namespace palpate { inline namespace v0 {

/// Moments of the volume. Levers l_s go from the tool's center of mass to the spheres, in W.
struct VolumeMoments {
  double first[3][3] = {};  ///< sum of l_s (V_s n_s)^T, m4
  double polar = 0;         ///< sum of V_s |l_s x n_s|^2, plus the share of cut balls, m5
};

// Results of a measurement: volume, wrench, stiffness, and status bits.

/// Unusual conditions of a measurement.
enum class StepStatus : std::uint32_t {
  ok = 0,
  non_finite_pose = 1,    ///< the pose was not finite: no measurement, all zero
  ambiguous_normals = 2,  ///< a boundary sphere's points disagree (|mean normal| < 0.5)
  /// The GPU did not answer in time or is lost: no measurement, all zero. Permanent.
  backend_failed = 4,
  /// The method needs a cloud or a field, and the surface has none: no measurement against
  /// it.
  no_surface = 8,
  no_edge_vectors = 16,  ///< edges are enabled, but the cloud has no edge vectors: measured without
  /// The tool may extend outside of the window of the depth field (DepthFieldView::requested): no
  /// measurement against it.
  outside_window = 32,
};

/// A set of StepStatus bits.
struct ContactStatus {
  std::uint32_t bits = 0;

  constexpr ContactStatus() = default;
  constexpr ContactStatus(StepStatus one) : bits(static_cast<std::uint32_t>(one)) {}

  constexpr bool has(StepStatus one) const { return (bits & static_cast<std::uint32_t>(one)) != 0; }
  /// True if there was no measurement against the surface.
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

/// Newtons per volume times direction. In the thesis: the device's maximum force at an eighth of
/// the tool's volume.
struct VolumeStiffness {
  double newtons_per_cubic_meter = 0;

  /// N and N m.
  friend constexpr Wrench operator*(VolumeStiffness k, const VolumeWrench& measure) {
    return {measure.force * k.newtons_per_cubic_meter, measure.torque * k.newtons_per_cubic_meter};
  }
};

/// Space up to this depth behind a visible surface counts as seen, m.
inline constexpr double kSeenBehind = 0.02;

/// The measure at one pose.
struct Penetration {
  double volume = 0;  ///< m3: sum of V_s, separate from |force|
  /// force: sum V_s n_s; torque: sum (c_s - C) x V_s n_s about the tool's center of mass C; both in
  /// W. |force| <= volume for the point methods, <= 1.05 volume for field.
  VolumeWrench measure_W;
  /// field: U with measure_W = -dU/dpose if no gradient was shortened, m4; else 0
  double potential = 0;
  int num_boundary_spheres = 0;  ///< spheres that contain at least one point
  int num_inside_spheres = 0;    ///< untouched spheres with V_s > 0
  int num_points = 0;            ///< points inside some sphere
  ContactStatus status;
  /// field: the part of the tool more than kSeenBehind behind everything that any camera has seen,
  /// or outside of all images, m3. For a camera by itself only on request; else 0.
  double unseen_volume = 0;
};

/// Derivative of the measure by the pose. For a translation `shift` and a small rotation vector
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

/// Result of one measurement.
struct ContactResult {
  Penetration penetration;
  std::optional<Stiffness> stiffness;      ///< if requested and the method supports it
  VolumeMoments moments = {};              ///< together with the stiffness; else zero
  std::optional<MeasureNoise> noise = {};  ///< likewise; none if a camera's noise is unknown
};

/// Contact method: the source of the planes of spheres that no point touches.
enum class MethodKind {
  weighted,    ///< average over all boundary spheres (Alg. 3.3)
  simplified,  ///< the best boundary sphere only (Alg. 3.4)
  graph,       ///< along the leaf graph, away from the surface (Algs. 3.5-3.7)
  field,       ///< no points: every sphere evaluates the depth field (field/depth_field.h)
};
constexpr auto names_of(MethodKind) {
  return std::array{"weighted", "simplified", "graph", "field"};
}

/// Quality of a boundary sphere as a donor (it gives its plane to other spheres); d is the distance
/// of the centers. `simplified` takes the best one: the same for distance, square and gaussian. The
/// thesis has the first two and leaves the choice open (section 6).
enum class Priority {
  distance,   ///< 1 / d
  count,      ///< number of points inside the boundary sphere
  square,     ///< 1 / d^2
  gaussian,   ///< exp(-min(d^2 / 2 s^2, 40)), s a twelfth of the longest side of the tool's box
  agreement,  ///< a / d, a >= 0.001 the cosine between the sphere's normal and the direction to it
  path,       ///< 1 / the shortest path along the leaf graph; at most kMaxPathSpheres spheres
};
constexpr auto names_of(Priority) {
  return std::array{"distance", "count", "square", "gaussian", "agreement", "path"};
}
inline constexpr std::size_t kMaxPathSpheres = 4096;  ///< a table of 64 MB

/// Volume of a sphere that the graph search reaches.
enum class InsideVolume {
  full,  ///< the whole sphere (Alg. 3.7)
  cap,   ///< cut by the plane of its reference (footnote of Alg. 3.7)
};
constexpr auto names_of(InsideVolume) { return std::array{"full", "cap"}; }

/// Volume that a fully inside sphere counts.
enum class SphereVolumes {
  own,          ///< its own volume: all spheres together fill 80 to 90 % of the tool
  represented,  ///< the part of the tool that it represents: in total the volume of the mesh
};
constexpr auto names_of(SphereVolumes) { return std::array{"spheres", "represented"}; }

/// Handling of silhouettes. A camera does not see behind the end of a surface. An edge plane
/// (thesis section 3.5) through the viewing ray limits the planes of the surface there. Needs a
/// cloud with depth-change vectors.
enum class Edges {
  none,
  center,  ///< spheres whose center is beyond the edge take no plane
  strict,  ///< nor do spheres that the edge plane cuts
  cut,     ///< every sphere is cut by its surface plane and by the edge plane: continuous
};
constexpr auto names_of(Edges) { return std::array{"none", "center", "strict", "cut"}; }

/// Smoothing of the point methods when points enter and leave spheres. Kernel weights w = (1 - |p -
/// c|^2 / r^2)^2 vanish at the surface of a sphere with center c.
enum class Continuity {
  none,
  kernel,  ///< planes through weighted means; the priority `count` is the sum of the weights W
  /// A boundary sphere counts as one with weight W / (W + 1/4) only, as donor and for its own
  /// volume; for the rest it counts as untouched.
  entry,
  both,
};
constexpr auto names_of(Continuity) { return std::array{"none", "kernel", "entry", "both"}; }

/// Contact method between two bodies, see contact/body_contact.h.
enum class BodyMethod {
  /// The spheres of each evaluate the smooth distance field of the other (packing/packing.h), with
  /// represented volumes and the formulas of the depth field: faces are exact.
  field,
  /// Common volume of the spheres of both, tree against tree (thesis section
  /// 3.1.1).
  spheres,
};
constexpr auto names_of(BodyMethod) { return std::array{"field", "spheres"}; }

/// Contact method and all its options as settings, for files and command lines. See
/// contact_method.
struct ContactOptions {
  MethodKind method = MethodKind::field;
  Priority priority = Priority::distance;
  InsideVolume inside = InsideVolume::full;
  /// `represented` scales every V_s by represented / own volume of its sphere. nullopt: the default
  /// of the method, see `counted`.
  std::optional<SphereVolumes> volumes = std::nullopt;
  Edges edges = Edges::none;
  Continuity continuity = Continuity::none;
  BodyMethod bodies = BodyMethod::field;  ///< for CAD objects, with any method

  /// `field` measures the volume of the tool, the other methods that of its spheres.
  SphereVolumes counted() const {
    if (volumes) return *volumes;
    return method == MethodKind::field ? SphereVolumes::represented : SphereVolumes::own;
  }
  friend bool operator==(const ContactOptions&, const ContactOptions&) = default;
};
inline void add_settings(SettingTable& t, ContactOptions& o) {
  t.section("contact");
  t.add("method", o.method, "contact method: depth field, or points in the spheres");
  t.add("priority", o.priority, "ranking of donor spheres");
  t.add("inside", o.inside, "graph: volume of a reached sphere");
  t.add("volumes", o.volumes,
        "volume of a sphere: its own, or the part of the tool it represents (auto for "
        "field)");
  t.add("edges", o.edges, "handling of silhouettes, where a surface ends in front of another");
  t.add("continuity", o.continuity, "point methods: smoothing when points enter and leave spheres");
  t.add("bodies", o.bodies,
        "contact with objects: distance fields of their meshes, or sphere against "
        "sphere");
}

// A method together with its own options only.

/// Method `field`, the default: every sphere evaluates the depth field.
struct FieldMethod {
  SphereVolumes volumes = SphereVolumes::represented;
};
/// Method `weighted`: an untouched sphere takes a weighted mean over all touched spheres.
struct WeightedMethod {
  Priority priority = Priority::distance;
  SphereVolumes volumes = SphereVolumes::own;
  Edges edges = Edges::none;
  Continuity continuity = Continuity::none;
};
/// Method `simplified`: an untouched sphere takes the plane of the best touched sphere.
struct SimplifiedMethod {
  Priority priority = Priority::distance;
  SphereVolumes volumes = SphereVolumes::own;
  Edges edges = Edges::none;
  Continuity continuity = Continuity::none;
};
/// Method `graph`: a search along the leaf graph finds the spheres inside.
struct GraphMethod {
  InsideVolume inside = InsideVolume::full;
  SphereVolumes volumes = SphereVolumes::own;
  Edges edges = Edges::none;
  Continuity continuity = Continuity::none;
};
using ContactMethod = std::variant<FieldMethod, WeightedMethod, SimplifiedMethod, GraphMethod>;

/// Resets options that the method does not have to their defaults. Returns the names of those that
/// differed.
std::vector<std::string> drop_foreign_options(ContactOptions& options);
/// The method with its options. Error: an option that the method does not have was changed.
Result<ContactMethod> contact_method(const ContactOptions& options);
/// The inverse.
ContactOptions contact_options(const ContactMethod& method);

/// Penetration::volume when the whole tool is inside, m3.
inline double full_volume(const Tool& tool, SphereVolumes volumes) {
  return volumes == SphereVolumes::own ? tool.sphere_mass().volume : tool.mesh_mass().volume;
}
inline double full_volume(const Tool& tool, const ContactOptions& options) {
  return full_volume(tool, options.counted());
}

/// State of one sphere after a query, for display and tests.
enum class SphereState : std::uint8_t { outside, boundary, inside };

/// Optional outputs of a measurement, and their arrays.
struct ContactWants {
  bool stiffness = false;  ///< `field` only: closed-form stiffness and VolumeMoments
  bool noise = false;      ///< `field` only: by the noise of the cameras; the first one allocates
  /// Computes Penetration::unseen_volume also for a camera by itself. Without
  /// SurfaceView::seen_free: behind the surface of its own pixel, where that has none, or outside
  /// of the image. On a GPU one launch more.
  bool unseen_volume = false;
  /// State of each sphere; empty, or as many elements as the tool has spheres.
  std::span<SphereState> states{};
  /// In T, likewise: the plane that cuts a boundary sphere, or that an inside sphere takes from a
  /// donor; normal zero if there is none or, for `weighted` and Continuity::entry, many.
  std::span<Plane<float>> planes{};
  /// `field` only, likewise: the camera that determined the depth of each sphere in contact, by
  /// what it sees or remembers; kNoCamera outside of all images, and for spheres without contact. A
  /// single camera determines all.
  std::span<std::int8_t> deciders{};
  /// `field` only, for each sphere: 1 if its center is in the space of unseen_volume, else 0.
  std::span<std::uint8_t> unseen{};

  bool has_spheres() const {
    return !(states.empty() && planes.empty() && deciders.empty() && unseen.empty());
  }
};
inline constexpr std::int8_t kNoCamera = -1;

}}  // namespace palpate::v0
