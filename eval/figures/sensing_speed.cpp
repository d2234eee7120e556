// sensing: time of a depth frame before the first query.
#include <vector>

#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"
#include "palpate/core/core.h"

namespace palpate::eval {
namespace {

constexpr double kFrame = 1000.0 / 30;  // ms, of a camera with 30 frames a second

/// Medians of one image size, ms.
struct Cost {
  int width, height;
  double surface = 0, field = 0;  ///< on one thread
  double both = 0;                ///< on all cores
};

/// Measures one image size. `done`: progress of the figure before it.
Result<Cost> cost_of(Context& context, int width, int height, double done) {
  auto scene = scenes::make_scene("hand");
  if (!scene) return scene.error();
  scenes::set_image_size(*scene, width, height);
  scenes::SimulatedCameraOptions camera;
  camera.duration = 0.01;
  DepthStreamInfo stream;
  const auto frames = context.simulated(*scene, camera, stream);
  if (!frames) return frames.error();
  auto surface = SurfaceEstimator::create(stream.width, stream.height, stream.intrinsics);
  if (!surface) return surface.error();
  auto field = DepthField::create(stream.width, stream.height);
  if (!field) return field.error();
  const DepthFrame& frame = frames->front();
  const auto median = [&](auto&& work) {
    context.progress(done);
    return 1e3 *
           time_calls(context.choose<std::size_t>(30, 10), [&](std::size_t) { work(); }).median;
  };
  ThreadPool one(1), all(0);
  Cost cost{width, height};
  cost.surface = median([&] { surface->update(frame, one); });
  cost.field = median([&] { field->update(surface->cloud(), one); });
  cost.both = median([&] {
    surface->update(frame, all);
    field->update(surface->cloud(), all);
  });
  return cost;
}

Result<FigureResult> figure_sensing(Context& context) {
  FigureResult result;
  Table table{"Median time of a depth frame, ms",
              {"image", "filter and normals, one core", "field, one core", "both, all cores"},
              {}};
  std::vector<Cost> costs;
  for (const auto& [width, height] : {std::pair{640, 480}, {1280, 720}, {1920, 1080}}) {
    const auto cost = cost_of(context, width, height, static_cast<double>(costs.size()) / 3);
    if (!cost) return cost.error();
    const std::string size = words("%dx%d", width, height);
    table.rows.push_back({words("%d × %d", width, height), words("%.1f", cost->surface),
                          words("%.1f", cost->field), words("%.1f", cost->both)});
    result.numbers.push_back({size + ".surface", cost->surface, "ms"});
    result.numbers.push_back({size + ".field", cost->field, "ms"});
    result.numbers.push_back({size + ".both", cost->both, "ms"});
    costs.push_back(*cost);
  }
  const double kinect = costs[0].surface + costs[0].field;
  result.claims.push_back(
      {"A frame takes 3 ms (on a GTX 780).",
       words("%.1f ms on one CPU core of today, all included: another machine.", kinect),
       Verdict::not_comparable});
  result.claims.push_back(
      {"One core makes a frame of 640 × 480 pixels ready faster than the camera gives one.",
       words("%.1f ms, of which the field takes %.1f; the camera takes %.0f.", kinect,
             costs[0].field, kFrame),
       holds_below(kinect, kFrame), Source::docs});

  result.tables.push_back(std::move(table));
  result.notes.push_back(
      words("First frame of the scene hand, with the noise of a Kinect; %d cores.",
            ThreadPool(0).num_threads()));
  return result;
}

}  // namespace

std::vector<FigureSpec> sensing_speed() {
  return {{"sensing", "What a depth frame costs", "Speed", figure_sensing}};
}

}  // namespace palpate::eval
