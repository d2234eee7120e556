#include "src/c/handles.h"

using namespace palpate;

namespace {

constexpr char kNoScene[] = "there is no scene to change: create one";

/// Takes an image, whose size is that of the sensor.
int take_image(palpate_sensor* sensor, DepthImageView image, const palpate_pose* X_WC,
               palpate_error* error) {
  if (sensor == nullptr) return fail(error, "there is no sensor to update: create one");
  image.width = sensor->width, image.height = sensor->height;
  if (image.counts == nullptr && image.meters == nullptr)
    return fail(error, "a depth image has no values: give width * height of them");
  if (X_WC != nullptr) image.X_WC = pose_of(*X_WC);
  const SurfaceView made = sensor->sensor.update(image);
  if (!sensor->sensor.status()) return fail(error, sensor->sensor.status().error());
  sensor->before = sensor->has_surface ? sensor->newest : made;
  sensor->newest = made;
  sensor->has_surface = true;
  return PALPATE_OK;
}

}  // namespace

extern "C" {

palpate_sensor* palpate_sensor_create(const palpate_camera* camera, const char* options,
                                      int32_t num_threads, palpate_error* error) {
  return guarded_call(error, static_cast<palpate_sensor*>(nullptr), [&]() -> palpate_sensor* {
    if (!is_given(camera)) {
      return fail(error, "there is no camera with its size set: describe one, size = sizeof"),
             nullptr;
    }
    const palpate_camera c = taken(camera);
    SensorOptions chosen{.num_surfaces = 2, .num_threads = num_threads};
    if (const Status status = read_options(options, chosen.surface, chosen.field); !status)
      return fail(error, status.error()), nullptr;
    chosen.wants_depth_change = chosen.surface.depth_change.enabled;
    const double* d = c.distortion;
    auto made = Sensor::create({c.width,
                                c.height,
                                {c.fx, c.fy, c.cx, c.cy},
                                {d[0], d[1], d[2], d[3], d[4], d[5], d[6], d[7]}},
                               Place::cpu(), chosen);
    if (!made) return fail(error, made.error()), nullptr;
    return new palpate_sensor{*std::move(made), c.width, c.height, {}, {}};
  });
}

void palpate_sensor_free(palpate_sensor* sensor) { delete sensor; }

int palpate_sensor_update_counts(palpate_sensor* sensor, const uint16_t* counts, double unit,
                                 const palpate_pose* X_WC, palpate_error* error) {
  return guarded_call(error, PALPATE_FAILED, [&] {
    if (!(unit > 0))
      return fail(error, "the unit of a depth image is not above 0: give meters per count");
    return take_image(sensor, {0, 0, counts, unit}, X_WC, error);
  });
}

int palpate_sensor_update_meters(palpate_sensor* sensor, const float* meters,
                                 const palpate_pose* X_WC, palpate_error* error) {
  return guarded_call(error, PALPATE_FAILED, [&] {
    return take_image(sensor, {0, 0, meters}, X_WC, error);
  });
}

palpate_scene* palpate_scene_create(palpate_error* error) {
  return guarded_call(error, static_cast<palpate_scene*>(nullptr),
                      [] { return new palpate_scene; });
}

void palpate_scene_free(palpate_scene* scene) { delete scene; }

int palpate_scene_add_sensor(palpate_scene* scene, const palpate_sensor* sensor,
                             palpate_error* error) {
  return guarded_call(error, PALPATE_FAILED, [&] {
    if (scene == nullptr) return fail(error, kNoScene);
    if (sensor == nullptr) return fail(error, "there is no sensor to add: create one");
    if (scene->sensors.size() == kMaxCameras)
      return fail(error, "a scene has 16 cameras already, which is the most: leave one out");
    scene->sensors.push_back(sensor);
    return PALPATE_OK;
  });
}

int32_t palpate_scene_add_body(palpate_scene* scene, const palpate_tool* shape,
                               const palpate_pose* X_WB, palpate_error* error) {
  return guarded_call(error, PALPATE_FAILED, [&] {
    if (scene == nullptr) return fail(error, kNoScene);
    if (shape == nullptr || X_WB == nullptr)
      return fail(error, "a body has no shape or no pose: give both");
    if (!is_finite(pose_of(*X_WB)))
      return fail(error, "the pose of a body is not finite: give numbers");
    scene->bodies.emplace_back(shape->tool, pose_of(*X_WB));
    return static_cast<int>(scene->bodies.size()) - 1;
  });
}

int palpate_scene_move_body(palpate_scene* scene, int32_t body, const palpate_pose* X_WB,
                            palpate_error* error) {
  return guarded_call(error, PALPATE_FAILED, [&] {
    if (scene == nullptr) return fail(error, kNoScene);
    if (body < 0 || static_cast<size_t>(body) >= scene->bodies.size())
      return fail(error,
                  "there is no body of this number: give one that palpate_scene_add_body returned");
    if (X_WB == nullptr || !is_finite(pose_of(*X_WB)))
      return fail(error, "the pose of a body is missing or not finite: give numbers");
    Body& moved = scene->bodies[static_cast<size_t>(body)];
    moved = moved.at(pose_of(*X_WB));
    return PALPATE_OK;
  });
}

}  // extern "C"
