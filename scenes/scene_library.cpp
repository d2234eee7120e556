#include <array>
#include <cmath>

#include "scenes/body_shapes.h"
#include "scenes/scene.h"
#include "scenes/tool_paths.h"
#include "scenes/truth.h"
#include "src/settings/internal/did_you_mean.h"

namespace palpate { inline namespace v0 { namespace scenes {
namespace {

double degrees(double angle) { return angle / 180 * kPi; }

Body still_body(std::string name, TriangleMesh mesh) {
  return {std::move(name), std::move(mesh), nullptr, {}};
}

Body moving_body(std::string name, TriangleMesh mesh, Pose (*motion)(double)) {
  return {std::move(name), std::move(mesh), motion, motion(0)};
}

/// A wall across the whole image.
TriangleMesh wall_at(double depth) { return block({-4, -3, depth}, {4, 3, depth + 0.1}); }

// ---- The synthetic environments of thesis section 5.1.2 ----

Scene thesis_scene(const std::string& name) {
  Scene scene;
  scene.environment = environment_of(name);
  for (const ThesisExperiment& experiment : thesis_experiments()) {
    if (experiment.scene != name) continue;
    scene.title =
        experiment.tool_shape + " into " + name + " (thesis Fig. " + experiment.figure + ")";
    scene.tool_shape = experiment.tool_shape;
    scene.tool_size = experiment.tool_size;
    set_path(scene, experiment);
    break;
  }
  if (scene.environment->kind == Environment::Kind::ball_outside) {
    scene.bodies.push_back(still_body("background", wall_at(3)));
  }
  return scene;
}

// ---- Rooms and bodies ----

/// Thesis Figs. 3.12-3.14: both sides of the pillar hide a part of the room.
Scene pillar() {
  Scene scene;
  scene.title = "box scrapes around the edge of a pillar in a room (thesis Figs. 3.12-3.14)";
  TriangleMesh room = block({-2, 0.6, 0}, {2, 0.7, 3});   // floor
  append(room, block({-2, -2, 2.4}, {2, 0.7, 2.5}));      // back
  append(room, block({-1.5, -2, 0}, {-1.4, 0.7, 2.45}));  // left
  append(room, block({1.4, -2, 0}, {1.5, 0.7, 2.45}));    // right
  TriangleMesh column = block({-0.11, -1.5, 1.0}, {0.11, 0.62, 1.22});
  append(column, block({-0.14, 0.5, 0.97}, {0.14, 0.62, 1.25}));  // plinth
  scene.bodies = {still_body("room", std::move(room)), still_body("pillar", std::move(column))};
  scene.tool_shape = "box";
  scene.tool_size = 0.08;
  Touch touch;
  touch.surface = [](double) { return Pose{{0.06, 0, 1}, {}}; };
  touch.reach = 0.04;
  touch.depth = 0.022;
  touch.slide = {0.09, 0.02, 0};
  touch.turn = degrees(25);
  touch.tilt = degrees(10);
  set_path(scene, touch);
  return scene;
}

/// Thesis Fig. 3.6 and the recordings of section 5.1: a tailor's dummy.
Scene mannequin() {
  Scene scene;
  scene.title = "spiral presses the chest of a mannequin on a table (thesis Fig. 3.6)";
  std::vector<Ellipsoid> masses = {
      {{0, 0.01, 1.10}, {0.160, 0.20, 0.105}},      // chest
      {{0, 0.22, 1.11}, {0.130, 0.16, 0.090}},      // waist
      {{0, -0.335, 1.095}, {0.070, 0.082, 0.088}},  // skull
      {{0, -0.285, 1.062}, {0.050, 0.065, 0.058}},  // face
  };
  std::vector<BallChain> limbs = {
      {{{-0.15, -0.10, 1.11}, 0.060}, {{0.15, -0.10, 1.11}, 0.060}},  // shoulders
      {{{0, -0.14, 1.12}, 0.062}, {{0, -0.27, 1.11}, 0.048}},         // neck
      {{{0, -0.325, 1.004}, 0.006}, {{0, -0.300, 0.999}, 0.010}},     // nose
  };
  for (const double side : {-1.0, 1.0}) {
    limbs.push_back({{{side * 0.185, -0.085, 1.11}, 0.055}, {{side * 0.215, 0.07, 1.11}, 0.045}});
    masses.push_back({{side * 0.07, -0.02, 1.05}, {0.085, 0.075, 0.060}});  // breast muscle
  }
  TriangleMesh bust = blended(limbs, masses, 0.03, 0.006);
  scene.bodies = {still_body("wall", wall_at(1.9)),
                  still_body("table", block({-0.8, 0.33, 0.8}, {0.8, 0.37, 1.6})),
                  still_body("mannequin", std::move(bust))};
  scene.tool_shape = "spiral";
  scene.tool_size = 0.1;
  Touch touch;
  touch.surface = [](double) { return Pose{{0.0, -0.02, 1.0}, {}}; };
  touch.reach = 0.05;
  touch.depth = 0.022;
  touch.slide = {0.05, 0.03, 0};
  touch.turn = degrees(40);
  touch.tilt = degrees(20);
  set_path(scene, touch);
  return scene;
}

/// Thesis Fig. 3.15a: wall and tool move towards each other.
Pose wall_motion(double t) { return {{0, 0, 1 - 0.03 * (1 - std::cos(kPi / 2 * t))}, {}}; }

Scene moving_wall() {
  Scene scene;
  scene.title = "wall moves towards the box and back (thesis Fig. 3.15)";
  scene.bodies = {moving_body("wall", wall_at(0), wall_motion)};
  scene.tool_shape = "box";
  scene.tool_size = 0.1;
  Touch touch;  // The tool's own part is slow; the wall of 1 s is where it touches.
  touch.surface = [](double) { return wall_motion(1); };
  touch.reach = 0.05;
  touch.depth = -0.01;
  touch.clearance = 0.05;
  touch.slide = {0.04, 0.02, 0};
  touch.turn = degrees(20);
  touch.tilt = degrees(4);
  set_path(scene, touch);
  return scene;
}

Pose box_motion(double t) {
  return {
      {0.12 * std::sin(kPi / 2 * t), 0.02 * std::sin(kPi * t), 1.0 + 0.03 * std::cos(kPi / 2 * t)},
      axis_angle({0.2, 1, 0}, 0.35 * std::sin(kPi / 2 * t))};
}

Scene moving_box() {
  Scene scene;
  scene.title = "ball presses a box that slides and turns";
  scene.bodies = {still_body("wall", wall_at(1.6)),
                  moving_body("box", block({-0.12, -0.09, -0.08}, {0.12, 0.09, 0.08}), box_motion)};
  scene.tool_shape = "sphere";
  scene.tool_size = 0.08;
  Touch touch;
  touch.surface = [](double t) { return box_motion(t) * Pose{{0, 0, -0.08}, {}}; };
  touch.reach = 0.04;
  touch.depth = 0.022;
  touch.slide = {0.06, 0.04, 0};
  touch.turn = degrees(30);
  set_path(scene, touch);
  return scene;
}

// ---- The demonstration: a living hand ----

/// An open hand, palm towards the camera, fingers up. Its frame: origin in the palm, axes as the
/// camera's.
TriangleMesh hand_mesh() {
  std::vector<BallChain> chains = {
      // Index, middle, ring and little finger, each from the wrist over knuckle and joints to the
      // tip.
      {{{-0.015, 0.044, 0.004}, 0.0145},
       {{-0.033, -0.040, 0.000}, 0.0116},
       {{-0.040, -0.081, -0.002}, 0.0098},
       {{-0.043, -0.104, -0.007}, 0.0086},
       {{-0.044, -0.122, -0.014}, 0.0072}},
      {{{-0.005, 0.044, 0.004}, 0.0145},
       {{-0.011, -0.046, -0.001}, 0.0118},
       {{-0.014, -0.091, -0.002}, 0.0100},
       {{-0.014, -0.118, -0.007}, 0.0088},
       {{-0.014, -0.138, -0.014}, 0.0074}},
      {{{0.006, 0.044, 0.004}, 0.0145},
       {{0.011, -0.043, 0.000}, 0.0114},
       {{0.015, -0.085, -0.002}, 0.0096},
       {{0.017, -0.110, -0.008}, 0.0084},
       {{0.018, -0.128, -0.016}, 0.0072}},
      {{{0.016, 0.044, 0.004}, 0.0145},
       {{0.031, -0.035, 0.002}, 0.0106},
       {{0.041, -0.067, 0.000}, 0.0087},
       {{0.046, -0.086, -0.005}, 0.0076},
       {{0.048, -0.101, -0.011}, 0.0064}},
      // Thumb with its ball, and the heel of the hand.
      {{{-0.016, 0.042, -0.001}, 0.0165},
       {{-0.038, 0.012, -0.009}, 0.0145},
       {{-0.062, -0.017, -0.015}, 0.0112},
       {{-0.076, -0.045, -0.018}, 0.0086}},
      {{{0.018, 0.036, 0.001}, 0.0160}, {{0.030, -0.008, 0.001}, 0.0125}},
  };
  // Wrist and forearm are wider than thick.
  for (const double side : {-1.0, 1.0}) {
    chains.push_back({{{side * 0.011, 0.040, 0.005}, 0.0170},
                      {{side * 0.0085, 0.080, 0.006}, 0.0185},
                      {{side * 0.0085, 0.20, 0.016}, 0.0270},
                      {{side * 0.0085, 0.33, 0.030}, 0.0320}});
  }
  const Ellipsoid palm{{0, 0.002, 0.002}, {0.038, 0.052, 0.0150}};
  return blended(chains, {&palm, 1}, 0.008, 0.0025);
}

/// Sways like a hand held out for inspection: slow, and never quite the same.
Pose hand_motion(double t) {
  const double sway = 2 * kPi * t;
  return {{0.03 * std::sin(0.30 * sway), 0.01 * std::sin(0.47 * sway + 1),
           0.55 + 0.02 * std::sin(0.40 * sway + 2)},
          normalized(axis_angle({0, 1, 0}, 0.25 * std::sin(0.23 * sway)) *
                     axis_angle({0, 0, 1}, 0.12 * std::sin(0.31 * sway + 0.5)) *
                     axis_angle({1, 0, 0}, 0.10 * std::sin(0.35 * sway + 1)))};
}

Scene hand() {
  Scene scene;
  scene.title = "stylus follows a moving hand and draws on its palm";
  scene.duration = 8;
  scene.bodies = {still_body("wall", wall_at(1.1)), moving_body("hand", hand_mesh(), hand_motion)};
  scene.tool_shape = "stylus";
  scene.tool_size = 0.12;
  Touch touch;
  touch.surface = [](double t) { return hand_motion(t) * Pose{{0, -0.005, -0.0135}, {}}; };
  // Held like a pen: the tip, at the lower end of the tool's z axis, points into the palm; the
  // other end leans to the lower right.
  touch.R_ST = axis_angle({0.6, -0.8, 0}, degrees(34)) * axis_angle({1, 0, 0}, kPi);
  touch.pivot = {0, 0, -scene.tool_size / 2};
  touch.depth = 0.018;
  touch.eight = {0.014, 0.008, 0};
  touch.turn = degrees(25);
  set_path(scene, touch);
  return scene;
}

struct NamedScene {
  std::string_view name;
  Scene (*make)();
};

constexpr std::array<NamedScene, 5> kScenes{{{"pillar", pillar},
                                             {"mannequin", mannequin},
                                             {"moving-wall", moving_wall},
                                             {"moving-box", moving_box},
                                             {"hand", hand}}};

Result<Scene> named(Scene scene, std::string_view name) {
  scene.name = name;
  return scene;
}

}  // namespace

std::vector<std::string> scene_names() {
  std::vector<std::string> names = environment_names();
  for (const NamedScene& scene : kScenes) names.emplace_back(scene.name);
  return names;
}

Result<Scene> make_scene(std::string_view name) {
  if (environment_of(name)) return named(thesis_scene(std::string(name)), name);
  for (const NamedScene& scene : kScenes) {
    if (scene.name == name) return named(scene.make(), name);
  }
  const std::string hint = did_you_mean(name, scene_names());
  std::string known;
  for (const std::string& scene : scene_names()) known += (known.empty() ? "" : ", ") + scene;
  return Error{Errc::not_found, "there is no scene '" + std::string(name) + "'" +
                                    (hint.empty() ? "; known are " + known : hint)};
}

void set_image_size(Scene& scene, int width, int height) {
  const double scale = static_cast<double>(width) / scene.width;
  scene.width = width;
  scene.height = height;
  scene.intrinsics = {scene.intrinsics.fx * scale, scene.intrinsics.fy * scale, (width - 1) / 2.0,
                      (height - 1) / 2.0};
}

}}}  // namespace palpate::v0::scenes
