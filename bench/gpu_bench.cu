// Times of the CUDA backend on this machine, beside the floor measured in the same run: one CSV
// row for each case. No Google Benchmark: machines with GPUs are often bare.
//   gpu_bench [--quick] [--gpu N] [--only WORD]
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "bench/arm_setup.h"
#include "bench/contact_setup.h"
#include "bench/gpu_floor.cuh"
#include "bench/harness.h"
#include "bench/hull_setup.h"
#include "bench/wall_frame.h"
#include "palpate/contact/body_contact.h"
#include "palpate/contact/contact.h"
#include "palpate/field/sensor.h"
#include "palpate/gpu/devices.h"
#include "src/cameras/internal/link_image.h"
#include "src/cameras/robot/link_image_cuda.h"
#include "src/cloud/internal/depth_average_cuda.h"
#include "src/cloud/internal/surface_cuda.h"
#include "src/contact/field/field_contact_cuda.h"
#include "src/field/depth_field_cuda.h"

namespace palpate::bench {
namespace {

struct Options {
  double seconds = 1.0;  // per case
  int gpu = 0;
  std::string only;  // selects cases by part of their names
  std::vector<int> sizes{1000, 5000, 17000, 100000, 1000000};
};

Options options;
ResultRows* rows = nullptr;

bool is_requested(const std::string& name) { return name.find(options.only) != std::string::npos; }

/// Times repeated calls.
template <class Call>
void measure(const std::string& name, const Call& call) {
  if (!is_requested(name)) return;
  for (int i = 0; i < 50; ++i) call();
  std::vector<double> times;
  const Clock::time_point begin = Clock::now();
  do {
    const Clock::time_point start = Clock::now();
    call();
    times.push_back(microseconds_since(start));
  } while (times.size() < 20000 && microseconds_since(begin) < 1e6 * options.seconds);
  rows->times(name, call_times(std::move(times)));
}

// Launches, barriers and synchronization without any work.
void measure_floor() {
  gpu::Memory memory(options.gpu);
  gpu::Stream stream(options.gpu, gpu::Priority::high);
  auto* const flag = memory.take_pinned<std::uint64_t>(1);
  auto* const counts = memory.take<unsigned long long>(3);
  if (!memory.status()) stop(memory.status().error());
  std::uint64_t number = 0;
  const auto await = [&] {
    while (*static_cast<volatile std::uint64_t*>(flag) != number && stream.status()) {
    }
  };
  const gpu::LaunchShape small{.blocks = 16, .threads = 128};
  const gpu::LaunchShape whole{
      .blocks = 132, .threads = 512, .shared_bytes = 16, .cooperative = true};
  measure("floor: one launch", [&] {
    gpu::launch(stream, small, raise_flag, flag, ++number);
    await();
  });
  measure("floor: one launch and the last of 132 blocks", [&] {
    gpu::launch(stream, whole, raise_flag_last, flag, ++number, counts);
    await();
  });
  for (const int barriers : {2, 8}) {
    measure("floor: one launch and " + std::to_string(barriers) + " barriers of 132 blocks", [&] {
      gpu::launch(stream, whole, raise_flag_after, flag, ++number, counts + 1, barriers);
      await();
    });
  }
  measure("floor: graph of 5 empty kernels", [&, graph = [&] {
            stream.begin_recording();
            for (int i = 0; i < 5; ++i) gpu::launch(stream, small, do_nothing);
            return stream.end_recording();
          }()] {
    stream.launch(graph);
    gpu::launch(stream, small, raise_flag, flag, ++number);
    await();
  });
  if (!stream.status()) stop(stream.status().error());
}

std::unique_ptr<ContactQuery> query_by(const Tool& tool, MethodKind method, int gpu) {
  return value_or_stop(make_contact_query(Place::cuda(gpu), tool,
                                          value_or_stop(contact_method({.method = method}))));
}

// Pose to wrench on the host.
void measure_queries(int num_spheres) {
  const Tool& tool = cube_tool(num_spheres);
  ThreadPool pool(0);
  DepthField field = value_or_stop(DepthField::create(640, 480));
  PointCloudView cloud = bumpy_wall().view();
  cloud.stamp = 1;  // copied once
  field.update(cloud, pool);
  const SurfaceView surface{cloud, field.view()};
  const std::pair<const char*, MethodKind> methods[] = {{"field", MethodKind::field},
                                                        {"simplified", MethodKind::simplified},
                                                        {"weighted", MethodKind::weighted},
                                                        {"graph", MethodKind::graph}};
  for (const auto& [name, method] : methods) {
    const auto query = query_by(tool, method, options.gpu);
    for (const int depth : {10, 50, 100}) {
      const std::vector<Pose> poses = random_poses(depth / 100.0);
      std::size_t i = 0;
      ContactStatus status;
      measure(
          std::string(name) + "/spheres:" + std::to_string(num_spheres) +
              "/depth:" + std::to_string(depth),
          [&] { status |= query->measure(surface, poses[i++ % poses.size()]).penetration.status; });
      if (status.has(StepStatus::backend_failed)) {
        stop({Errc::unavailable, "a query failed on the GPU"});
      }
    }
  }
  if (num_spheres <= 100000) {
    const auto query = query_by(tool, MethodKind::field, options.gpu);
    const Pose X_WT = random_poses(0.5)[0];
    Stiffness stiffness;
    measure("stiffness/spheres:" + std::to_string(num_spheres),
            [&] { stiffness = *query->measure(surface, X_WT, {.stiffness = true}).stiffness; });
  }
}

// Two equal cubes, and one in a cube that is too coarse to be sampled.
void measure_bodies(int num_spheres) {
  const Tool& tool = cube_tool(num_spheres);
  for (const bool is_coarse : {false, true}) {
    const Tool& other = is_coarse ? cube_tool(100) : tool;
    const auto query = value_or_stop(make_body_pair_query(Place::cuda(options.gpu), tool, other));
    for (const int depth : {10, 50, 100}) {
      const std::vector<Pose> poses = overlapping_poses(depth / 100.0);
      std::size_t i = 0;
      ContactStatus status;
      measure((is_coarse ? "bodies_coarse/spheres:" : "bodies/spheres:") +
                  std::to_string(num_spheres) + "/depth:" + std::to_string(depth),
              [&] { status |= query->measure(poses[i++ % poses.size()], {}).on_a.status; });
      if (status.has(StepStatus::backend_failed)) {
        stop({Errc::unavailable, "a query failed on the GPU"});
      }
    }
  }
}

// Standard deviations against a surface made on the GPU, and on the CPU.
void measure_noise(int num_spheres) {
  const std::string name = "std/spheres:" + std::to_string(num_spheres);
  if (!is_requested(name)) return;
  const WallFrame wall(640, 480);
  auto sensor = value_or_stop(
      Sensor::create({wall.width, wall.height, wall.intrinsics}, Place::cuda(options.gpu)));
  const Tool& tool = cube_tool(num_spheres);
  for (const Backend backend : {Backend::cuda, Backend::cpu}) {
    const Place place = backend == Backend::cuda ? Place::cuda(options.gpu) : Place::cpu();
    const auto query =
        value_or_stop(make_contact_query(place, tool, FieldMethod{}, {.reserves_noise = true}));
    auto on_cpu =
        value_or_stop(Sensor::create({wall.width, wall.height, wall.intrinsics}, Place::cpu()));
    const std::vector<Pose> poses = random_poses(0.5);
    std::vector<double> with, plain;
    for (int frame = 0; frame < 50; ++frame) {
      Sensor& used = backend == Backend::cuda ? sensor : on_cpu;
      const SurfaceView surface = used.update(wall.image());
      for (int i = 0; i < 40; ++i) {
        const Pose& X_WT = poses[static_cast<std::size_t>(frame + i) % poses.size()];
        const auto start = Clock::now();
        const ContactResult result = query->measure(surface, X_WT, {.noise = i < 20});
        (i < 20 ? with : plain).push_back(microseconds_since(start));
        if (i < 20 && !result.noise) stop({Errc::unavailable, "a query says no noise"});
      }
    }
    const std::string on = backend == Backend::cuda ? "" : "/cpu";
    rows->times(name + ": queries" + on, call_times(std::move(with)));
    rows->times(name + ": the same without it" + on, call_times(std::move(plain)));
  }
}

// Several cameras that see a wall: views of the field in host memory, copied once. All cases by
// turns: pose to wrench on the host, and the time on the device of one query among many in a row.
void measure_hull(int num_spheres) {
  struct Case {
    std::string name;
    std::vector<SurfaceBlend> views;
    ContactWants wants;
    std::vector<double> times, device_times;
  };
  static const std::vector<test::HullScene> scenes = [] {
    std::vector<test::HullScene> all;
    for (int num = 1; num <= 4; ++num) {
      all.push_back(scene_of(solids().front(), cameras_around(num), 0.0015, 1));
    }
    return all;
  }();
  std::vector<Case> cases;
  for (const bool with_stiffness : {false, true}) {
    for (const test::HullScene& scene : scenes) {
      Case one{"hull/spheres:" + std::to_string(num_spheres) + "/cameras:" +
                   std::to_string(scene.views.size()) + (with_stiffness ? "/stiffness" : ""),
               scene.views,
               {.stiffness = with_stiffness},
               {},
               {}};
      // A single camera does not use the seen free space.
      if (one.views.size() == 1) test::set_apart(one.views[0].from, one.views[0].to);
      if (is_requested(one.name)) cases.push_back(std::move(one));
    }
  }
  if (cases.empty()) return;
  const FieldContactCuda query(ToolIndex::create(cube_tool(num_spheres)), {}, options.gpu);
  const std::vector<Pose> poses = random_poses(0.1);
  gpu::Stream& stream = query.stream();
  constexpr int kTurns = 20, kLaunches = 20;
  ContactStatus status;
  for (int turn = 0; turn <= kTurns; ++turn) {  // the first one to warm up
    for (Case& one : cases) {
      const auto ask = [&](const Pose& X_WT) {
        status |= query.measure(one.views, X_WT, one.wants).penetration.status;
      };
      ask(poses[0]);  // the fields of this case are copied
      const Clock::time_point begin = Clock::now();
      for (std::size_t i = 0; microseconds_since(begin) < 1e6 * options.seconds / kTurns; ++i) {
        const Clock::time_point start = Clock::now();
        ask(poses[i % poses.size()]);
        if (turn > 0) one.times.push_back(microseconds_since(start));
      }
      stream.repeat_kernels(kLaunches);
      for (std::size_t i = 0; i < 20; ++i) {
        stream.mark();
        ask(poses[(20 * static_cast<std::size_t>(turn) + i) % poses.size()]);
        const double lap = stream.lap() / kLaunches;
        if (turn > 0) one.device_times.push_back(lap);
      }
      stream.repeat_kernels(1);
    }
  }
  if (status.is_unmeasured()) stop({Errc::unavailable, "a query failed on the GPU"});
  for (Case& one : cases) {
    rows->times(one.name, call_times(std::move(one.times)));
    rows->times(one.name + "; device time", call_times(std::move(one.device_times)));
  }
}

// Removal of a robot from a frame in host memory: on the GPU, and on one core for comparison.
void measure_self_filter() {
  constexpr double kPadding = 0.02;
  const DepthFrame wall = wall_behind_arm();
  for (const int around : {10, 40, 100}) {
    const std::vector<RobotLink> links = arm_of_tubes(around);
    const std::string name =
        "self_filter/triangles:" + std::to_string(kNumLinks * links[0].mesh.triangles.size());
    const auto on_gpu = value_or_stop(
        make_links_on_gpu(links, kArmCamera, kArmWidth, kArmHeight, kPadding, options.gpu));
    DepthFrame frame = wall;
    int step = 0;
    measure(name, [&] {
      frame.pixels = wall.pixels;
      const auto done = on_gpu->remove_from(frame, arm_poses(++step));
      if (!done) stop(done.error());
    });
    LinkImage image(kArmCamera, kPadding);
    measure(name + "/cpu", [&] {
      frame.pixels = wall.pixels;
      const std::vector<Pose> X_CL = arm_poses(++step);
      image.begin(kArmWidth, kArmHeight);
      for (std::size_t i = 0; i < links.size(); ++i) image.add(links[i].mesh, X_CL[i]);
      image.draw();
      image.remove_from(frame);
    });
  }
}

DepthFrame wall_frame(int width, int height) {
  const WallFrame wall(width, height);
  DepthFrame frame{width, height, 0.001, {}, 0};
  for (const float z : wall.depth) {
    frame.pixels.push_back(static_cast<std::uint16_t>(1000 * z + 0.5f));
  }
  return frame;
}

/// Filter, normals, depth change and field of a frame.
struct Sensing {
  SurfaceCuda surface;
  DepthFieldCuda field;

