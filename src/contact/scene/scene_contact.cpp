// Tools in scenes: each thread has queries of its own and takes poses, some at a time.
#include "palpate/contact/scene.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <utility>

#include "src/contact/batch/field_batch.h"
#include "src/contact/clearance/body_distance.h"
#include "src/contact/clearance/clearance.h"
#include "src/contact/index/tool_parts.h"
#include "src/contact/scene/scene_checks.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kPosesAtATime = 64;

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
  std::vector<std::shared_ptr<const ToolIndex>> tools;
  std::vector<double> full_volumes;
  std::vector<ClearanceQuery> clearances;
  std::size_t max_spheres = 0;
  std::unique_ptr<ThreadPool> pool;
  std::vector<Worker> workers;
  std::unique_ptr<BatchQuery> batches;                   // of a single tool
  std::vector<std::shared_ptr<const ToolIndex>> shapes;  // of the last scene's bodies
  std::vector<std::size_t> shape_of_body;
  ClearanceScene clearance_scene;
  std::vector<SurfaceView> surfaces;  // of the scene, with its policy
  std::vector<SurfaceBlend> cameras;

  Status take(const Scene& scene);
  Status make_pairs();
  ContactResult measure(Worker& worker, const Scene& scene, std::size_t tool, const Pose& X_WT,
                        const ContactWants& wants) const;
  void measure_pose(Worker& worker, const Scene& scene, const ScenePoses& poses, std::size_t pose,
                    const SceneAnswers& answers) const;
  void put_spheres(const SpherePicture& picture, std::size_t tool, std::size_t pose,
                   const Pose& X_WT, const SceneAnswers& answers) const;
  Clearance clearance_of(const Scene& scene, std::size_t tool, const Pose& X_WT, double limit,
                         bool wants_gradient) const;
  template <class Work>
  void for_poses(std::size_t num, const Work& work);

  std::size_t tool_of(const ScenePoses& poses, std::size_t pose) const {
    return poses.tool_of_pose.empty() ? 0 : static_cast<std::size_t>(poses.tool_of_pose[pose]);
  }
};

