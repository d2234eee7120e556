// Benefit and cost of several cameras, one CSV row for each case: mean and rms error of the volume
// against exact solids, angle of the force, largest step of the volume over the exact one, net work
// of a closed loop over all work, and the time of a query of one thread; and the cost of a memory.
//   depth_hull [--quick] [--only error|loop|cost|memory]
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <memory>
#include <optional>

#include "bench/harness.h"
#include "bench/hull_setup.h"
#include "palpate/contact/contact.h"

namespace palpate::bench {
namespace {

constexpr double kToolRadius = 0.03, kNoise = 0.0015;

ResultRows* rows = nullptr;
std::string case_of(const std::string& kind, const std::string& what, int num_cameras) {
  return kind + "/" + what + "/cameras:" + std::to_string(num_cameras);
}

/// Returns a ball packed with many equal spheres. A default packing of a ball is one sphere with
/// nearly all of the volume, and dust.
Tool ball_of_spheres() {
  return Tool::pack(make_icosphere(kToolRadius, 4), {.max_spheres = 5000, .max_radius = 0.003})
      .value();
}

std::unique_ptr<ContactQuery> query_of(const Tool& tool) {
  return make_contact_query(Place::cpu(), tool, FieldMethod{}).value();
}

/// Returns the share of the tool, a ball, inside a solid.
double true_share(const Solid& solid, const Vec3d& center) {
  int num = 0, num_inside = 0;
  test::for_points_in_ball(
      center, kToolRadius,
      [&](const Vec3d& p) {
        ++num;
        num_inside += solid.is_solid(p);
      },
      100000);
  return static_cast<double>(num_inside) / num;
}

/// Presses the tool in along the normal, beside it and back: errors of volume and direction.
void press(const Solid& solid, const Tool& tool, int num_cameras, int num_frames) {
  const auto query = query_of(tool);
  constexpr int kSteps = 60;
  double sum = 0, squares = 0, angle = 0, jump = 0, true_jump = 0;
  int num = 0, num_angles = 0;
  std::vector<double> truths;
  const auto place = [&](int i) {
    return solid.touched - kToolRadius * (-1.0 + 1.6 * i / (kSteps - 1)) * solid.normal;
  };
  for (int i = 0; i < kSteps; ++i) truths.push_back(true_share(solid, place(i)));
  for (int frame = 0; frame < num_frames; ++frame) {
    const test::HullScene scene =
        scene_of(solid, cameras_around(num_cameras), kNoise, static_cast<std::uint64_t>(frame));
    double last_felt = 0, last_true = 0;
    for (int i = 0; i < kSteps; ++i) {
      const Penetration felt = query->measure(scene.views, {place(i), {}}).penetration;
      const double share = felt.volume / tool.mesh_mass().volume;
      const double truth = truths[static_cast<std::size_t>(i)];
      sum += share - truth;
      squares += (share - truth) * (share - truth);
      ++num;
      if (truth > 0.02) {
        const double cosine = dot(normalized(felt.measure_W.force), solid.normal);
        angle += std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / kPi;
        ++num_angles;
      }
      if (i > 0) {
        jump = std::max(jump, std::abs(share - last_felt));
        true_jump = std::max(true_jump, std::abs(truth - last_true));
      }
      last_felt = share;
      last_true = truth;
    }
  }
  rows->add(
      case_of("error", solid.name, num_cameras),
      facts("volume_mean_percent=%.3f volume_rms_percent=%.3f direction_degrees=%.3f "
            "jump_over_exact=%.3f",
            100 * sum / num, 100 * std::sqrt(squares / num), angle / num_angles, jump / true_jump));
}

/// Moves the tool around a loop through the surface: net work over all work.
void loop(const Solid& solid, const Tool& tool, int num_cameras, double noise, int num_steps) {
  const auto query = query_of(tool);
  const test::HullScene scene = scene_of(solid, cameras_around(num_cameras), noise, 7);
  const Vec3d side = normalized(cross(solid.normal, {0, 1, 0.3}));
  double net = 0, all = 0;
  const auto place = [&](int i) {
    const double a = 2 * kPi * i / num_steps;
    return solid.touched + 0.02 * std::cos(a) * side - (0.01 + 0.015 * std::sin(a)) * solid.normal;
  };
  // Simpson's rule between every second place.
  for (int i = 0; i < num_steps; i += 2) {
    const Vec3d way = place(i + 2) - place(i);
    Vec3d force;
    for (int k = 0; k < 3; ++k) {
      const VolumeWrench at = query->measure(scene.views, {place(i + k), {}}).penetration.measure_W;
      force += (k == 1 ? 4.0 / 6 : 1.0 / 6) * at.force;
    }
    net += dot(force, way);
    all += std::abs(dot(force, way));
  }
  rows->add(case_of("loop", solid.name + (noise > 0 ? "" : "; exact images"), num_cameras),
            facts("loop_net_work=%.3g", std::abs(net) / all));
}

/// Times repeated calls of `work(i)`, microseconds.
template <class Work>
void time_of(const char* kind, const std::string& what, int num_cameras, double seconds,
             const Work& work) {
  std::vector<double> times;
  const Clock::time_point begin = Clock::now();
  for (std::size_t i = 0; times.size() < 50 || microseconds_since(begin) < 1e6 * seconds; ++i) {
    const Clock::time_point start = Clock::now();
    work(i);
    times.push_back(microseconds_since(start));
  }
  rows->times(case_of(kind, what, num_cameras), call_times(std::move(times)));
}

/// Returns poses of a ball at the surface at (0, 0, 1).
std::vector<Pose> poses_in_surface() {
  test::Random random(3);
  std::vector<Pose> poses;
  for (int i = 0; i < 100; ++i) {
    const double x = random.uniform(-0.1, 0.1), y = random.uniform(-0.1, 0.1);
    poses.push_back({{x, y, 1 - 0.8 * kToolRadius}, random.rotation(3)});
  }
  return poses;
}

/// Times a query of one thread.
void cost(const Tool& tool, int num_cameras, bool with_stiffness, double seconds) {
  const auto query = query_of(tool);
  const test::HullScene scene = scene_of(solids()[0], cameras_around(num_cameras), kNoise, 1);
  std::vector<SurfaceBlend> views = scene.views;
  // A single camera does not use the seen free space.
  if (num_cameras == 1) test::set_apart(views[0].from, views[0].to);
  const std::vector<Pose> poses = poses_in_surface();
  time_of("cost",
          std::to_string(tool.spheres().size()) + " spheres" +
              (with_stiffness ? " with stiffness" : ""),
          num_cameras, seconds, [&](std::size_t i) {
            query->measure(views, poses[i % poses.size()], {.stiffness = with_stiffness});
          });
}

/// Times a frame's surface and a query of one thread with a memory: with nothing before the wall,
/// and with a hand of 50 mm radius that hides the tool or is far from it; by one camera, and by
/// cameras 60 mm apart.
void memory(const Tool& tool, int num_cameras, DepthMemory kind, double seconds) {
  const auto query = query_of(tool);
  const std::vector<Pose> poses = poses_in_surface();
  struct Hand {
    const char* name;
    std::optional<Vec3d> at;
  };
  for (const Hand& hand : {Hand{"nothing in front", {}},
                           {"a hand in front", Vec3d{0, 0, 0.7}},
                           {"a hand beside", Vec3d{0.25, 0, 0.7}},
                           {"a hand at the tool", Vec3d{0, 0, 0.96}}}) {
    test::Random random(5);
    const Camera camera = test::vga();
    const auto frame = [&](bool has_hand, const Pose& X_WC) {
      std::vector<float> meters = test::depth_seen(
          [&](const Vec3d& p, const Vec3d& d) {
            const double wall = test::to_wall(p, d, 1);
            return has_hand && hand.at ? std::min(wall, test::to_ball(p, d, *hand.at, 0.05)) : wall;
          },
          camera, X_WC);
      for (float& z : meters) z += static_cast<float>(kNoise * random.normal());
      return meters;
    };
    TimeOptions time;
    time.memory.kind = kind;
    DepthFieldOptions field;
    field.one_of_several = num_cameras > 1;
    std::vector<SurfaceTimeline> timelines;
    std::vector<SurfaceBlend> views;
    std::vector<float> now;
    ThreadPool pool(1);
    double at = 0;
    Pose X_WC;
    const auto push = [&](SurfaceTimeline& timeline, const std::vector<float>& meters) {
      DepthImageView image(camera.width, camera.height, meters.data());
      image.X_WC = X_WC;
      timeline.push(image, at, pool);
      at += 1.0 / 30;
    };
    for (int k = 0; k < num_cameras; ++k) {
      X_WC = {{0.06 * k, 0, 0}, {}};
      timelines.push_back(
          SurfaceTimeline::create(test::stream_of(camera), {.field = field, .time = time}).value());
      const std::vector<float> before = frame(false, X_WC);
      now = frame(true, X_WC);
      for (int i = 0; i < 4; ++i) push(timelines.back(), before);
      for (int i = 0; i < 2; ++i) push(timelines.back(), now);
    }
    for (const SurfaceTimeline& timeline : timelines) {
      views.push_back({timeline.at(at).to, timeline.at(at).to, 1});
    }
    const std::string what = std::string(kind == DepthMemory::on ? "on" : "off") + "; " + hand.name;
    time_of("memory", "query; " + what, num_cameras, seconds,
            [&](std::size_t i) { query->measure(views, poses[i % poses.size()]); });
    time_of("memory", "surface; " + what, num_cameras, seconds,
            [&](std::size_t) { push(timelines.back(), now); });
  }
}

/// The same for a moving camera: it passes 40 times on an arc of 0.7 m before a ball and the
/// wall, and then stands at the middle of the arc.
void moving_memory(const Tool& tool, DepthMemory kind, double seconds) {
  const auto query = query_of(tool);
  const std::vector<Pose> poses = poses_in_surface();
  test::Random random(6);
  const Camera camera = test::vga();
  std::vector<DepthFrame> frames;
  for (int i = -7; i <= 7; ++i) {
    DepthFrame frame{camera.width, camera.height, 0.0001, {}, 0};
    frame.X_WC = test::look_at({0.05 * i, 0, 0}, {0, 0, 0.8});
    const auto ray = [](const Vec3d& p, const Vec3d& d) {
      return std::min(test::to_wall(p, d, 1), test::to_ball(p, d, {0.15, 0, 0.7}, 0.06));
    };
    for (const float z : test::depth_seen(ray, camera, frame.X_WC)) {
      const double seen = static_cast<double>(z) + kNoise * random.normal();
      frame.pixels.push_back(static_cast<std::uint16_t>(std::lround(seen / frame.unit)));
    }
    frames.push_back(std::move(frame));
  }
  DepthStreamInfo stream = test::stream_of(camera);
  stream.is_moving = true;
  TimeOptions time;
  time.memory.kind = kind;
  auto timeline = SurfaceTimeline::create(stream, {.time = time}).value();
  ThreadPool pool(1);
  double at = 0;
  const auto push = [&](std::size_t i) { timeline.push(frames[i], at += 1.0 / 30, pool); };
  const auto number = [&](std::size_t i) {
    return i / frames.size() % 2 == 0 ? i % frames.size() : frames.size() - 1 - i % frames.size();
  };
  for (std::size_t i = 0; i < 40 * frames.size(); ++i) push(number(i));
  push(frames.size() / 2);
  std::vector<SurfaceBlend> views{{timeline.at(at).to, timeline.at(at).to, 1}};
  for (SurfaceBlend view : timeline.key_frames()) {
    view.progress = 1;
    views.push_back(view);
  }
  const std::string what = std::string(kind == DepthMemory::on ? "on" : "off") + "; it moves, " +
                           std::to_string(views.size() - 1) + " frames kept";
  time_of("memory", "query; " + what, 1, seconds,
          [&](std::size_t i) { query->measure(views, poses[i % poses.size()]); });
  time_of("memory", "surface; " + what, 1, seconds, [&](std::size_t i) { push(number(i)); });
}

/// Times a camera that has turned once around in a room of 2 m and now looks to the side of the
/// tool: most of the remembered surface is away from the tool.
void looking_around(const Tool& tool, DepthMemory kind, double seconds) {
  const auto query = query_of(tool);
  const std::vector<Pose> poses = poses_in_surface();
  const Camera camera{320, 240, {262.5, 262.5, 159.5, 119.5}};
  DepthStreamInfo stream = test::stream_of(camera);
  stream.is_moving = true;
  TimeOptions time;
  time.memory.kind = kind;
  auto timeline = SurfaceTimeline::create(stream, {.time = time}).value();
  ThreadPool pool(1);
  test::Random random(7);
  double at = 0;
  const auto ray = [](const Vec3d& p, const Vec3d& d) {
    double t = 1e30;
    for (int axis = 0; axis < 3; ++axis) {
      for (const double wall : {-1.0, 1.0}) {
        if (d[axis] * wall > 1e-9) t = std::min(t, (wall - p[axis]) / d[axis]);
      }
    }
    return t;
  };
  for (int degrees = 0; degrees <= 360 + 90; degrees += 15) {
    const double a = degrees * kPi / 180;
    const Vec3d ahead{std::sin(a), 0, std::cos(a)};
    DepthFrame frame{camera.width, camera.height, 0.0001, {}, 0};
    frame.X_WC = test::look_at(0.02 * ahead, 1.02 * ahead);
    for (const float z : test::depth_seen(ray, camera, frame.X_WC)) {
      const double seen = static_cast<double>(z) + kNoise * random.normal();
      frame.pixels.push_back(static_cast<std::uint16_t>(std::lround(seen / frame.unit)));
    }
    timeline.push(frame, at += 1.0 / 30, pool);
  }
  std::vector<SurfaceBlend> views{{timeline.at(at).to, timeline.at(at).to, 1}};
  for (SurfaceBlend view : timeline.key_frames()) {
    view.progress = 1;
    views.push_back(view);
  }
  const std::string what = std::string(kind == DepthMemory::on ? "on" : "off") +
                           "; it looks elsewhere, " + std::to_string(views.size() - 1) +
                           " frames kept";
  time_of("memory", "query; " + what, 1, seconds,
          [&](std::size_t i) { query->measure(views, poses[i % poses.size()]); });
}

void run(bool is_quick, const std::string& only) {
  const auto wants = [&](const char* kind) { return only.empty() || only == kind; };
  const Tool tool = ball_of_spheres();
  for (const Solid& solid : solids()) {
    if (!wants("error")) break;
    for (const int num : {1, 2, 3, 4}) press(solid, tool, num, is_quick ? 4 : 10);
  }
  for (const Solid& solid : solids()) {
    if (!wants("loop")) break;
    for (const double noise : {kNoise, 0.0}) {
      for (const int num : {1, 2, 3}) loop(solid, tool, num, noise, is_quick ? 200 : 4000);
    }
  }
  for (const bool with_stiffness : {false, true}) {
    if (!wants("cost")) break;
    for (const int num : {1, 2, 3, 4}) cost(tool, num, with_stiffness, is_quick ? 0.1 : 2);
  }
  if (!wants("memory")) return;
  for (const int num : {1, 2}) {
    for (const DepthMemory kind : {DepthMemory::off, DepthMemory::on}) {
      memory(tool, num, kind, is_quick ? 0.1 : 2);
    }
  }
  for (const DepthMemory kind : {DepthMemory::off, DepthMemory::on}) {
    moving_memory(tool, kind, is_quick ? 0.1 : 2);
    looking_around(tool, kind, is_quick ? 0.1 : 2);
  }
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) {
  bool is_quick = false;
  std::string only;
  for (int i = 1; i < argc; ++i) {
    is_quick |= std::strcmp(argv[i], "--quick") == 0;
    if (std::strcmp(argv[i], "--only") == 0 && i + 1 < argc) only = argv[i + 1];
  }
  using namespace palpate::bench;
  ResultRows all(argc, argv);
  if (!all.open("")) return 1;
  rows = &all;
  run(is_quick, only);
}
