#include "eval/interaction.h"

#include <utility>

namespace palpate::eval {
namespace {

constexpr const char* kRecording = "frames/pcl_milk_clorox_table.png";
constexpr double kToolSize = 0.12;  // m

}  // namespace

Result<Interaction> simulated_interaction(Context& context) {
  const auto scene = scenes::make_scene("mannequin");
  if (!scene) return scene.error();
  auto frame = seen_scene(context, *scene, true);
  if (!frame) return frame.error();
  return Interaction{"simulated mannequin, torus", *std::move(frame), "torus", kToolSize};
}

Result<Interaction> recorded_interaction(Context& context) {
  DepthStreamInfo stream;
  const auto frames = context.recorded(kRecording, stream);
  if (!frames) return frames.error();
  if (!*frames) return simulated_interaction(context);
  auto frame = SeenFrame::create(stream, (*frames)->front());
  if (!frame) return frame.error();
  const std::string bunny = (context.settings().data / "meshes_good/bunny_3k.off").string();
  return Interaction{"recorded table, bunny", *std::move(frame), bunny, kToolSize};
}

Result<Interaction> hand_interaction(Context& context) {
  constexpr double kPerson = 1.2;  // m: the wall behind is farther
  DepthStreamInfo stream;
  const auto frames = context.recorded("frames/pcl_person.png", stream);
  if (!frames) return frames.error();
  const auto file = context.settings().data / "trajectories/tum_fr1_xyz_handheld_100hz.txt";
  if (!*frames || !std::filesystem::exists(file)) return simulated_interaction(context);
  auto hand = load_trajectory(file);
  if (!hand) return hand.error();
  auto frame = SeenFrame::create(stream, (*frames)->front());
  if (!frame) return frame.error();
  const std::string bunny = (context.settings().data / "meshes_good/bunny_3k.off").string();
  return Interaction{"recorded person, bunny, recorded hand",
                     *std::move(frame),
                     bunny,
                     kToolSize,
                     recorded_hand(*std::move(hand)),
                     kPerson};
}

Result<SeenFrame> seen_scene(Context& context, const scenes::Scene& scene, bool with_noise) {
  scenes::SimulatedCameraOptions camera;
  camera.noise.enabled = with_noise;
  camera.unit = with_noise ? 1e-3 : 1e-4;
  camera.duration = 0.01;
  DepthStreamInfo stream;
  const auto frames = context.simulated(scene, camera, stream);
  if (!frames) return frames.error();
  return SeenFrame::create(stream, frames->front());
}

std::unique_ptr<MethodQueries> query_on(const SeenFrame& frame, const Tool& tool, Backend backend) {
  auto query = std::make_unique<MethodQueries>(backend, tool);
  query->set_cloud(frame.cloud());
  query->set_field(frame.field());
  return query;
}

Times time_queries(MethodQueries& query, const ContactOptions& options,
                   const std::vector<Pose>& path) {
  query.by(options);
  return time_calls(path.size(), [&](std::size_t i) { query.query(path[i], options); });
}

}  // namespace palpate::eval