/// Takes surfaces and bodies of a scene; those of the last one are kept where they are the same.
Status SceneContact::Impl::take(const Scene& scene) {
  if (const Status status = check_scene(scene, method, place); !status) return status;
  surfaces.clear();
  cameras.clear();
  for (const SurfaceView& surface : scene.surfaces) {
    surfaces.push_back(with_policy(surface, scene));
    cameras.push_back({surfaces.back(), surfaces.back(), 1});
  }
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
        auto made = make_body_pair_query(place.backend, tool, shape, {.gpu = place.gpu});
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

Clearance SceneContact::Impl::clearance_of(const Scene& scene, std::size_t tool, const Pose& X_WT,
                                           double limit, bool wants_gradient) const {
  Clearance least;
  least.value = limit;
  if (!cameras.empty()) {
    least = clearances[tool].measure(clearance_scene, X_WT, limit, wants_gradient);
  }
  for (std::size_t b = 0; b < scene.bodies.size(); ++b) {
    const PlacedBody& body = scene.bodies[b].placed();
    add_body_clearance(*tools[tool], parts_of(*body.shape).solid_field(), body.X_WB, X_WT,
                       static_cast<int>(cameras.size() + b), least);
  }
  if (least.value <= -limit) least = {-limit};
  return least;
}

void SceneContact::Impl::put_spheres(const SpherePicture& picture, std::size_t tool,
                                     std::size_t pose, const Pose& X_WT,
                                     const SceneAnswers& answers) const {
  const std::span<const Sphere> spheres = tools[tool]->tool().spheres();
  const Mat3d R_WT = rotation_matrix(normalized(X_WT.rotation));
  for (std::size_t i = 0; i < answers.max_spheres; ++i) {
    const std::size_t to = pose * answers.max_spheres + i;
    double depth = 0, volume = 0;
    Vec3d direction;
    std::int8_t decided = kNoCamera;
    if (i < spheres.size() && picture.states[i] != SphereState::outside) {
      const Plane<float>& plane = picture.planes[i];
      const auto radius = static_cast<double>(spheres[i].radius);
      const double distance =
          static_cast<double>(dot(plane.normal, spheres[i].center) - plane.offset);
      depth = std::max(0.0, radius - distance);
      volume = cap_volume(radius, distance);
      direction = R_WT * to_double(plane.normal);
      decided = picture.deciders[i];
    }
    if (answers.sphere_depth != nullptr) answers.sphere_depth[to] = static_cast<float>(depth);
    if (answers.sphere_volume != nullptr) answers.sphere_volume[to] = static_cast<float>(volume);
    if (answers.sphere_decided != nullptr) answers.sphere_decided[to] = decided;
    for (int axis = 0; axis < 3 && answers.sphere_direction != nullptr; ++axis) {
      answers.sphere_direction[3 * to + static_cast<std::size_t>(axis)] =
          static_cast<float>(direction[axis]);
    }
  }
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
  if (answers.max_spheres > 0) put_spheres(worker.picture, tool, pose, X_WT, answers);
}

/// Calls work(worker, pose) for all poses, on all threads.
template <class Work>
void SceneContact::Impl::for_poses(std::size_t num, const Work& work) {
  std::atomic<std::size_t> next = 0;
  pool->parallel_for(static_cast<int>(workers.size()), [&](int thread) {
    Worker& worker = workers[static_cast<std::size_t>(thread)];
    for (std::size_t first = next.fetch_add(kPosesAtATime); first < num;
         first = next.fetch_add(kPosesAtATime)) {
      for (std::size_t i = first; i < std::min(num, first + kPosesAtATime); ++i) work(worker, i);
    }
  });
}

SceneContact::SceneContact(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
SceneContact::SceneContact(SceneContact&&) noexcept = default;
SceneContact& SceneContact::operator=(SceneContact&&) noexcept = default;
SceneContact::~SceneContact() = default;

std::size_t SceneContact::max_spheres() const { return impl_->max_spheres; }

Result<SceneContact> SceneContact::create(std::span<const Tool* const> tools,
                                          const ContactMethod& method, const Place& place,
                                          int num_threads) {
  if (tools.empty()) {
    return Error{Errc::invalid_argument, "a contact was given no tool; give one or more"};
  }
  auto impl = std::make_unique<Impl>();
  impl->method = method;
  impl->place = place;
  const bool is_cpu = place.backend == Backend::cpu;
  impl->pool = std::make_unique<ThreadPool>(is_cpu ? num_threads : 1);
  for (const Tool* const tool : tools) {
    impl->tools.push_back(ToolIndex::create(*tool));
    impl->full_volumes.push_back(full_volume(*tool, contact_options(method)));
    impl->clearances.emplace_back(*impl->tools.back(), best_isa());
    impl->max_spheres = std::max(impl->max_spheres, tool->spheres().size());
  }
  impl->workers.resize(static_cast<std::size_t>(impl->pool->num_threads()));
  for (Impl::Worker& worker : impl->workers) {
    for (const auto& index : impl->tools) {
      auto made =
          make_contact_query(place.backend, index, method, {best_isa(), nullptr, place.gpu});
      if (!made) return made.error();
      worker.queries.push_back(*std::move(made));
    }
  }
  if (tools.size() == 1 && std::holds_alternative<FieldMethod>(method)) {
    auto made = make_batch_query(place.backend, impl->tools[0], method,
                                 {best_isa(), impl->pool.get(), place.gpu});
    if (!made) return made.error();
    impl->batches = *std::move(made);
  }
  return SceneContact(std::move(impl));
}

ContactResult SceneContact::measure(const Scene& scene, const Pose& X_WT,
                                    const ContactWants& wants) const {
  Impl& impl = *impl_;
  if (scene.surfaces.size() == 1 && scene.bodies.empty() && !scene.unseen) {
    return impl.workers[0].queries[0]->measure(scene.surfaces[0], X_WT, wants);
  }
  if (!impl.take(scene)) {
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
    const Status status = check_clearance(impl.method, impl.place, limit);
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
      scene.surfaces.size() == 1) {
    return Error{Errc::unavailable,
                 "space that one camera by itself does not see is known on the CPU alone; create "
                 "the contact "
                 "with Place::cpu(), or leave it out"};
  }
  if (const Status status = impl.take(scene); !status) return status;
  const BatchAnswers& contact = answers.contact;
  const bool wants_contact = contact.volume || contact.potential || contact.force ||
                             contact.torque || contact.stiffness || contact.status ||
                             contact.want_noise() || answers.unseen || answers.max_spheres > 0;
  const std::size_t num = poses.X_WT.size();
  const bool is_plain = impl.batches != nullptr && impl.surfaces.size() == 1 &&
                        scene.bodies.empty() && answers.unseen == nullptr &&
                        answers.max_spheres == 0;
  if (wants_contact && is_plain) {
    const SurfaceView& surface = impl.surfaces[0];
    PoseBatch batch{poses.X_WT};
    if (!(surface.X_WC == Pose{})) batch.X_WC = {&surface.X_WC, 1};
    const Status status = impl.batches->measure(surface, batch, contact);
    if (!status) return status;
  } else if (wants_contact) {
    impl.for_poses(num, [&](Impl::Worker& worker, std::size_t i) {
      impl.measure_pose(worker, scene, poses, i, answers);
    });
  }
  if (!wants_clearance) return Done{};
  if (const Status s = impl.clearance_scene.update(impl.surfaces, *impl.pool); !s) return s;
  impl.for_poses(num, [&](Impl::Worker&, std::size_t i) {
    const Pose& X_WT = poses.X_WT[i];
    Clearance at;
    if (is_finite(X_WT)) {
      at = impl.clearance_of(scene, impl.tool_of(poses, i), X_WT, limit,
                             answers.clearance_gradient != nullptr);
    } else if (contact.status != nullptr) {
      contact.status[i] |= static_cast<std::uint32_t>(StepStatus::non_finite_pose);
    }
    if (answers.clearance != nullptr) answers.clearance[i] = at.value;
    if (answers.nearest != nullptr) answers.nearest[i] = at.sphere;
    if (answers.decided != nullptr) answers.decided[i] = at.decider;
    if (answers.clearance_gradient != nullptr) {
      std::copy_n(at.gradient, 6, answers.clearance_gradient + 6 * i);
    }
  });
  if (!wants_groups) return Done{};
  for (std::size_t g = 0; g < static_cast<std::size_t>(poses.num_groups); ++g) {
    if (answers.group_clearance != nullptr) answers.group_clearance[g] = limit;
    if (answers.group_pose != nullptr) answers.group_pose[g] = -1;
    if (answers.group_volume != nullptr) answers.group_volume[g] = 0;
  }
  std::vector<double> least(static_cast<std::size_t>(poses.num_groups), limit);
  for (std::size_t i = 0; i < num; ++i) {
    const auto g = static_cast<std::size_t>(poses.group_of_pose[i]);
    if (answers.group_volume != nullptr) answers.group_volume[g] += contact.volume[i];
    if (!(answers.clearance[i] < least[g])) continue;
    least[g] = answers.clearance[i];
    if (answers.group_clearance != nullptr) answers.group_clearance[g] = least[g];
    if (answers.group_pose != nullptr) answers.group_pose[g] = static_cast<std::int32_t>(i);
  }
  return Done{};
}

Status SceneContact::any(const Scene& scene, const ScenePoses& poses, double margin,
                         std::uint8_t* hits) const {
  Impl& impl = *impl_;
  if (const Status status = check_poses(poses, impl.tools.size()); !status) return status;
  if (const Status s = check_clearance(impl.method, impl.place, 1); !s) return s;
  if (!std::isfinite(margin)) {
    return Error{Errc::invalid_argument, "the margin is not a number; give it in m"};
  }
  if (const Status status = impl.take(scene); !status) return status;
  if (const Status s = impl.clearance_scene.update(impl.surfaces, *impl.pool); !s) return s;
  const bool has_groups = !poses.group_of_pose.empty();
  const std::size_t num = poses.X_WT.size();
  std::fill_n(hits, has_groups ? static_cast<std::size_t>(poses.num_groups) : num, 0);
  impl.for_poses(num, [&](Impl::Worker&, std::size_t i) {
    const Pose& X_WT = poses.X_WT[i];
    std::uint8_t& hit = hits[has_groups ? static_cast<std::size_t>(poses.group_of_pose[i]) : i];
    if (__atomic_load_n(&hit, __ATOMIC_RELAXED) != 0) return;  // of its group
    const std::size_t tool = impl.tool_of(poses, i);
    bool is_hit = !is_finite(X_WT);
    if (!is_hit && !impl.cameras.empty()) {
      is_hit = impl.clearances[tool].is_within(impl.clearance_scene, X_WT, margin);
    }
    for (std::size_t b = 0; !is_hit && b < scene.bodies.size(); ++b) {
      const PlacedBody& body = scene.bodies[b].placed();
      Clearance least;
      least.value = margin;
      add_body_clearance(*impl.tools[tool], parts_of(*body.shape).solid_field(), body.X_WB, X_WT, 0,
                         least);
      is_hit = least.value < margin;
    }
    if (is_hit) __atomic_store_n(&hit, std::uint8_t{1}, __ATOMIC_RELAXED);
  });
  return Done{};
}

}}  // namespace palpate::v0
