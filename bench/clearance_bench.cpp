// Clearance and yes/no of many poses: rates on one core or a GPU, time to be ready for a frame, and
// how right they are against exact solids; contact with several cameras and bodies. One CSV row for
// each.
//   clearance_bench [--gpu] [--only rate|ready|scene|solids|free|one]
// With --gpu, `rate` and `scene` are measured on the first GPU, by the clock, from poses to results
// in host memory; `rate` also with all arrays on the GPU (/arrays-there), until the results are
// there.
#include <cmath>
#include <cstring>
#include <optional>

#include "bench/batch_setup.h"
#include "bench/harness.h"
#include "bench/hull_setup.h"
#include "bench/wall_frame.h"
#include "palpate/contact/scene.h"
#if defined(PALPATE_CUDA)
#include "src/gpu/internal/runtime.h"
#endif

namespace palpate::bench {
namespace {

constexpr double kNoise = 0.0015;
ResultRows* rows = nullptr;

double cpu_seconds() {
  std::timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// Returns the best time of a call, s: of the processor, since the machine is shared; with a GPU by
/// the clock.
template <class Work>
double best_time(int num, const Work& work, const Place& place = Place::cpu()) {
  const bool is_cpu = place.backend == Backend::cpu;
  double best = 1e9;
  for (int i = 0; i < num; ++i) {
    const auto begin = Clock::now();
    const double start = cpu_seconds();
    work();
    best = std::min(best, is_cpu ? cpu_seconds() - start : 1e-6 * microseconds_since(begin));
  }
  return best;
}

SceneContact contact_of(const Tool& tool, const Place& place = Place::cpu()) {
  const Tool* const one = &tool;
  return value_or_stop(SceneContact::create({&one, 1}, FieldMethod{}, place, 1));
}

struct SeenWall {
  explicit SeenWall(const Place& place = Place::cpu())
      : sensor(
            value_or_stop(Sensor::create({640, 480, frame.intrinsics}, place, {.num_threads = 1}))),
        scene{.surfaces = {sensor.update(frame.image())}} {}

  WallFrame frame{640, 480};
  Sensor sensor;
  Scene scene;
};

struct Found {
  explicit Found(std::size_t num) : clearance(num), gradient(6 * num), decided(num) {
    answers.clearance = clearance.data();
    answers.clearance_gradient = gradient.data();
    answers.decided = decided.data();
  }
  std::vector<double> clearance, gradient;
  std::vector<std::int32_t> decided;
  SceneAnswers answers;
};

#if defined(PALPATE_CUDA)
/// The same question as `rate` with poses and results in the memory of the GPU.
void rate_there(const SceneContact& contact, const Scene& scene, const std::vector<Pose>& poses,
                const Found& here, const std::string& tail, const Place& place) {
  const std::size_t num = poses.size();
  gpu::Memory memory(place.gpu);
  gpu::Stream stream(place.gpu, gpu::Priority::low);
  const CallerStream queue{stream.handle()};
  const ScenePoses there{{memory.copy_of(poses), num}, {}, {}, 0, place.gpu};
  SceneAnswers answers;
  answers.contact.gpu = place.gpu;
  answers.clearance = memory.take<double>(num);
  answers.clearance_gradient = memory.take<double>(6 * num);
  answers.decided = memory.take<std::int32_t>(num);
  auto* const hits = memory.take<std::uint8_t>(num);
  const auto require = [&](const Status& status) {
    if (!status) stop(status.error());
  };
  require(memory.status());
  const auto add = [&](const char* name, const auto& ask) {
    const double time = best_time(
        7,
        [&] {
          require(ask());
          require(stream.wait(60));
        },
        place);
    const double enqueued = best_time(
        7, [&] { require(ask()); }, place);
    require(stream.wait(60));
    const std::string row = name + tail + "/arrays-there";
    rows->add(row, static_cast<double>(num) / time, "poses/s", 5e7);
    rows->add(row + "/enqueue", facts("us=%.1f poses=%zu", 1e6 * enqueued, num));
  };
  add("clearance", [&] { return contact.measure(scene, there, answers, queue); });
  std::vector<double> fetched(num);
  stream.copy(fetched.data(), answers.clearance, num * sizeof(double));
  require(stream.wait(60));
  std::size_t num_other = 0;
  for (std::size_t i = 0; i < num; ++i) num_other += fetched[i] != here.clearance[i];
  rows->add("clearance" + tail + "/arrays-there/over-arrays-here",
            facts("other_bits=%zu poses=%zu", num_other, num));
  add("any", [&] { return contact.any(scene, there, 0.005, hits, queue); });
}
#endif

/// A finger at many poses: clearance with its gradient, and yes or no.
void rate(const Place& place) {
  const SeenWall seen(place);
  const SceneContact contact = contact_of(finger_tool(100), place);
  const int num = place.backend == Backend::cpu ? 100000 : 1 << 20;
  for (const Where where : {Where::view, Where::surface}) {
    const std::vector<Pose> poses = finger_poses(num, where);
    const bool is_view = where == Where::view;
    const std::string tail = std::string(is_view ? "/view" : "/surface") + "/spheres:100" +
                             (place.backend == Backend::cpu ? "" : "/gpu");
    Found found(poses.size());
    const auto require = [](const Status& status) {
      if (!status) stop(status.error());
    };
    const double clearance = best_time(
        7, [&] { require(contact.measure(seen.scene, {poses}, found.answers)); }, place);
    const bool is_gpu = place.backend != Backend::cpu;
    rows->add("clearance" + tail, num / clearance, "poses/s", is_gpu ? 5e7 : is_view ? 1e6 : 0.4e6);
    if (is_gpu) {
      const SeenWall seen_here;
      Found here(poses.size());
      require(contact_of(finger_tool(100)).measure(seen_here.scene, {poses}, here.answers));
      double difference = 0;
      for (std::size_t i = 0; i < poses.size(); ++i) {
        difference = std::max(difference, std::abs(found.clearance[i] - here.clearance[i]));
      }
      rows->add("clearance" + tail + "/over-cpu",
                facts("worst_difference_m=%.2g poses=%d", difference, num));
    }
    std::vector<std::uint8_t> hits(poses.size());
    const double any = best_time(
        7, [&] { require(contact.any(seen.scene, {poses}, 0.005, hits.data())); }, place);
    rows->add("any" + tail, num / any, "poses/s", is_gpu ? 5e7 : is_view ? 2e6 : 1e6);
#if defined(PALPATE_CUDA)
    if (is_gpu) rate_there(contact, seen.scene, poses, found, tail, place);
#endif
  }
}

/// Contact of 16,384 poses with three cameras and two bodies. On a GPU also its greatest difference
/// to that of the CPU.
void scene(const Place& place) {
  constexpr int kNum = 16384;
  const Tool& tool = finger_tool(1000);
  const std::vector<Pose> poses = finger_poses(kNum, Where::surface, 0.1);
  struct Results {
    std::vector<double> volume, force;
    double time = 0;
  };
  const auto measured = [&](const Place& at) {
    std::vector<Sensor> sensors;
    Scene scene;
    for (const Pose& X_WC : cameras_around(3)) {
      const std::vector<float> meters = test::depth_seen(solids().front().ray, test::vga(), X_WC);
      sensors.push_back(value_or_stop(
          Sensor::create(test::vga(), at, {.field = {.one_of_several = true}, .num_threads = 1})));
      scene.surfaces.push_back(sensors.back().update(DepthImageView(640, 480, meters.data())));
      scene.surfaces.back().X_WC = X_WC;
    }
    for (const double x : {-0.05, 0.05}) scene.bodies.emplace_back(tool, Pose{{x, 0, 0.97}, {}});
    const SceneContact contact = contact_of(tool, at);
    Results results{std::vector<double>(kNum), std::vector<double>(3 * kNum)};
    SceneAnswers answers;
    answers.contact.volume = results.volume.data();
    answers.contact.force = results.force.data();
    results.time = best_time(
        5,
        [&] {
          const Status status = contact.measure(scene, {poses}, answers);
          if (!status) stop(status.error());
        },
        at);
    return results;
  };
  const Results here = measured(place);
  double difference = 0;
  if (place.backend != Backend::cpu) {
    const Results expected = measured(Place::cpu());
    for (std::size_t i = 0; i < kNum; ++i) {
      difference = std::max(difference, std::abs(here.volume[i] - expected.volume[i]));
    }
  }
  rows->add("scene/cameras:3/bodies:2/spheres:1000/poses:16384" +
                std::string(place.backend == Backend::cpu ? "" : "/gpu"),
            facts("ms=%.3f poses_per_s=%.4g worst_volume_difference=%.2g of the tool",
                  1e3 * here.time, kNum / here.time, difference / tool.sphere_mass().volume));
}

/// A new stamp each time, so that nothing is kept.
void ready() {
  const SeenWall seen;
  const SceneContact contact = contact_of(finger_tool(100));
  Scene scene = seen.scene;
  const std::vector<Pose> pose(1);
  std::uint8_t hit = 0;
  scene.surfaces[0].field.stamp = 0;
  const double time = best_time(30, [&] { (void)contact.any(scene, {pose}, 0, &hit); });
  rows->add("ready/640x480", 1e3 * time, "ms", 3);
}

/// A ball before a wall: signed distance to both, without the shadow.
struct Solids {
  static constexpr double kRadius = 0.1, kWallDepth = 1.0;
  Vec3d ball{0.02, 0.01, 0.75};
  std::optional<Sensor> sensor;
  Scene scene;

  Solids() {
    const auto ray = [&](const Vec3d& p, const Vec3d& d) {
      return std::min(test::to_ball(p, d, ball, kRadius), test::to_wall(p, d, kWallDepth));
    };
    std::vector<float> meters = test::depth_seen(ray, test::vga(), {});
    test::Random random(3);
    for (float& z : meters) z += static_cast<float>(kNoise * random.normal());
    sensor.emplace(value_or_stop(Sensor::create(test::vga(), Place::cpu(), {.num_threads = 1})));
    scene.surfaces = {sensor->update(DepthImageView(640, 480, meters.data()))};
  }

  /// Distance to the solids and to the shadow of the ball, a cone from the eye beyond it.
  double to_hull(const Vec3d& p) const {
    const double to_ball = norm(p - ball) - kRadius, to_wall = kWallDepth - p.z;
    const Vec3d axis = normalized(ball);
    const double along = dot(p, axis), across = norm(p - along * axis);
    const double sine = kRadius / norm(ball), cosine = std::sqrt(1 - sine * sine);
    // On the cone: the foot lies behind the rim, where the ray touches the ball.
    const double foot = along * cosine + across * sine, rim = norm(ball) * cosine;
    const double to_cone = across * cosine - along * sine;
    double least = std::min(to_ball, to_wall);
    if (foot > rim) least = std::min(least, to_cone);
    return least;
  }
};

void exact_solids() {
  const Solids solids;
  SpherePacking packing;
  packing.spheres = {{{}, 0.004f}};
  const Tool tool = value_or_stop(Tool::build(make_icosphere(0.00401, 3), packing));
  const SceneContact contact = contact_of(tool);
  test::Random random(5);
  for (const double reach : {0.02, 0.1}) {
    std::vector<Pose> poses;
    std::vector<double> exact;
    while (poses.size() < 20000) {
      const double x = random.uniform(-0.25, 0.25), y = random.uniform(-0.2, 0.2);
      const Vec3d p{x, y, random.uniform(0.5, 0.99)};
      const double phi = solids.to_hull(p) - 0.004;
      if (!(phi > 0 && phi < reach)) continue;
      poses.push_back({p, {}});
      exact.push_back(phi);
    }
    Found found(poses.size());
    found.answers.clearance_limit = 0.15;
    if (!contact.measure(solids.scene, {poses}, found.answers)) std::abort();
    double squares = 0, worst = 0;
    int num_above = 0, num_below = 0;
    for (std::size_t i = 0; i < poses.size(); ++i) {
      const double error = found.clearance[i] - exact[i];
      squares += error * error;
      worst = std::max(worst, error);
      num_above += error > 0.002 + 3 * kNoise;
      num_below += error < -0.15 * exact[i] - 3 * kNoise;
    }
    const auto num = static_cast<double>(poses.size());
    rows->add("solids/ball-and-wall-and-shadow/to:" +
                  std::to_string(static_cast<int>(100 * reach)) + "cm",
              facts("rms_mm=%.3f worst_above_mm=%.3f above_2mm_3sigma_pct=%.3f "
                    "below_15pct_3sigma_pct=%.3f",
                    1e3 * std::sqrt(squares / num), 1e3 * worst, 100 * num_above / num,
                    100 * num_below / num));
  }
}

/// Falsely free and blocked without need, of an inner packing with its standoff as margin.
void free_space() {
  const Solids solids;
  const Vec3d size{0.02, 0.016, 0.08};
  PackOptions options{.max_spheres = 5000};
  options.standoff = 0.001;
  const Tool tool = value_or_stop(Tool::pack(make_box(size), options));
  const SceneContact contact = contact_of(tool);
  // Standoff: from the surface of the box to the nearest sphere.
  double standoff = 0;
  test::Random random(6);
  for (int i = 0; i < 4000; ++i) {
    Vec3d p{random.uniform(-0.5, 0.5) * size.x, random.uniform(-0.5, 0.5) * size.y,
            random.uniform(-0.5, 0.5) * size.z};
    const int axis = i % 3;
    p[axis] = (i % 2 == 0 ? 0.5 : -0.5) * size[axis];
    double least = 1;
    for (const Sphere& s : tool.spheres()) {
      least = std::min(least, norm(p - to_double(s.center)) - static_cast<double>(s.radius));
    }
    standoff = std::max(standoff, least);
  }
  const double margin = standoff + 3 * kNoise;
  std::vector<Pose> poses;
  std::vector<double> exact;
  while (poses.size() < 100000) {
    const double x = random.uniform(-0.25, 0.25), y = random.uniform(-0.2, 0.2);
    const Pose X_WT{{x, y, random.uniform(0.5, 1.05)}, random.rotation(3)};
    double least = 1;
    for (int i = 0; i < 9 * 9 * 17; ++i) {  // points on the box
      const Vec3d p{(i % 9 / 8.0 - 0.5) * size.x, (i / 9 % 9 / 8.0 - 0.5) * size.y,
                    (i / 81 / 16.0 - 0.5) * size.z};
      const bool is_on_face = i % 9 % 8 == 0 || i / 9 % 9 % 8 == 0 || i / 81 % 16 == 0;
      if (is_on_face) least = std::min(least, solids.to_hull(X_WT * p));
    }
    poses.push_back(X_WT);
    exact.push_back(least);
  }
  std::vector<std::uint8_t> hits(poses.size());
  if (!contact.any(solids.scene, {poses}, margin, hits.data())) std::abort();
  int num_falsely_free = 0, num_clear = 0, num_blocked = 0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    num_falsely_free += exact[i] < 0 && hits[i] == 0;
    num_clear += exact[i] > 2 * margin;
    num_blocked += exact[i] > 2 * margin && hits[i] != 0;
  }
  rows->add(
      "free/ball-and-wall/poses:100000",
      facts("standoff_mm=%.2f margin_mm=%.2f spheres=%zu falsely_free=%d blocked_pct=%.3f of=%d",
            1e3 * standoff, 1e3 * margin, tool.spheres().size(), num_falsely_free,
            100.0 * num_blocked / num_clear, num_clear));
}

/// One pose through the scene over one through the query, by turns.
void one_pose() {
  const SeenWall seen;
  const Tool& tool = finger_tool(1000);
  const SceneContact contact = contact_of(tool);
  const auto query = value_or_stop(make_contact_query(Place::cpu(), tool));
  const std::vector<Pose> poses = finger_poses(2000, Where::surface);
  std::vector<double> ratios;
  for (int turn = 0; turn < 30; ++turn) {
    double volume = 0;
    const double by_scene = best_time(2, [&] {
      for (const Pose& X : poses) volume += contact.measure(seen.scene, X).penetration.volume;
    });
    const double by_query = best_time(2, [&] {
      for (const Pose& X : poses) {
        volume += query->measure(seen.scene.surfaces[0], X).penetration.volume;
      }
    });
    if (volume < 0) std::abort();
    ratios.push_back(by_scene / by_query);
  }
  std::sort(ratios.begin(), ratios.end());
  rows->add("one-pose/new-over-old/spheres:1000", ratios[ratios.size() / 2], "ratio", 1.02);
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) {
  using namespace palpate::bench;
  using palpate::Backend, palpate::Place;
  ResultRows all(argc, argv);
  std::string only, path;
  Place place = Place::cpu();
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--gpu") == 0) place = Place::cuda();
    if (i + 1 == argc) break;
    if (std::strcmp(argv[i], "--only") == 0) only = argv[i + 1];
    if (std::strcmp(argv[i], "--csv") == 0) path = argv[i + 1];
  }
  if (!all.open(path)) return 1;
  rows = &all;
  const auto is_wanted = [&](const char* part) { return only.empty() || only == part; };
  if (is_wanted("rate")) rate(place);
  if (is_wanted("scene")) scene(place);
  if (place.backend != Backend::cpu) return all.close() ? 0 : 1;
  if (is_wanted("ready")) ready();
  if (is_wanted("solids")) exact_solids();
  if (is_wanted("free")) free_space();
  if (is_wanted("one")) one_pose();
  return all.close() ? 0 : 1;
}
