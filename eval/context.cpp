#include "eval/context.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <map>
#include <numeric>
#include <tuple>
#include <utility>

#include "palpate/io/formats.h"
#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"

namespace palpate::eval {
namespace {

namespace fs = std::filesystem;

/// A real recording, as the folder of data describes it.
struct Recording {
  const char* name;
  Intrinsics intrinsics;
  double unit;  ///< m
  double rate;  ///< frames per second
};
constexpr Intrinsics kKinect{525, 525, 319.5, 239.5}, kKinectCentered{525, 525, 320, 240};
constexpr Intrinsics kRoomCamera{617.25, 617.5486, 317.392, 245.98};
constexpr Recording kRecordings[] = {
    {"frames/pcl_person.png", kKinect, 0.001, 30},
    {"frames/pcl_floor_box_chair.png", kKinectCentered, 0.001, 30},
    {"frames/pcl_milk_clorox_table.png", kKinect, 0.001, 30},
    {"frames/pcl_stairs_shelf_1.png", kKinect, 0.001, 30},
    {"frames/pcl_stairs_shelf_2.png", kKinect, 0.001, 30},
    {"frames/pcl_grabber_1.png", kKinectCentered, 0.001, 3.9},
    {"frames/pcl_grabber_2.png", kKinectCentered, 0.001, 3.9},
    {"frames/pcl_grabber_3.png", kKinectCentered, 0.001, 3.9},
    {"frames/realsense_room_0.png", kRoomCamera, 0.001, 30},
    {"frames/realsense_room_2.png", kRoomCamera, 0.001, 30},
    {"frames/realsense_room_4.png", kRoomCamera, 0.001, 30},
    {"frames/slambook_desk_1.png", {518, 519, 325.5, 253.5}, 0.001, 30},
    // Every 20th frame of 30 per second.
    {"sequences/hand_sr305_20210326-230536", {476.007, 476.007, 313.683, 242.755}, 0.000125, 1.5},
    {"sequences/visp_rbt", {607.1785, 607.2343, 321.3913, 241.9182}, 0.001, 30},
};

const Recording* find_recording(const std::string& name) {
  for (const Recording& recording : kRecordings) {
    if (name == recording.name || name == std::string(recording.name) + "/depth") return &recording;
  }
  return nullptr;
}

/// Reads all frames of a source, with progress.
Result<std::vector<DepthFrame>> read_all(DepthSource& source, Context& context) {
  std::vector<DepthFrame> frames;
  for (;;) {
    DepthFrame frame;
    const auto more = source.next(frame);
    if (!more) return more.error();
    if (!*more) return frames;
    frames.push_back(std::move(frame));
    if (context.keep_going && !context.keep_going()) throw Cancelled{};
  }
}

}  // namespace

std::vector<Method> all_methods() {
  std::vector<Method> methods = thesis_methods();
  methods.push_back({"graph-cap", {.method = MethodKind::graph, .inside = InsideVolume::cap}});
  methods.push_back({"field", {.method = MethodKind::field}});
  return methods;
}

std::vector<Method> all_methods_alike() {
  std::vector<Method> methods = all_methods();
  for (Method& method : methods) method.options.volumes = SphereVolumes::represented;
  return methods;
}

std::vector<Method> thesis_methods() {
  return {{"weighted", {.method = MethodKind::weighted}},
          {"simplified", {.method = MethodKind::simplified}},
          {"graph", {.method = MethodKind::graph}}};
}

std::vector<std::string> recording_names() {
  std::vector<std::string> names;
  for (const Recording& recording : kRecordings) names.emplace_back(recording.name);
  return names;
}

/// Packed tools by shape and size: the largest packing so far, and its requested prefixes.
struct Context::Cache {
  struct Entry {
    TriangleMesh mesh;
    SpherePacking packing;
    std::map<std::pair<int, GapRule>, std::shared_ptr<const Tool>> tools;
  };
  std::map<std::pair<std::string, double>, Entry> entries;
};

Context::Context(Settings settings)
    : settings_(std::move(settings)), cache_(std::make_unique<Cache>()) {}
std::string Context::place() const {
  if (settings_.backend == Backend::cpu) return "one CPU core";
  const auto gpus = find_gpus();
  return gpus ? "one " + gpus->front().name : "no GPU";
}

Context::~Context() = default;

void Context::progress(double share) {
  if (keep_going && !keep_going()) throw Cancelled{};
  if (on_progress) on_progress(share);
}

namespace {

/// Makes a shape by its name, else loads a mesh file; its longest side is `size`.
Result<TriangleMesh> load_shape(const std::string& shape, double size, const fs::path& data) {
  const std::vector<std::string> shapes = shape_names();
  if (std::find(shapes.begin(), shapes.end(), shape) != shapes.end()) {
    return make_shape(shape, size);
  }
  fs::path path = shape;
  if (path.is_relative() && !fs::exists(path)) path = data / path;
  auto mesh = load_mesh(path);
  if (!mesh) return mesh.error();
  const Bounds box = bounds(*mesh);
  const Vec3d sides = box.high - box.low;
  const double longest = std::max({sides.x, sides.y, sides.z});
  if (!(longest > 0) || !(size > 0)) {
    return Error{Errc::bad_input, path.string() + " has no size: give another mesh"};
  }
  for (Vec3d& p : mesh->vertices) p *= size / longest;
  return mesh;
}

}  // namespace

Result<std::shared_ptr<const Tool>> Context::tool(const std::string& shape, double size,
                                                  int num_spheres, GapRule rule) {
  if (num_spheres < 1) {
    return Error{Errc::invalid_argument, "a tool of " + std::to_string(num_spheres) +
                                             " spheres was asked for; ask for one or more"};
  }
  auto found = cache_->entries.find({shape, size});
  if (found == cache_->entries.end()) {
    auto mesh = load_shape(shape, size, settings_.data);
    if (!mesh) return mesh.error();
    found = cache_->entries.insert({{shape, size}, {*std::move(mesh), {}, {}}}).first;
  }
  Cache::Entry& entry = found->second;
  if (const auto made = entry.tools.find({num_spheres, rule}); made != entry.tools.end()) {
    return made->second;
  }
  const auto count = static_cast<std::size_t>(num_spheres);
  if (entry.packing.spheres.size() < count && entry.packing.stop == PackStop::count) {
    PackOptions options;
    options.max_spheres = num_spheres;
    options.num_threads = settings_.num_threads;
    options.progress = [this](const PackProgress&) { return !keep_going || keep_going(); };
    auto packing = pack_spheres(entry.mesh, options);
    if (!packing && packing.error().code == Errc::cancelled) throw Cancelled{};
    if (!packing) return packing.error();
    entry.packing = *std::move(packing);
  }
  SpherePacking prefix = entry.packing;
  prefix.spheres.resize(std::min(count, prefix.spheres.size()));
  auto tool = Tool::build(entry.mesh, std::move(prefix), {rule, shape, settings_.num_threads});
  if (!tool) return tool.error();
  const auto made = std::make_shared<const Tool>(*std::move(tool));
  entry.tools[{num_spheres, rule}] = made;
  return made;
}

Result<std::optional<std::vector<DepthFrame>>> Context::recorded(const std::string& name,
                                                                 DepthStreamInfo& info) {
  const Recording* recording = find_recording(name);
  if (recording == nullptr) {
    return Error{Errc::not_found,
                 "no recording is called " + name + ": see recording_names() for those known"};
  }
  const fs::path path = settings_.data / recording->name;
  if (settings_.data.empty() || !fs::exists(path)) {
    return std::optional<std::vector<DepthFrame>>();
  }
  std::vector<DepthFrame> frames;
  if (fs::is_directory(path)) {
    auto source =
        open_depth_folder(path, {recording->intrinsics, recording->unit, recording->rate});
    if (!source) return source.error();
    auto read = read_all(**source, *this);
    if (!read) return read.error();
    frames = *std::move(read);
  } else {
    auto frame = load_depth_png(path, recording->unit);
    if (!frame) return frame.error();
    frames.push_back(*std::move(frame));
  }
  info = {frames.front().width, frames.front().height, recording->intrinsics,
          recording->unit,      recording->rate,       static_cast<int>(frames.size()),
          recording->name};
  return std::optional(std::move(frames));
}

Result<std::vector<FirstFrame>> Context::first_frames(bool of_sequences) {
  std::vector<FirstFrame> frames;
  for (const std::string& name : recording_names()) {
    if (!of_sequences && !name.starts_with("frames/")) continue;
    DepthStreamInfo stream;
    auto of_recording = recorded(name, stream);
    if (!of_recording) return of_recording.error();
    if (!*of_recording) continue;
    const std::size_t from = name.find('/') + 1;
    frames.push_back(
        {name.substr(from, name.rfind('.') - from), stream, std::move((**of_recording).front())});
  }
  return frames;
}

Result<std::vector<DepthFrame>> Context::simulated(const scenes::Scene& scene,
                                                   const scenes::SimulatedCameraOptions& camera,
                                                   DepthStreamInfo& info) {
  auto source = scenes::open_simulated_camera(scene, camera);
  if (!source) return source.error();
  info = (*source)->info();
  return read_all(**source, *this);
}

Times time_calls(std::size_t num, const std::function<void(std::size_t)>& once) {
  constexpr std::size_t kWarmUp = 20;
  for (std::size_t i = 0; i < std::min(num, kWarmUp); ++i) once(i);
  std::vector<double> seconds(num);
  for (std::size_t i = 0; i < num; ++i) {
    const auto start = std::chrono::steady_clock::now();
    once(i);
    seconds[i] = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }
  Times times;
  times.num = num;
  if (num == 0) return times;
  std::sort(seconds.begin(), seconds.end());
  const double last = static_cast<double>(num - 1);
  times.median = (seconds[(num - 1) / 2] + seconds[num / 2]) / 2;
  times.p99 = seconds[static_cast<std::size_t>(std::ceil(0.99 * last))];
  times.max = seconds.back();
  times.mean = std::accumulate(seconds.begin(), seconds.end(), 0.0) / static_cast<double>(num);
  double squares = 0;
  for (const double s : seconds) squares += (s - times.mean) * (s - times.mean);
  times.deviation = num > 1 ? std::sqrt(squares / last) : 0;
  return times;
}

}  // namespace palpate::eval