  Sensing(int width, int height, Smoothing smoothing = Smoothing::bilateral)
      : surface(
            value_or_stop(SurfaceCuda::create(width, height, WallFrame(width, height).intrinsics,
                                              {.filter = {.smoothing = smoothing}}, options.gpu))),
        field(value_or_stop(DepthFieldCuda::create(width, height, {}, options.gpu))) {
    const DepthFrame frame = wall_frame(width, height);
    std::copy(frame.pixels.begin(), frame.pixels.end(), surface.input().begin());
    surface.set_unit(frame.unit);
  }
};

// Device time of one frame among many in a row.
void measure_sensing(int width, int height) {
  const std::string size = std::to_string(width) + "x" + std::to_string(height);
  Sensing sensing(width, height);
  gpu::Memory memory(options.gpu);
  gpu::Stream stream(options.gpu, gpu::Priority::low);
  const float* const depth = memory.copy_of(WallFrame(width, height).depth);
  const auto measure_recorded = [&](const std::string& name, const auto& enqueue) {
    if (!is_requested(name)) return;
    stream.begin_recording();
    enqueue();
    const gpu::Graph graph = stream.end_recording();
    std::vector<double> times;
    for (int i = 0; i < 200; ++i) {
      constexpr int kFrames = 20;
      stream.mark();
      for (int k = 0; k < kFrames; ++k) stream.launch(graph);
      times.push_back(stream.lap() / kFrames);
    }
    if (!stream.status()) stop(stream.status().error());
    rows->times(name, call_times(std::move(times)));
  };
  measure_recorded("sensing: surface and field; device time/" + size, [&] {
    sensing.surface.enqueue_depth(stream, depth);
    sensing.field.enqueue(sensing.surface.cloud(), stream);
  });
  measure_recorded("sensing: surface; device time/" + size,
                   [&] { sensing.surface.enqueue_depth(stream, depth); });
  Sensing adaptive(width, height, Smoothing::adaptive);
  measure_recorded("sensing: adaptive surface and field; device time/" + size, [&] {
    adaptive.surface.enqueue_depth(stream, depth);
    adaptive.field.enqueue(adaptive.surface.cloud(), stream);
  });
  measure_recorded("sensing: adaptive surface; device time/" + size,
                   [&] { adaptive.surface.enqueue_depth(stream, depth); });
  measure_recorded("sensing: field; device time/" + size,
                   [&] { sensing.field.enqueue(sensing.surface.cloud(), stream); });
  // Includes the copy of the raw frame.
  for (const DepthAverage kind : {DepthAverage::none, DepthAverage::moving,
                                  DepthAverage::exponential, DepthAverage::kalman}) {
    const DepthFrame raw = wall_frame(width, height);
    DepthAverageOptions average;
    average.kind = kind;
    auto averager = value_or_stop(DepthAveragerCuda::create(width, height, average, options.gpu));
    std::copy(raw.pixels.begin(), raw.pixels.end(), averager.input().begin());
    averager.set_unit(raw.unit);
    measure_recorded("sensing: copy and average " + name_of(kind) + "; device time/" + size,
                     [&] { averager.enqueue(stream); });
  }
  measure_recorded("sensing: copy and surface and field; device time/" + size, [&] {
    sensing.surface.enqueue(stream);
    sensing.field.enqueue(sensing.surface.cloud(), stream);
  });

  ThreadPool pool(0);
  const DepthFrame frame = wall_frame(width, height);
  const DepthStreamInfo info{width,        height, WallFrame(width, height).intrinsics, 0.001, 30,
                             std::nullopt, "wall"};
  auto timeline = value_or_stop(
      SurfaceTimeline::create(info, {.wants_depth_change = true}, Place::cuda(options.gpu)));
  double time = 0;
  measure("sensing: frame to finished surfaces on the host/" + size,
          [&] { timeline.push(frame, time += 1.0 / 30, pool); });
}

// Section 4.2 of the thesis: a haptic loop at 1 kHz and sensing at 30 Hz on the same GPU
// (Figs. 4.2 and 4.3).
void measure_sharing(int width, int height) {
  using std::chrono::microseconds;
  struct Way {
    const char* name;
    bool senses;
    gpu::Priority priority;
    int num_parts;
  };
  const Way ways[] = {
      {"no camera", false, gpu::Priority::low, 1},
      {"whole frames; equal priority", true, gpu::Priority::high, 1},
      {"8 parts spread over the frame time; equal priority", true, gpu::Priority::high, 8},
      {"128 parts spread over the frame time; equal priority", true, gpu::Priority::high, 128},
      {"whole frames; low priority", true, gpu::Priority::low, 1},
      {"16 parts spread over the frame time; equal priority", true, gpu::Priority::high, 16},
      {"16 parts spread over the frame time; low priority", true, gpu::Priority::low, 16}};
  const Tool& tool = cube_tool(17000);
  ThreadPool pool(0);
  DepthField field = value_or_stop(DepthField::create(640, 480));
  PointCloudView cloud = bumpy_wall().view();
  cloud.stamp = 1;
  field.update(cloud, pool);
  const SurfaceView surface{cloud, field.view()};
  const std::vector<Pose> poses = random_poses(0.5);
  for (const auto& [method_name, method] :
       {std::pair{"field", MethodKind::field}, std::pair{"simplified", MethodKind::simplified}}) {
    const auto query = query_by(tool, method, options.gpu);
    for (const Way& way : ways) {
      const std::string name = "sharing: " + std::string(method_name) + " at 1 kHz; " +
                               std::to_string(width) + "x" + std::to_string(height) +
                               " at 30 Hz: " + way.name;
      if (!is_requested(name)) continue;
      std::atomic<bool> goes_on{true};
      std::vector<double> frame_times;
      std::thread camera([&] {
        if (!way.senses) return;
        Sensing sensing(width, height);
        gpu::Stream stream(options.gpu, way.priority);
        const auto period = microseconds(33333);
        for (auto start = Clock::now(); goes_on; start += period) {
          std::this_thread::sleep_until(start);
          const auto begin = Clock::now();
          // As with the pauses of eq. 4.19, but at fixed times instead of a moving average's: a
          // part begins at its share of the frame time.
          for (int part = 0; part < way.num_parts; ++part) {
            std::this_thread::sleep_until(start + part * period / way.num_parts);
            sensing.surface.enqueue(stream, part, way.num_parts);
            stream.wait();
          }
          sensing.field.enqueue(sensing.surface.cloud(), stream);
          stream.wait();
          frame_times.push_back(microseconds_since(begin));
        }
      });
      std::vector<double> times;
      auto tick = Clock::now() + microseconds(200000);
      const int num_ticks = static_cast<int>(2500 * options.seconds);
      for (int i = 0; i < num_ticks; ++i, tick += microseconds(1000)) {
        while (Clock::now() < tick) {
        }
        const auto begin = Clock::now();
        query->measure(surface, poses[static_cast<std::size_t>(i) % poses.size()]);
        times.push_back(microseconds_since(begin));
      }
      goes_on = false;
      camera.join();
      rows->times(name, call_times(std::move(times)));
      if (!frame_times.empty())
        rows->times(name + "; its frames", call_times(std::move(frame_times)));
    }
  }
}

// Sensing on one GPU, contact on another: cost of the copy for the query after a new frame.
void measure_two_gpus() {
  const DepthFrame frame = wall_frame(640, 480);
  const DepthStreamInfo info{640,          480,   WallFrame(640, 480).intrinsics, 0.001, 30,
                             std::nullopt, "wall"};
  const Tool& tool = cube_tool(17000);
  ThreadPool pool(0);
  const std::vector<Pose> poses = random_poses(0.5);
  for (const int sensing_gpu : {0, 1}) {
    for (const auto& [method_name, method] :
         {std::pair{"field", MethodKind::field}, std::pair{"simplified", MethodKind::simplified}}) {
      const std::string name = "two GPUs: " + std::string(method_name) + "; sensing on GPU " +
                               std::to_string(sensing_gpu) + "; contact on GPU 0";
      if (!is_requested(name)) continue;
      auto timeline = value_or_stop(SurfaceTimeline::create(
          info, {.time = {.mode = TimeMode::latest}, .wants_depth_change = true},
          Place::cuda(sensing_gpu)));
      const auto query = query_by(tool, method, 0);
      std::vector<double> first, later, pushes;
      double time = 0;
      for (int f = 0; f < 300; ++f) {
        const auto begin = Clock::now();
        timeline.push(frame, time += 1.0 / 30, pool);
        pushes.push_back(microseconds_since(begin));
        const SurfaceView surface = timeline.at(time).to;
        for (int i = 0; i < 20; ++i) {
          const auto start = Clock::now();
          query->measure(surface, poses[static_cast<std::size_t>(f + i) % poses.size()]);
          (i == 0 ? first : later).push_back(microseconds_since(start));
        }
      }
      rows->times(name + ": frames", call_times(std::move(pushes)));
      rows->times(name + ": first query of a frame", call_times(std::move(first)));
      rows->times(name + ": other queries", call_times(std::move(later)));
    }
  }
}

void run(std::size_t num_gpus) {
  measure_floor();
  measure_sensing(640, 480);
  measure_sensing(1920, 1080);
  measure_self_filter();
  for (const int size : options.sizes) measure_queries(size);
  for (const int size : options.sizes) measure_bodies(size);
  for (const int size : {1000, 17000}) measure_noise(size);
  for (const int size : {1000, 5000, 17000}) measure_hull(size);
  measure_sharing(640, 480);
  measure_sharing(1920, 1080);
  if (num_gpus > 1) measure_two_gpus();
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) {
  using palpate::bench::options;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--quick") {
      options.seconds = 0.2;
      options.sizes = {1000, 17000};
    } else if (word == "--gpu" && i + 1 < argc) {
      options.gpu = std::atoi(argv[++i]);
    } else if (word == "--only" && i + 1 < argc) {
      options.only = argv[++i];
    } else {
      std::fprintf(stderr, "usage: gpu_bench [--quick] [--gpu N] [--only WORD]\n");
      return 2;
    }
  }
  using namespace palpate::bench;
  const auto gpus = value_or_stop(palpate::find_gpus());
  ResultRows all(argc, argv, gpus[static_cast<std::size_t>(options.gpu)].name);
  if (!all.open("")) return 1;
  rows = &all;
  run(gpus.size());
}
