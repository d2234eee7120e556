// Batches on this machine's GPU: device time of a call, one CSV row for each case, and the rate of
// evaluated spheres. Also a distance grid at the same poses, and configurations of an arm: time of
// a call that waits.
//   gpu_batch_bench [--quick] [--gpu N] [--only WORD] [--warps]
// With --warps every case is timed with 1, 2 and 4 warps per pose.
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "bench/batch_setup.h"
#include "bench/distance_grid.cuh"
#include "bench/harness.h"
#include "palpate/field/sensor.h"
#include "palpate/gpu/devices.h"
#include "src/contact/batch/field_batch_cuda.h"
#include "src/contact/internal/joint_tree.h"
#include "tests/test_util/arm_tree.h"

namespace palpate::bench {
namespace {

struct Options {
  int gpu = 0, laps = 60, num_poses = 16384;
  std::string only;  // selects cases by part of their names
  std::vector<int> warps{0};
};

Options options;
ResultRows* rows = nullptr;

bool is_requested(const std::string& name) { return name.find(options.only) != std::string::npos; }

/// Measures the device time of one call among a few in a row.
template <class Call>
void measure(const std::string& name, double evaluations, gpu::Stream& stream, const Call& call) {
  if (!is_requested(name)) return;
  constexpr int kCalls = 5;
  for (int i = 0; i < 3; ++i) call();
  stream.wait(60);
  std::vector<double> times;
  for (int lap = 0; lap < options.laps; ++lap) {
    stream.mark();
    for (int i = 0; i < kCalls; ++i) call();
    times.push_back(stream.lap() / kCalls);
  }
  if (!stream.status()) stop(stream.status().error());
  const CallTimes all = call_times(std::move(times));
  rows->times(name, all, facts("evaluations_per_s=%.3g", 1e6 * evaluations / all.median));
}

/// Returns depth of bumpy_wall in meters, in images of any size, each a little farther away.
std::vector<float> wall_images(int width, int height, int num) {
  std::vector<float> meters;
  const double f = 525.0 * width / 640;
  for (int i = 0; i < num; ++i) {
    for (int v = 0; v < height; ++v) {
      for (int u = 0; u < width; ++u) {
        const double a = 26 * (u - width / 2) / f, b = 31 * (v - height / 2) / f;
        meters.push_back(
            static_cast<float>(kWallDepth + 0.0001 * i + 0.01 * std::sin(a) * std::cos(b)));
      }
    }
  }
  return meters;
}
Camera camera_of(int width, int height) {
  const double f = 525.0 * width / 640;
  return {width, height, {f, f, (width - 1) / 2.0, (height - 1) / 2.0}};
}

/// Poses and results on the GPU.
struct Arrays {
  gpu::Memory memory{options.gpu};
  std::vector<Pose> X_WT;
  PoseBatch poses;
  BatchAnswers answers;

