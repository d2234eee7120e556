#include <cmath>
#include <optional>

#include "scenes/scene.h"
#include "src/c/handles.h"

using namespace palpate;

struct palpate_simulation {
  scenes::Scene scene;
  scenes::SimulatedCameraOptions options;
  std::unique_ptr<DepthSource> camera;
  DepthFrame frame;
};

extern "C" {

const char* palpate_simulation_names(void) {
  static const std::string names = [] {
    std::string all;
    for (const std::string& name : scenes::scene_names()) all += (all.empty() ? "" : ",") + name;
    return all;
  }();
  return names.c_str();
}

palpate_simulation* palpate_simulation_create(const char* scene, int32_t width, int32_t height,
                                              double noise, uint64_t seed, palpate_error* error) {
  return guarded_call(
      error, static_cast<palpate_simulation*>(nullptr), [&]() -> palpate_simulation* {
        if (scene == nullptr) return fail(error, "a scene has no name: give one"), nullptr;
        if (!(noise >= 0 && std::isfinite(noise))) {
          return fail(error,
                      "the noise of a simulation is not a number from 0: give 1 for that of a "
                      "structured-light camera"),
                 nullptr;
        }
        auto made = scenes::make_scene(scene);
        if (!made) return fail(error, made.error()), nullptr;
        scenes::set_image_size(*made, width, height);
        scenes::SimulatedCameraOptions options;
        options.seed = seed;
        if (noise == 0) {
          options.noise = {.enabled = false};
          options.unit = 0.0001;
        } else {
          options.noise.axial_base *= noise;
          options.noise.axial_growth *= noise;
        }
        auto camera = scenes::open_simulated_camera(*made, options);
        if (!camera) return fail(error, camera.error()), nullptr;
        return new palpate_simulation{*std::move(made), options, *std::move(camera), {}};
      });
}

void palpate_simulation_free(palpate_simulation* simulation) { delete simulation; }

void palpate_simulation_describe(const palpate_simulation* simulation,
                                 palpate_simulation_info* info) {
  if (simulation == nullptr || !is_given(info)) return;
  const DepthStreamInfo& stream = simulation->camera->info();
  palpate_simulation_info all{};
  all.camera.size = sizeof all.camera;
  all.camera.width = stream.width;
  all.camera.height = stream.height;
  all.camera.fx = stream.intrinsics.fx;
  all.camera.fy = stream.intrinsics.fy;
  all.camera.cx = stream.intrinsics.cx;
  all.camera.cy = stream.intrinsics.cy;
  all.unit = stream.unit;
  all.rate = stream.rate;
  all.duration = simulation->scene.duration;
  all.tool_size = simulation->scene.tool_size;
  copy_text(simulation->scene.tool_shape, all.tool_shape, sizeof all.tool_shape);
  copy_text(simulation->scene.title, all.title, sizeof all.title);
  give(all, info);
}

int palpate_simulation_next(palpate_simulation* simulation, uint16_t* counts, double* time,
                            palpate_pose* X_WC, palpate_error* error) {
  return guarded_call(error, PALPATE_FAILED, [&] {
    if (simulation == nullptr || counts == nullptr) {
      return fail(error,
                  "there is no simulation, or no room for its image: create one, and give width * "
                  "height counts");
    }
    auto next = simulation->camera->next(simulation->frame);
    if (next && !*next) {
      auto anew = scenes::open_simulated_camera(simulation->scene, simulation->options);
      if (!anew) return fail(error, anew.error());
      simulation->camera = *std::move(anew);
      next = simulation->camera->next(simulation->frame);
    }
    if (!next) return fail(error, next.error());
    const DepthFrame& frame = simulation->frame;
    std::copy(frame.pixels.begin(), frame.pixels.end(), counts);
    if (time != nullptr) *time = frame.timestamp;
    if (X_WC != nullptr) *X_WC = c_pose(frame.X_WC);
    return PALPATE_OK;
  });
}

void palpate_simulation_tool_at(const palpate_simulation* simulation, double time,
                                palpate_pose* X_WT) {
  if (simulation == nullptr || X_WT == nullptr) return;
  const scenes::Scene& scene = simulation->scene;
  const auto& times = scene.path_times;
  const auto after =
      static_cast<std::size_t>(std::upper_bound(times.begin(), times.end(), time) - times.begin());
  if (times.empty()) {
    *X_WT = c_pose({});
  } else if (after == 0 || after == times.size()) {
    *X_WT = c_pose(scene.path_poses[after == 0 ? 0 : after - 1]);
  } else {
    const double share = (time - times[after - 1]) / (times[after] - times[after - 1]);
    *X_WT = c_pose(interpolate(scene.path_poses[after - 1], scene.path_poses[after], share));
  }
}

}  // extern "C"
