#include "apps/ros/newest_scene.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "apps/terminal/terminal.h"
#include "apps/touch/sources.h"
#include "src/cloud/internal/frame_limits.h"
#include "src/core/internal/guarded.h"

namespace palpate::apps {

NewestScene::~NewestScene() {
  for (Camera& camera : cameras_) camera.source->cancel();
  for (Camera& camera : cameras_) {
    if (camera.thread.joinable()) camera.thread.join();
  }
}

Status NewestScene::open(const TouchOptions& touch, const SelfFilter& filter) {
  cameras_.reserve(touch.cameras.size());
  for (const CameraUri& uri : touch.cameras) {
    auto source = open_camera(uri, opening());
    if (source) source = filter.applied_to(*std::move(source));
    if (!source) return source.error();
    const DepthStreamInfo& info = (*source)->info();
    SensorOptions options{touch.settings.surface, touch.settings.field};
    use_sensor(info.sensor, touch.given, options.surface);
    use_method(MethodKind::field, touch.given, options.surface);
    options.field.one_of_several = touch.cameras.size() > 1;
    options.num_surfaces = 2;  // one that is asked about, and one that is made meanwhile
    options.num_threads = touch.settings.num_threads;
    auto sensor = Sensor::create({info.width, info.height, info.intrinsics}, Place::cpu(), options);
    if (!sensor) return sensor.error();
    cameras_.push_back({*std::move(source), *std::move(sensor)});
  }
  for (Camera& camera : cameras_) {
    camera.thread = std::thread([this, &camera] {
      guarded([&] { follow(camera); }, [&](const Error& error) { end(camera, error.message); });
    });
  }
  return Done{};
}

void NewestScene::follow(Camera& camera) {
  DepthFrame frame;
  for (;;) {
    const auto got = camera.source->next(frame);
    if (!got || !*got) return end(camera, got ? "the camera is lost" : got.error().message);
    drop_far_codes(frame, camera.source->info().sensor);
    // An image of nothing but the robot tells nothing.
    if (std::ranges::none_of(frame.pixels, [](auto count) { return count != 0; })) continue;
    const SurfaceView surface = camera.sensor.update(frame);
    if (!camera.sensor.status()) return end(camera, camera.sensor.status().error().message);
    const std::lock_guard lock(mutex_);
    camera.surface = surface;
    camera.captured = frame.timestamp;
  }
}

void NewestScene::end(Camera& camera, const std::string& why) {
  const std::lock_guard lock(mutex_);
  camera.ending = why;
}

void NewestScene::with_newest(
    const std::function<void(const Scene&, double, const std::string&)>& measure) {
  const std::lock_guard lock(mutex_);
  Scene scene;
  double oldest = std::numeric_limits<double>::infinity();
  std::string ending;
  for (const Camera& camera : cameras_) {
    if (!camera.ending.empty()) ending = camera.ending;
    if (!camera.surface) continue;
    scene.surfaces.push_back(*camera.surface);
    oldest = std::min(oldest, camera.captured);
  }
  if (scene.surfaces.size() < cameras_.size()) scene.surfaces.clear();
  measure(scene, oldest, ending);
}

void NewestScene::print_notes() {
  for (Camera& camera : cameras_) {
    for (const std::string& note : camera.source->take_notes()) print_beside_progress(note);
  }
}

}  // namespace palpate::apps
