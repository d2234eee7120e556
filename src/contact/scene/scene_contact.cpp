// Tools in scenes: each thread has queries of its own and takes poses, some at a time.
#include "palpate/contact/scene.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "src/contact/batch/field_batch.h"
#include "src/contact/index/tool_parts.h"
#include "src/contact/scene/scene_answers.h"
#include "src/contact/scene/scene_checks.h"
#include "src/contact/scene/scene_makers.h"

namespace palpate { inline namespace v0 {
namespace {

void add(const Penetration& of_body, const std::optional<Stiffness>& stiffness, ContactResult& to) {
  Penetration& sum = to.penetration;
  sum.volume += of_body.volume;
  sum.potential += of_body.potential;
  sum.measure_W.force += of_body.measure_W.force;
  sum.measure_W.torque += of_body.measure_W.torque;
  sum.status |= of_body.status;
  if (to.stiffness && stiffness) *to.stiffness += *stiffness;
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
    [](SceneMakers::Index index, const ContactMethod& method, const ExecutionOptions& execution) {
      return make_contact_query(Backend::cpu, std::move(index), method, execution);
    },
    [](SceneMakers::Index index, const FieldMethod& method, const ExecutionOptions& execution) {
      return make_batch_query(Backend::cpu, std::move(index), method, execution);
    },
    [](SceneMakers::Index a, SceneMakers::Index b, const ExecutionOptions& execution) {
      return make_body_pair_query(Backend::cpu, std::move(a), std::move(b), {.isa = execution.isa});
    },
    make_clearance_batch};

}  // namespace

struct SceneContact::Impl {
  /// The queries of one thread.
  struct Worker {
    std::vector<std::unique_ptr<ContactQuery>> queries;              // of each tool
    std::vector<std::vector<std::unique_ptr<BodyPairQuery>>> pairs;  // of each tool and shape
    SpherePicture picture;
  };

  ContactMethod method;
  Place place;
  SceneMakers makers;
  std::vector<std::shared_ptr<const ToolIndex>> tools;
  std::vector<double> full_volumes;
  std::size_t max_spheres = 0;
  std::unique_ptr<ThreadPool> pool;
  std::vector<Worker> workers;
  std::unique_ptr<ClearanceBatch> clearances;
  std::unique_ptr<BatchQuery> batches;                   // of a single tool
  std::vector<std::shared_ptr<const ToolIndex>> shapes;  // of the last scene's bodies
  std::vector<std::size_t> shape_of_body;
  std::vector<SurfaceView> surfaces;  // of the scene, with its policy
  std::vector<SurfaceBlend> cameras;

