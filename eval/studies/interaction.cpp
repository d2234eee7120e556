#include "eval/studies/interaction.h"

#include <utility>

namespace palpate::eval {
namespace {

constexpr const char* kRecording = "frames/pcl_milk_clorox_table.png";
constexpr double kToolSize = 0.12;  // m

Result<Interaction> interaction(std::string name, FirstFrame picture, std::string shape) {
  auto frame = FrozenFrame::create(picture.stream, picture.frame);
  if (!frame) return frame.error();
  return Interaction{std::move(name), std::move(picture), *std::move(frame), std::move(shape),
                     kToolSize};
}

}  // namespace

Result<Interaction> simulated_interaction(Context& context) {
  const auto scene = scenes::make_scene("mannequin");
  if (!scene) return scene.error();
  auto picture = picture_of(context, *scene, true);
  if (!picture) return picture.error();
  return interaction("simulated mannequin, torus", *std::move(picture), "torus");
}

Result<Interaction> recorded_interaction(Context& context) {
  DepthStreamInfo stream;
  auto frames = context.recorded(kRecording, stream);
  if (!frames) return frames.error();
  if (!*frames) return simulated_interaction(context);
  const std::string bunny = (context.settings().data / "meshes_good/bunny_3k.off").string();
  return interaction("recorded table, bunny", {"table", stream, std::move((*frames)->front())},
                     bunny);
}

Result<Interaction> hand_interaction(Context& context) {
  constexpr double kPerson = 1.2;  // m: the wall behind is farther
  DepthStreamInfo stream;
  auto frames = context.recorded("frames/pcl_person.png", stream);
  if (!frames) return frames.error();
  const auto file = context.settings().data / "trajectories/tum_fr1_xyz_handheld_100hz.txt";
  if (!*frames || !std::filesystem::exists(file)) return simulated_interaction(context);
  auto hand = load_trajectory(file);
  if (!hand) return hand.error();
  const std::string bunny = (context.settings().data / "meshes_good/bunny_3k.off").string();
  auto result = interaction("recorded person, bunny, recorded hand",
                            {"person", stream, std::move((*frames)->front())}, bunny);
  if (!result) return result.error();
  result->motion = recorded_hand(*std::move(hand));
  result->farthest = kPerson;
  return result;
}

Result<FirstFrame> picture_of(Context& context, const scenes::Scene& scene, bool with_noise) {
  scenes::SimulatedCameraOptions camera;
  camera.noise.enabled = with_noise;
  camera.unit = with_noise ? 1e-3 : 1e-4;
  camera.duration = 0.01;
  DepthStreamInfo stream;
  auto frames = context.simulated(scene, camera, stream);
  if (!frames) return frames.error();
  return FirstFrame{scene.name, stream, std::move(frames->front())};
}

Result<FrozenFrame> seen_scene(Context& context, const scenes::Scene& scene, bool with_noise) {
  const auto picture = picture_of(context, scene, with_noise);
  if (!picture) return picture.error();
  return FrozenFrame::create(picture->stream, picture->frame);
}

std::unique_ptr<MethodQueries> query_on(const FrozenFrame& frame, const Tool& tool,
                                        Backend backend) {
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
