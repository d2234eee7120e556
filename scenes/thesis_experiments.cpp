// The synthetic setups of thesis section 5.1.2.
#include <array>

#include "scenes/truth.h"

namespace palpate { inline namespace v0 { namespace scenes {
namespace {

constexpr double kDepth = 1;               // Where every environment meets the optical axis.
constexpr double kFocalLength = 575.8157;  // Of the Kinect, for radii given in pixels.

double pixels_at_depth(double pixels) { return pixels / kFocalLength * kDepth; }

double degrees(double angle) { return angle / 180 * kPi; }

struct NamedEnvironment {
  std::string_view name;
  Environment (*make)();
};

constexpr std::array<NamedEnvironment, 11> kEnvironments{{
    {"wall", [] { return Environment::wall(kDepth); }},
    {"sphere-out-480", [] { return Environment::ball_outside(kDepth, pixels_at_depth(480)); }},
    {"sphere-out-320", [] { return Environment::ball_outside(kDepth, pixels_at_depth(320)); }},
    {"sphere-out-160", [] { return Environment::ball_outside(kDepth, pixels_at_depth(160)); }},
    {"sphere-in-480", [] { return Environment::ball_inside(kDepth, pixels_at_depth(480)); }},
    {"sphere-in-320", [] { return Environment::ball_inside(kDepth, pixels_at_depth(320)); }},
    {"sphere-in-160", [] { return Environment::ball_inside(kDepth, pixels_at_depth(160)); }},
    {"ridge-135", [] { return Environment::wedge(kDepth, degrees(135)); }},
    {"ridge-90", [] { return Environment::wedge(kDepth, degrees(90)); }},
    {"corner-225", [] { return Environment::wedge(kDepth, degrees(225)); }},
    {"corner-270", [] { return Environment::wedge(kDepth, degrees(270)); }},
}};

/// A tool of half length `reach` along z whose first contact is at z = `contact`.
ThesisExperiment experiment(std::string figure, std::string scene, std::string shape, double size,
                            double reach, const Quaternion& rotation = {},
                            double contact = kDepth) {
  return {std::move(figure),
          std::move(scene),
          std::move(shape),
          size,
          {{0, 0, contact - reach}, rotation},
          {{0, 0, kDepth + reach}, rotation}};
}

}  // namespace

std::vector<ThesisExperiment> thesis_experiments() {
  constexpr double kCube = 0.1, kOctahedron = 0.15, kTetrahedron = 0.15;
  const auto cube = [&](std::string figure, std::string scene) {
    // The inside of a ball is met by the corners of the cube's front face first.
    const Environment environment = *environment_of(scene);
    double contact = kDepth;
    if (environment.kind == Environment::Kind::ball_inside) {
      contact = environment.center.z +
                std::sqrt(environment.radius * environment.radius - kCube * kCube / 2);
    }
    return experiment(std::move(figure), std::move(scene), "box", kCube, kCube / 2, {}, contact);
  };
  // A tetrahedron moves edge first: a slow start, a steep middle, a slow end. The leading edge is
  // parallel to ridge and corner, and turns there from the bottom of the shape.
  const Quaternion edge_first =
      axis_angle({0, 1, 0}, std::atan2(std::sqrt(2.0 / 3.0), -std::sqrt(1.0 / 3.0)));
  const auto tetrahedron = [&](std::string figure, std::string scene) {
    return experiment(std::move(figure), std::move(scene), "tetrahedron", kTetrahedron,
                      kTetrahedron / std::sqrt(8.0), edge_first);
  };
  return {
      cube("5.18", "wall"),
      experiment("5.19", "wall", "octahedron", kOctahedron, kOctahedron / 2),
      cube("5.20a", "sphere-out-480"),
      cube("5.23", "sphere-out-320"),
      cube("5.24", "sphere-out-160"),
      cube("5.21", "sphere-in-480"),
      cube("5.22", "sphere-in-320"),
      cube("5.25", "sphere-in-160"),
      tetrahedron("5.27", "corner-225"),
      tetrahedron("5.26d", "corner-270"),
      tetrahedron("5.28", "ridge-135"),
      tetrahedron("5.29", "ridge-90"),
  };
}

std::optional<Environment> environment_of(std::string_view scene) {
  for (const NamedEnvironment& known : kEnvironments) {
    if (known.name == scene) return known.make();
  }
  return std::nullopt;
}

std::vector<std::string> environment_names() {
  std::vector<std::string> names;
  for (const NamedEnvironment& known : kEnvironments) names.emplace_back(known.name);
  return names;
}

}}}  // namespace palpate::v0::scenes