  Status take(const Scene& scene, bool wants_contact);
  Status make_pairs();
  ContactResult measure(Worker& worker, const Scene& scene, std::size_t tool, const Pose& X_WT,
                        const ContactWants& wants) const;
  void measure_pose(Worker& worker, const Scene& scene, const ScenePoses& poses, std::size_t pose,
                    const SceneAnswers& answers) const;
};

/// Takes surfaces and, if contact is wanted, bodies of a scene; those of the last one are kept
/// where they are the same.
Status SceneContact::Impl::take(const Scene& scene, bool wants_contact) {
  if (const Status status = check_scene(scene, method, place); !status) return status;
  surfaces.clear();
  cameras.clear();
  for (const SurfaceView& surface : scene.surfaces) {
    surfaces.push_back(with_policy(surface, scene));
    cameras.push_back({surfaces.back(), surfaces.back(), 1});
  }
  if (!wants_contact) return Done{};
  shape_of_body.clear();
  bool has_new_shape = false;
  for (const Body& body : scene.bodies) {
    const auto& shape = body.placed().shape;
    const auto found = std::find(shapes.begin(), shapes.end(), shape);
    shape_of_body.push_back(static_cast<std::size_t>(found - shapes.begin()));
    if (found != shapes.end()) continue;
    shapes.push_back(shape);
    has_new_shape = true;
  }
  if (!has_new_shape) return Done{};
  const Status status = make_pairs();
  if (!status) shapes.clear();
  return status;
}

Status SceneContact::Impl::make_pairs() {
  for (Worker& worker : workers) {
    worker.pairs.clear();
    for (const auto& tool : tools) {
      auto& of_tool = worker.pairs.emplace_back();
      for (const auto& shape : shapes) {
        auto made = makers.pair(tool, shape, {best_isa(), nullptr, place.gpu});
        if (!made) return made.error();
        of_tool.push_back(*std::move(made));
      }
    }
  }
  return Done{};
}

ContactResult SceneContact::Impl::measure(Worker& worker, const Scene& scene, std::size_t tool,
                                          const Pose& X_WT, const ContactWants& wants) const {
  ContactResult result;
  if (cameras.empty()) {
    if (wants.stiffness) result.stiffness.emplace();
    if (wants.noise) result.noise.emplace();  // bodies have none
    if (!is_finite(X_WT)) result.penetration.status = StepStatus::non_finite_pose;
  } else {
    result = worker.queries[tool]->measure(cameras, X_WT, wants);
  }
  if (result.penetration.status.is_unmeasured()) return result;
  const Pose X{X_WT.translation, normalized(X_WT.rotation)};
  for (std::size_t b = 0; b < scene.bodies.size(); ++b) {
    const BodyPenetration with = worker.pairs[tool][shape_of_body[b]]->measure(
        X, scene.bodies[b].placed().X_WB, wants.stiffness);
    add(with.on_a, with.stiffness_a, result);
  }
  return result;
}

void SceneContact::Impl::measure_pose(Worker& worker, const Scene& scene, const ScenePoses& poses,
                                      std::size_t pose, const SceneAnswers& answers) const {
  const Pose& X_WT = poses.X_WT[pose];
  const std::size_t tool = tool_of(poses, pose);
  ContactWants wants;
  if (answers.max_spheres > 0) {
    worker.picture.resize(tools[tool]->tool().spheres().size());
    std::ranges::fill(worker.picture.states, SphereState::outside);
    std::ranges::fill(worker.picture.deciders, kNoCamera);
    wants = worker.picture.wants();
  }
  wants.stiffness = answers.contact.stiffness != nullptr;
  wants.noise = answers.contact.want_noise();
  wants.unseen_volume = answers.unseen != nullptr;
  const ContactResult result = measure(worker, scene, tool, X_WT, wants);
  put_answers(pose, result, answers.contact);
  if (answers.unseen != nullptr) {
    answers.unseen[pose] = result.penetration.unseen_volume / full_volumes[tool];
  }
  if (answers.group_volume != nullptr) answers.contact.volume[pose] = result.penetration.volume;
  if (answers.max_spheres > 0) {
    put_spheres(pose, worker.picture, tools[tool]->tool().spheres(), X_WT, answers);
  }
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
      auto made = makers.contact(index, method, {best_isa(), nullptr, place.gpu});
      if (!made) return made.error();
      worker.queries.push_back(*std::move(made));
    }
  }
  if (const auto* const field = std::get_if<FieldMethod>(&method)) {
    const ExecutionOptions execution{best_isa(), impl->pool.get(), place.gpu};
    auto clearances = makers.clearance(impl->tools, execution);
    if (!clearances) return clearances.error();
    impl->clearances = *std::move(clearances);
    if (tools.size() == 1) {
      auto batches = makers.batch(impl->tools[0], *field, execution);
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

ContactResult SceneContact::measure(const Scene& scene, const Pose& X_WT,
                                    const ContactWants& wants) const {
  Impl& impl = *impl_;
  if (scene.surfaces.size() == 1 && scene.bodies.empty() && !scene.unseen) {
    return impl.workers[0].queries[0]->measure(scene.surfaces[0], X_WT, wants);
  }
  if (!impl.take(scene, true)) {
    ContactResult result;
    result.penetration.status = StepStatus::no_surface;
    return result;
  }
  return impl.measure(impl.workers[0], scene, 0, X_WT, wants);
}

Status SceneContact::measure(const Scene& scene, const ScenePoses& poses,
                             const SceneAnswers& answers) const {
  Impl& impl = *impl_;
  if (const Status status = check_poses(poses, impl.tools.size()); !status) return status;
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
  if (answers.unseen != nullptr && impl.place.backend != Backend::cpu &&
      scene.surfaces.size() == 1 && scene.surfaces[0].role != SurfaceRole::one_of_several) {
    return Error{Errc::unavailable,
                 "space that one camera by itself does not see is known on the CPU alone; create "
                 "the contact with Place::cpu(), or make the surface to be joined with others"};
  }
  const BatchAnswers& contact = answers.contact;
  const bool wants_contact = contact.volume || contact.potential || contact.force ||
                             contact.torque || contact.stiffness || contact.status ||
                             contact.want_noise() || answers.unseen || answers.max_spheres > 0;
  if (const Status status = impl.take(scene, wants_contact); !status) return status;
  const std::size_t num = poses.X_WT.size();
  const bool is_plain = impl.batches != nullptr && impl.surfaces.size() == 1 &&
                        impl.surfaces[0].role == SurfaceRole::frame && scene.bodies.empty() &&
                        answers.unseen == nullptr && answers.max_spheres == 0;
  if (wants_contact && is_plain) {
    const SurfaceView& surface = impl.surfaces[0];
    PoseBatch batch{poses.X_WT};
    if (!(surface.X_WC == Pose{})) batch.X_WC = {&surface.X_WC, 1};
    const Status status = impl.batches->measure(surface, batch, contact);
    if (!status) return status;
  } else if (wants_contact) {
    for_poses(*impl.pool, num, [&](std::size_t thread, std::size_t i) {
      impl.measure_pose(impl.workers[thread], scene, poses, i, answers);
    });
  }
  if (!wants_clearance) return Done{};
  if (const Status s = impl.clearances->take(impl.surfaces, scene.bodies); !s) return s;
  for (std::size_t i = 0; i < num; ++i) {
    if (is_finite(poses.X_WT[i])) continue;
    put_clearance(i, {}, answers);
    if (contact.status != nullptr) {
      contact.status[i] |= static_cast<std::uint32_t>(StepStatus::non_finite_pose);
    }
  }
  const Status status = impl.clearances->measure(
      poses, limit, answers.clearance_smoothing,
      [&](std::size_t i, const Clearance& at) { put_clearance(i, at, answers); });
  if (status && wants_groups) put_groups(poses, answers);
  return status;
}

Status SceneContact::any(const Scene& scene, const ScenePoses& poses, double margin,
                         std::uint8_t* hits) const {
  Impl& impl = *impl_;
  if (const Status status = check_poses(poses, impl.tools.size()); !status) return status;
  if (const Status s = check_clearance(impl.method, 1, 0); !s) return s;
  if (!std::isfinite(margin)) {
    return Error{Errc::invalid_argument, "the margin is not a number; give it in m"};
  }
  if (const Status status = impl.take(scene, false); !status) return status;
  if (const Status s = impl.clearances->take(impl.surfaces, scene.bodies); !s) return s;
  return impl.clearances->any(poses, margin, hits);
}

}}  // namespace palpate::v0
