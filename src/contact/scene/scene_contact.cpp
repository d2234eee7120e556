// Tools in scenes: each thread has queries of its own and takes poses, some at a time.
#include "palpate/contact/scene.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "src/contact/batch/field_batch.h"
#include "src/contact/bodies/body_pair.h"
#include "src/contact/bodies/shapes_of_scene.h"
#include "src/contact/hull/camera_seats.h"
#include "src/contact/index/tool_parts.h"
#include "src/contact/internal/joint_tree.h"
#include "src/contact/scene/scene_answers.h"
#include "src/contact/scene/scene_checks.h"
#include "src/contact/scene/scene_makers.h"

namespace palpate { inline namespace v0 {
namespace {

void add(const BodyPenetration& with, ContactResult& to) {
  const Penetration& of_body = with.on_a;
  Penetration& sum = to.penetration;
  sum.volume += of_body.volume;
  sum.potential += of_body.potential;
  sum.measure_W.force += of_body.measure_W.force;
  sum.measure_W.torque += of_body.measure_W.torque;
  sum.status |= of_body.status;
  if (!to.stiffness || !with.stiffness_a) return;
  *to.stiffness += *with.stiffness_a;
  add_moments(with.moments_a, to.moments);
}

Error margin_error() {
  return {Errc::invalid_argument, "the margin is not a number; give it in m"};
}

Error one_by_one_error() {
  return {Errc::invalid_argument,
          "spheres, and surfaces of a window, are measured pose by pose; give poses and answers in "
          "host memory"};
}

SurfaceView with_policy(SurfaceView surface, const Scene& scene) {
  if (!scene.unseen) return surface;
  const auto thickness = static_cast<float>(scene.thickness);
  switch (*scene.unseen) {
    case UnseenSpace::solid: surface.field.thickness = static_cast<float>(kSolidBehind); break;
    case UnseenSpace::free: surface.field.thickness = thickness; break;
    case UnseenSpace::fade: surface.field.thickness = -thickness; break;
  }
  return surface;
}

constexpr SceneMakers kCpuMakers{
    [](SceneMakers::Index index, const ContactMethod& method, int) {
      return make_contact_query(Place::cpu(), std::move(index), method);
    },
    [](SceneMakers::Index index, const FieldMethod& method, ThreadPool& pool, int) {
      return make_batch_query(Place::cpu(), std::move(index), method, {best_isa(), &pool});
    },
    [](SceneMakers::Index a, SceneMakers::Index b, int) {
      return make_body_pair_query(Place::cpu(), std::move(a), std::move(b));
    },
    [](std::span<const SceneMakers::Index> tools, ThreadPool& pool, int) {
      return make_clearance_batch(tools, pool);
    },
    nullptr};

}  // namespace

struct SceneContact::Impl {
  /// The queries of one thread.
  struct Worker {
    std::vector<std::unique_ptr<ContactQuery>> queries;  // of each tool
    mutable SpherePicture picture;
  };
  /// A shape with each tool, for each thread.
  using Pairs = std::vector<std::vector<std::unique_ptr<BodyPairQuery>>>;

  ContactMethod method;
  Place place;
  SceneMakers makers;
  std::vector<std::shared_ptr<const ToolIndex>> tools;
  std::vector<double> full_volumes;
  std::size_t max_spheres = 0;
  std::unique_ptr<ThreadPool> pool;
  std::vector<Worker> workers;
  std::unique_ptr<ClearanceBatch> clearances;
  std::unique_ptr<BatchQuery> batches;  // of a single tool
  std::unique_ptr<SceneBatch> scenes;   // on a GPU
  ShapesOfScene<Pairs> pairs;
  std::vector<SurfaceView> surfaces;  // of the scene, with its policy
  std::vector<SurfaceBlend> cameras;