  explicit Arrays(Where where) : X_WT(finger_poses(options.num_poses, where)) {
    const auto num = X_WT.size();
    poses.X_WT = {memory.copy_of(X_WT), num};
    poses.gpu = options.gpu;
    answers = {memory.take<double>(num),
               memory.take<double>(num),
               memory.take<double>(3 * num),
               memory.take<double>(3 * num),
               nullptr,
               memory.take<std::uint32_t>(num),
               options.gpu};
    if (!memory.status()) stop(memory.status().error());
  }
};

const char* name_of_where(Where where) {
  return where == Where::view ? "anywhere in view" : "at the surface";
}

/// Answers beside the measure.
enum class Beside { nothing, stiffness, deviations };

void measure_poses(int num_spheres, const SurfaceBatch& surfaces, const char* against, Where where,
                   Beside beside) {
  const Tool& tool = finger_tool(num_spheres);
  Arrays arrays(where);
  const std::size_t num = arrays.X_WT.size();
  if (beside == Beside::stiffness) {
    arrays.answers.stiffness = arrays.memory.take<double>(36 * num);
  } else if (beside == Beside::deviations) {
    arrays.answers.volume_std = arrays.memory.take<double>(num);
    arrays.answers.force_std = arrays.memory.take<double>(3 * num);
    arrays.answers.torque_std = arrays.memory.take<double>(3 * num);
  }
  if (!arrays.memory.status()) stop(arrays.memory.status().error());
  gpu::Stream stream(options.gpu, gpu::Priority::low);
  for (const int warps : options.warps) {
    const FieldBatchCuda batches(ToolIndex::create(tool), FieldMethod{}, options.gpu, warps);
    std::string name = "batch: " + std::to_string(num) + " poses " + name_of_where(where) + " x " +
                       std::to_string(num_spheres) + " spheres; " + against;
    if (beside == Beside::stiffness) name += "; stiffness";
    if (beside == Beside::deviations) name += "; std";
    if (warps > 0) name += "; warps:" + std::to_string(warps);
    measure(name, static_cast<double>(num) * num_spheres, stream, [&] {
      const Status status =
          batches.measure(surfaces, arrays.poses, arrays.answers, CallerStream{stream.handle()});
      if (!status) stop(status.error());
    });
  }
  std::vector<double> volume(num);
  stream.copy(volume.data(), arrays.answers.volume, num * sizeof(double));
  stream.wait();
  const auto num_touching =
      std::count_if(volume.begin(), volume.end(), [](double v) { return v > 0; });
  std::fprintf(stderr, "of these poses %.3f touch\n",
               static_cast<double>(num_touching) / static_cast<double>(num));
}

void measure_grid(int num_spheres, double cell, Where where) {
  const Tool& tool = finger_tool(num_spheres);
  const Arrays arrays(where);
  gpu::Memory memory(options.gpu);
  GridJob job;
  job.grid = wall_distances(cell, memory);
  job.spheres = memory.copy_of(std::vector<Sphere>(tool.spheres().begin(), tool.spheres().end()));
  job.num_spheres = num_spheres;
  job.X_WT = arrays.poses.X_WT.data();
  job.answers = memory.take<float>(7 * arrays.X_WT.size());
  if (!memory.status()) stop(memory.status().error());
  gpu::Stream stream(options.gpu, gpu::Priority::low);
  const gpu::LaunchShape shape{
      .blocks = options.num_poses, .threads = num_spheres <= 256 ? 64 : 256, .shared_bytes = 512};
  measure("distance grid: " + std::to_string(options.num_poses) + " poses " + name_of_where(where) +
              " x " + std::to_string(num_spheres) + " spheres; cells of " +
              std::to_string(static_cast<int>(1000 * cell)) + " mm",
          static_cast<double>(options.num_poses) * num_spheres, stream,
          [&] { gpu::launch(stream, shape, query_grid, job); });
}

/// Measures the time of a call that waits. `num`: configurations.
template <class Call>
void measure_waiting(const std::string& name, std::size_t num, const Call& call) {
  if (!is_requested(name)) return;
  std::vector<double> times;
  for (int lap = -3; lap < options.laps; ++lap) {
    const Clock::time_point start = Clock::now();
    call();
    if (lap >= 0) times.push_back(microseconds_since(start));
  }
  const CallTimes all = call_times(std::move(times));
  rows->times(name, all,
              facts("configurations_per_s=%.3g", 1e6 * static_cast<double>(num) / all.median));
}

/// Measures an arm in front of a wall, which a camera over its shoulder sees with 2 mm of noise.
void measure_arm() {
  const test::ArmTree arm = test::arm_tree();
  test::Random random(2);
  std::vector<float> depth;
  for (int i = 0; i < 640 * 480; ++i) {
    depth.push_back(static_cast<float>(1.4 + 0.002 * std::sqrt(3.0) * random.uniform(-1, 1)));
  }
  Sensor sensor = value_or_stop(Sensor::create(camera_of(640, 480), Place::cuda(options.gpu)));
  DepthImageView image(640, 480, depth.data());
  image.X_WC = {{-1, 0, 0.5}, {-0.5, 0.5, -0.5, 0.5}};  // looks along x
  const Scene scene{.surfaces = {sensor.update(image)}};
  const std::vector<const Tool*> tools = arm.pointers();
  const SceneContact contact =
      value_or_stop(SceneContact::create(tools, FieldMethod{}, Place::cuda(options.gpu)));
  const std::size_t n = arm.num_positions();
  const auto ask = [&](const JointPoses& poses, const TreeAnswers& answers) {
    if (value_or_stop(measure_tree(contact, scene, poses, answers))) stop({});
  };
  constexpr std::size_t kMost = 262144;
  const std::vector<double> anywhere = arm.random_positions(kMost, random);
  std::vector<double> clearance(kMost), near;
  ask({arm.tree, {}, anywhere}, {.clearance = clearance.data()});
  std::size_t num_blocked = 0;
  for (std::size_t i = 0; i < kMost; ++i) {
    num_blocked += clearance[i] < 0;
    if (!(std::abs(clearance[i]) < kClearanceLimit)) continue;
    near.insert(near.end(), &anywhere[i * n], &anywhere[i * n] + n);
  }
  std::fprintf(stderr, "of the arm's configurations %.3f touch, %.3f are within 10 cm\n",
               static_cast<double>(num_blocked) / kMost,
               static_cast<double>(near.size() / n) / kMost);
  for (std::size_t i = 0; near.size() < kMost * n; ++i) near.push_back(near[i]);
  const std::string links =
      std::to_string(tools.size()) + " links, " + std::to_string(arm.num_spheres()) + " spheres; ";
  for (const bool is_near : {false, true}) {
    const std::vector<double>& positions = is_near ? near : anywhere;
    for (const std::size_t num : {std::size_t{16384}, kMost}) {
      gpu::Memory memory(options.gpu);
      const std::span<const double> some(positions.data(), num * n);
      const JointPoses poses{arm.tree, {}, {memory.copy_of(some), num * n}, false, options.gpu};
      auto* const to = memory.take<double>(num);
      auto* const link = memory.take<std::int32_t>(num);
      auto* const by_joint = memory.take<double>(num * n);
      auto* const hits = memory.take<std::uint8_t>(num);
      if (!memory.status()) stop(memory.status().error());
      const std::string name = "robot: " + std::to_string(num) + " configurations of " + links +
                               (is_near ? "within 10 cm" : "anywhere");
      measure_waiting(name + "; clearance", num,
                      [&] { ask(poses, {.clearance = to, .link = link}); });
      measure_waiting(name + "; clearance and its derivative", num, [&] {
        ask(poses, {.clearance = to, .link = link, .clearance_by_joint = by_joint});
      });
      measure_waiting(name + "; yes or no at 1 cm", num,
                      [&] { ask(poses, {.hits = hits, .limit = 0.01}); });
      std::vector<std::int32_t> links_of(num);
      measure_waiting(name + "; clearance; host memory", num, [&] {
        ask({arm.tree, {}, some}, {.clearance = clearance.data(), .link = links_of.data()});
      });
    }
  }
}

void run() {
  measure_arm();
  Sensor large = value_or_stop(Sensor::create(camera_of(640, 480), Place::cuda(options.gpu)));
  const std::vector<float> wall = wall_images(640, 480, 1);
  const SurfaceView surface = large.update({640, 480, wall.data()});
  if (!large.status()) stop(large.status().error());

  // One small image per pose, 128 different ones.
  Sensor small = value_or_stop(Sensor::create(camera_of(64, 64), Place::cuda(options.gpu)));
  Sensor bilateral =
      value_or_stop(Sensor::create(camera_of(64, 64), Place::cuda(options.gpu),
                                   {.surface = {.filter = {.smoothing = Smoothing::bilateral}}}));
  const std::vector<float> some = wall_images(64, 64, 128);
  std::vector<std::uint16_t> counts;
  for (int i = 0; i < options.num_poses; ++i) {
    for (std::size_t k = 0; k < 64 * 64; ++k) {
      const float z = some[static_cast<std::size_t>(i % 128) * 64 * 64 + k];
      counts.push_back(static_cast<std::uint16_t>(1000 * z + 0.5f));
    }
  }
  gpu::Memory memory(options.gpu);
  gpu::Stream stream(options.gpu, gpu::Priority::low);
  const DepthImageView images{64, 64, memory.copy_of(counts), 0.001, options.gpu};
  if (const Status status = small.reserve_batch(options.num_poses); !status) stop(status.error());
  SurfaceBatch fields;
  const auto measure_frames = [&](Sensor& sensor, const std::string& how) {
    const auto update = [&] {
      fields = sensor.update_batch(images, options.num_poses, CallerStream{stream.handle()});
      if (!sensor.status()) stop(sensor.status().error());
    };
    update();
    measure(
        "frames: " + std::to_string(options.num_poses) + " of 64x64; raw counts to fields" + how,
        options.num_poses, stream, update);
    stream.wait();
  };
  measure_frames(bilateral, "; bilateral");
  measure_frames(small, "");

  for (const Where where : {Where::surface, Where::view}) {
    for (const Beside beside : {Beside::nothing, Beside::deviations}) {
      measure_poses(100, fields, "each its own 64x64 field", where, beside);
    }
    for (const int num_spheres : {100, 1000, 5000}) {
      for (const Beside beside : {Beside::nothing, Beside::stiffness, Beside::deviations}) {
        measure_poses(num_spheres, surface, "one 640x480 field", where, beside);
      }
      for (const double cell : {0.005, 0.02}) measure_grid(num_spheres, cell, where);
    }
  }
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) {
  using palpate::bench::options;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--quick") {
      options.laps = 10;
    } else if (word == "--warps") {
      options.warps = {1, 2, 4};
    } else if (word == "--gpu" && i + 1 < argc) {
      options.gpu = std::atoi(argv[++i]);
    } else if (word == "--only" && i + 1 < argc) {
      options.only = argv[++i];
    } else {
      std::fprintf(stderr, "usage: gpu_batch_bench [--quick] [--gpu N] [--only WORD] [--warps]\n");
      return 2;
    }
  }
  using namespace palpate::bench;
  const auto gpus = value_or_stop(palpate::find_gpus());
  ResultRows all(argc, argv, gpus[static_cast<std::size_t>(options.gpu)].name);
  if (!all.open("")) return 1;
  rows = &all;
  run();
}