  Status take(const Scene& scene);
  Status take_bodies(const Scene& scene);
  Result<Pairs> pairs_of(const std::shared_ptr<const ToolIndex>& shape) const;
  ContactResult measure(std::size_t thread, const Scene& scene, std::size_t tool, const Pose& X_WT,
                        const ContactWants& wants, double* in_bodies = nullptr) const;
  void measure_pose(std::size_t thread, const Scene& scene, const ScenePoses& poses,
                    std::size_t pose, const SceneAnswers& answers) const;
  using Queue = std::optional<CallerStream>;
  Status measure_at_once(const Scene& scene, const ScenePoses& poses, const SceneAnswers& answers,
                         Queue stream);
  Status measure_contact(const Scene& scene, const ScenePoses& poses, const SceneAnswers& answers,
                         Queue stream);
};

/// Takes the surfaces of a scene.
Status SceneContact::Impl::take(const Scene& scene) {
  if (const Status status = check_scene(scene, method, place); !status) return status;
  surfaces.clear();
  cameras.clear();
  for (const SurfaceView& surface : scene.surfaces) {
    surfaces.push_back(with_policy(surface, scene));
    cameras.push_back({surfaces.back(), surfaces.back(), 1});
  }
  return Done{};
}

/// Makes the queries of its bodies; those of the last scene are kept where they are the same.
Status SceneContact::Impl::take_bodies(const Scene& scene) {
  return pairs.take(
      scene.bodies.size(),
      [&](std::size_t b) -> const auto& { return scene.bodies[b].placed().shape; },
      [this](const auto& shape) { return pairs_of(shape); });
}

Result<SceneContact::Impl::Pairs> SceneContact::Impl::pairs_of(
    const std::shared_ptr<const ToolIndex>& shape) const {
  Pairs made(workers.size());
  for (auto& of_worker : made) {
    for (const auto& tool : tools) {
      auto pair = makers.pair(tool, shape, place.gpu);
      if (!pair) return pair.error();
      of_worker.push_back(*std::move(pair));
    }
  }
  return made;
}

ContactResult SceneContact::Impl::measure(std::size_t thread, const Scene& scene, std::size_t tool,
                                          const Pose& X_WT, const ContactWants& wants,
                                          double* in_bodies) const {
  ContactResult result;
  if (cameras.empty()) {
    if (wants.stiffness) result.stiffness.emplace();
    if (wants.noise) result.noise.emplace();  // bodies have none
    if (!is_finite(X_WT)) result.penetration.status = StepStatus::non_finite_pose;
  } else {
    result = workers[thread].queries[tool]->measure(cameras, X_WT, wants);
  }
  if (result.penetration.status.is_unmeasured()) return result;
  const Pose X{X_WT.translation, normalized(X_WT.rotation)};
  for (std::size_t b = 0; b < scene.bodies.size(); ++b) {
    const BodyPenetration with =
        pairs.of_body(b)[thread][tool]->measure(X, scene.bodies[b].placed().X_WB, wants.stiffness);
    add(with, result);
    if (in_bodies != nullptr) *in_bodies += with.on_a.volume;
  }
  return result;
}

void SceneContact::Impl::measure_pose(std::size_t thread, const Scene& scene,
                                      const ScenePoses& poses, std::size_t pose,
                                      const SceneAnswers& answers) const {
  SpherePicture& picture = workers[thread].picture;
  const Pose& X_WT = poses.X_WT[pose];
  const std::size_t tool = tool_of(poses, pose);
  ContactWants wants;
  if (answers.max_spheres > 0) {
    picture.resize(tools[tool]->tool().spheres().size());
    std::ranges::fill(picture.states, SphereState::outside);
    std::ranges::fill(picture.deciders, kNoCamera);
    wants = picture.wants();
  }
  wants.stiffness = answers.contact.stiffness != nullptr;
  wants.noise = answers.contact.want_noise();
  wants.unseen_volume = answers.unseen != nullptr;
  const ContactResult result = measure(thread, scene, tool, X_WT, wants);
  put_answers(pose, result, answers.contact);
  if (answers.unseen != nullptr) {
    answers.unseen[pose] = std::min(1.0, result.penetration.unseen_volume / full_volumes[tool]);
  }
  if (answers.group_volume != nullptr) answers.contact.volume[pose] = result.penetration.volume;
  if (answers.max_spheres > 0) {
    put_spheres(pose, picture, tools[tool]->tool().spheres(), X_WT, answers);
  }
}

/// Measures all poses on a GPU in one launch, but no spheres.
Status SceneContact::Impl::measure_at_once(const Scene& scene, const ScenePoses& poses,
                                           const SceneAnswers& answers, Queue stream) {
  std::vector<PlacedBody> bodies;
  for (const Body& body : scene.bodies) bodies.push_back(body.placed());
  const SceneBatchPoses of{poses.X_WT, poses.gpu, poses.tool_of_pose, false, {}};
  std::vector<SurfaceView> shown = surfaces;
  const bool is_by_itself =
      shown.size() == 1 && shown[0].role == SurfaceRole::one_of_several && !is_remembered(shown[0]);
  if (is_by_itself) {
    // Its own field counts by itself; what it does not see is known by the hull.
    if (answers.unseen != nullptr) {
      const BatchAnswers none{.gpu = answers.contact.gpu};
      if (const Status s = scenes->take(shown, bodies, stream); !s) return s;
      if (const Status s = scenes->measure(of, none, answers.unseen, stream); !s) return s;
    }
    shown[0].role = has_in_front(shown[0]) ? SurfaceRole::with_memory : SurfaceRole::frame;
    shown[0].seen_free = {};
  }
  if (const Status s = scenes->take(shown, bodies, stream); !s) return s;
  return scenes->measure(of, answers.contact, is_by_itself ? nullptr : answers.unseen, stream);
}

Status SceneContact::Impl::measure_contact(const Scene& scene, const ScenePoses& poses,
                                           const SceneAnswers& answers, Queue stream) {
  const BatchAnswers& contact = answers.contact;
  const bool has_spheres = answers.max_spheres > 0;
  const bool has_unseen = answers.unseen != nullptr;
  if (batches != nullptr && surfaces.size() == 1 && surfaces[0].role == SurfaceRole::frame &&
      scene.bodies.empty() && (!has_unseen || scenes != nullptr) && !has_spheres) {
    PoseBatch batch{.X_WT = poses.X_WT, .gpu = poses.gpu};
    if (!(surfaces[0].X_WC == Pose{})) batch.X_WC = {&surfaces[0].X_WC, 1};
    const Status s = batches->measure(surfaces[0], batch, contact, stream);
    if (!s || !has_unseen) return s;
    return measure_at_once(scene, poses,
                           {.contact = {.gpu = contact.gpu}, .unseen = answers.unseen}, stream);
  }
  SceneAnswers one_by_one = answers;
  const bool is_at_once = scenes != nullptr && is_for_batch(surfaces);
  const bool is_there = poses.gpu != kHostMemory || contact.gpu != kHostMemory;
  if (is_there && (has_spheres || !is_at_once)) return one_by_one_error();
  if (is_at_once) {
    const Status s = measure_at_once(scene, poses, answers, stream);
    if (!s || !has_spheres) return s;
    one_by_one.contact = {};
    one_by_one.unseen = one_by_one.group_volume = nullptr;
  }
  if (const Status s = take_bodies(scene); !s) return s;
  for_poses(*pool, poses.X_WT.size(), [&](std::size_t thread, std::size_t i) {
    measure_pose(thread, scene, poses, i, one_by_one);
  });
  return Done{};
}

SceneContact::SceneContact(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
SceneContact::SceneContact(SceneContact&&) noexcept = default;
SceneContact& SceneContact::operator=(SceneContact&&) noexcept = default;
SceneContact::~SceneContact() = default;

std::size_t SceneContact::max_spheres() const { return impl_->max_spheres; }

Result<SceneContact> SceneContactMaker::make(std::span<const Tool* const> tools,
                                             const ContactMethod& method, const Place& place,
                                             int num_threads, const SceneMakers& makers) {
  if (tools.empty()) {
    return Error{Errc::invalid_argument, "a contact was given no tool; give one or more"};
  }
  auto impl = std::make_unique<SceneContact::Impl>();
  impl->method = method;
  impl->place = place;
  impl->makers = makers;
  impl->pool = std::make_unique<ThreadPool>(place.backend == Backend::cpu ? num_threads : 1);
  for (const Tool* const tool : tools) {
    impl->tools.push_back(ToolIndex::create(*tool));
    impl->full_volumes.push_back(full_volume(*tool, contact_options(method)));
    impl->max_spheres = std::max(impl->max_spheres, tool->spheres().size());
  }
  impl->workers.resize(static_cast<std::size_t>(impl->pool->num_threads()));
  for (SceneContact::Impl::Worker& worker : impl->workers) {
    for (const auto& index : impl->tools) {
      auto made = makers.contact(index, method, place.gpu);
      if (!made) return made.error();
      worker.queries.push_back(*std::move(made));
    }
  }
  if (const auto* const field = std::get_if<FieldMethod>(&method)) {
    auto clearances = makers.clearance(impl->tools, *impl->pool, place.gpu);
    if (!clearances) return clearances.error();
    impl->clearances = *std::move(clearances);
    if (makers.scenes != nullptr) {
      auto scenes = makers.scenes(impl->tools, field->volumes, place.gpu);
      if (!scenes) return scenes.error();
      impl->scenes = *std::move(scenes);
    }
    if (tools.size() == 1) {
      auto batches = makers.batch(impl->tools[0], *field, *impl->pool, place.gpu);
      if (!batches) return batches.error();
      impl->batches = *std::move(batches);
    }
  }
  return SceneContact(std::move(impl));
}

Result<SceneContact> SceneContact::create(std::span<const Tool* const> tools,
                                          const ContactMethod& method, const Place& place,
                                          int num_threads) {
  if (place.backend == Backend::cpu) {
    return SceneContactMaker::make(tools, method, place, num_threads, kCpuMakers);
  }
#if defined(PALPATE_CUDA)
  return SceneContactMaker::make(tools, method, place, num_threads, cuda_makers());
#else
  return find_gpus().error();
#endif
}

ContactResult SceneContact::measure(const Scene& scene, const Pose& X_WT, const ContactWants& wants,
                                    double* in_bodies) const {
  Impl& impl = *impl_;
  if (in_bodies != nullptr) *in_bodies = 0;
  if (scene.surfaces.size() == 1 && scene.bodies.empty() && !scene.unseen) {
    return impl.workers[0].queries[0]->measure(scene.surfaces[0], X_WT, wants);
  }
  if (!impl.take(scene) || !impl.take_bodies(scene)) {
    ContactResult result;
    result.penetration.status = StepStatus::no_surface;
    return result;
  }
  return impl.measure(0, scene, 0, X_WT, wants, in_bodies);
}

Status SceneContact::measure(const Scene& scene, const ScenePoses& poses,
                             const SceneAnswers& answers,
                             std::optional<CallerStream> stream) const {
  Impl& impl = *impl_;
  if (const Status status = check_poses(poses, impl.tools.size()); !status) return status;
  for (const int gpu : {poses.gpu, answers.contact.gpu}) {
    if (const Status status = check_memory(gpu, impl.place); !status) return status;
  }
  if (const Status s = check_noise(answers.contact, impl.method); !s) return s;
  const bool wants_clearance = answers.clearance || answers.nearest || answers.decided ||
                               answers.clearance_gradient || answers.group_clearance ||
                               answers.group_pose;
  const double limit = answers.clearance_limit;
  if (wants_clearance) {
    const Status status = check_clearance(impl.method, limit, answers.clearance_smoothing);
    if (!status) return status;
  }
  const bool wants_groups = answers.group_clearance || answers.group_pose || answers.group_volume;
  if (wants_groups && (poses.group_of_pose.empty() || answers.clearance == nullptr ||
                       answers.contact.volume == nullptr)) {
    return Error{Errc::invalid_argument,
                 "results of groups were asked without group_of_pose, clearance and volume; give "
                 "these, too"};
  }
  if (wants_groups && answers.contact.gpu != kHostMemory) {
    return Error{Errc::invalid_argument,
                 "results of groups are put together in host memory; give all answers there, or "
                 "ask for poses alone"};
  }
  const BatchAnswers& contact = answers.contact;
  const bool wants_contact = contact.volume || contact.potential || contact.force ||
                             contact.torque || contact.stiffness || contact.status ||
                             contact.want_noise() || answers.unseen || answers.max_spheres > 0;
  if (const Status status = impl.take(scene); !status) return status;
  if (wants_clearance) {
    if (const Status s = impl.clearances->take(impl.surfaces, scene.bodies, stream); !s) return s;
  }
  if (wants_contact) {
    if (const Status s = impl.measure_contact(scene, poses, answers, stream); !s) return s;
  }
  if (!wants_clearance) return Done{};
  const Status status = impl.clearances->measure(poses, answers, stream);
  if (status && wants_groups) put_groups(poses, answers);
  return status;
}

Status SceneContact::any(const Scene& scene, const ScenePoses& poses, double margin,
                         std::uint8_t* hits, std::optional<CallerStream> stream) const {
  Impl& impl = *impl_;
  if (const Status status = check_poses(poses, impl.tools.size()); !status) return status;
  if (const Status status = check_memory(poses.gpu, impl.place); !status) return status;
  if (const Status s = check_clearance(impl.method, 1, 0); !s) return s;
  if (!std::isfinite(margin)) return margin_error();
  if (const Status status = impl.take(scene); !status) return status;
  if (const Status s = impl.clearances->take(impl.surfaces, scene.bodies, stream); !s) return s;
  return impl.clearances->any(poses, margin, hits, stream);
}

Result<std::optional<RefusedPosition>> SceneContactMaker::measure_tree(const SceneContact& contact,
                                                                       const Scene& scene,
                                                                       const JointPoses& poses,
                                                                       const TreeAnswers& answers) {
  SceneContact::Impl& impl = *contact.impl_;
  const double limit = answers.hits != nullptr ? 1 : answers.limit;
  if (const Status s = check_clearance(impl.method, limit, 0); !s) return s.error();
  if (!std::isfinite(answers.limit)) return margin_error();
  if (const Status s = impl.take(scene); !s) return s.error();
  if (const Status s = impl.clearances->take(impl.surfaces, scene.bodies, {}); !s) return s.error();
  return impl.clearances->measure_tree(poses, answers);
}

Result<std::optional<RefusedPosition>> measure_tree(const SceneContact& contact, const Scene& scene,
                                                    const JointPoses& poses,
                                                    const TreeAnswers& answers) {
  return SceneContactMaker::measure_tree(contact, scene, poses, answers);
}

}}  // namespace palpate::v0
