#include <limits>

#include "src/c/handles.h"

using namespace palpate;

struct palpate_contact {
  const palpate_tool* tool;
  ContactMethod method;
  SceneContact contact;
};

namespace {

/// Measures one pose, and adds `weight` times the result to what the caller gets, the first one
/// onto nothing, so that also the signs of zeros stay. Counts, states and planes are the last
/// one's.
ContactResult add_measured(const palpate_contact& contact, const Scene& scene, const Pose& X_WT,
                           const ContactWants& wants, double weight, bool is_first,
                           palpate_measure& to) {
  double in_bodies = 0;
  ContactResult result = contact.contact.measure(scene, X_WT, wants, &in_bodies);
  const auto put_one = [&](double value, double& sum) {
    sum = is_first ? weight * value : sum + weight * value;
  };
  const Penetration& p = result.penetration;
  to.status |= p.status.bits;
  to.num_boundary = p.num_boundary_spheres;
  to.num_inside = p.num_inside_spheres;
  put_one(p.volume, to.volume);
  put_one(p.potential, to.potential);
  for (int i = 0; i < 3; ++i) {
    put_one(p.measure_W.force[i], to.force[i]);
    put_one(p.measure_W.torque[i], to.torque[i]);
    for (int j = 0; j < 3; ++j) put_one(result.moments.first[i][j], to.moments[3 * i + j]);
  }
  put_one(result.moments.polar, to.polar_moment);
  put_one(in_bodies, to.bodies_volume);
  for (int i = 0; i < 36 && result.stiffness; ++i)
    put_one(result.stiffness->m[i / 6][i % 6], to.stiffness[i]);
  return result;
}

void put_sigma(const std::optional<MeasureNoise>& noise, palpate_measure& to) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  to.volume_sigma = noise ? noise->volume_std() : kNone;
  put(noise ? noise->force_std() : Vec3d{kNone, kNone, kNone}, to.force_sigma);
  put(noise ? noise->torque_std() : Vec3d{kNone, kNone, kNone}, to.torque_sigma);
}

/// Returns what a query lacks, in one sentence; null: nothing.
const char* lack(const palpate_contact* contact, const palpate_scene* scene,
                 const palpate_pose* X_WT, size_t num_poses) {
  if (contact == nullptr) return "there is no contact to measure with: create one";
  if (scene == nullptr) return "there is no scene to measure in: create one";
  return X_WT == nullptr && num_poses > 0 ? "there is no pose of the tool: give one" : nullptr;
}

std::span<const Pose> poses_of(const palpate_pose* X_WT, size_t num) {
  return {reinterpret_cast<const Pose*>(X_WT), num};
}

}  // namespace

extern "C" {

palpate_contact* palpate_contact_create(const palpate_tool* tool, const char* options,
                                        int32_t num_threads, palpate_error* error) {
  return guarded_call(error, static_cast<palpate_contact*>(nullptr), [&]() -> palpate_contact* {
    if (tool == nullptr)
      return fail(error, "there is no tool to measure: pack or load one"), nullptr;
    ContactOptions chosen;
    if (const Status status = read_options(options, chosen); !status)
      return fail(error, status.error()), nullptr;
    const auto method = contact_method(chosen);
    if (!method) return fail(error, method.error()), nullptr;
    const Tool* const tools[] = {&tool->tool};
    auto made = SceneContact::create(tools, *method, Place::cpu(), num_threads);
    if (!made) return fail(error, made.error()), nullptr;
    return new palpate_contact{tool, *method, *std::move(made)};
  });
}

void palpate_contact_free(palpate_contact* contact) { delete contact; }

int palpate_contact_measure(palpate_contact* contact, const palpate_scene* scene,
                            const palpate_pose* X_WT, palpate_measure* measure,
                            palpate_error* error) {
  return guarded_call(error, PALPATE_FAILED, [&] {
    if (const char* const text = lack(contact, scene, X_WT, 1)) return fail(error, text);
    if (!is_given(measure))
      return fail(error, "there is no measure with its size set: set it to sizeof");
    const palpate_measure all = taken(measure);
    if (!(all.progress >= 0 && all.progress <= 1))
      return fail(error,
                  "the progress between two surfaces is not from 0 to 1: give 1 for the newest");
    // A query of no poses says what is wrong with the scene.
    const Scene newest = scene->at(true);
    if (const Status status = contact->contact.measure(newest, ScenePoses{}, {}); !status)
      return fail(error, status.error());
    const size_t num = contact->tool->tool.spheres().size();
    std::vector<Plane<float>> planes(all.planes == nullptr ? 0 : num);
    ContactWants wants{.stiffness = (all.wants & PALPATE_WANTS_STIFFNESS) != 0,
                       .noise = (all.wants & PALPATE_WANTS_SIGMA) != 0,
                       .planes = planes};
    if (all.states != nullptr) wants.states = {reinterpret_cast<SphereState*>(all.states), num};
    palpate_measure out{};
    out.size = all.size, out.wants = all.wants, out.progress = all.progress;
    if (!std::holds_alternative<FieldMethod>(contact->method))
      out.wants &= ~static_cast<uint32_t>(PALPATE_WANTS_STIFFNESS | PALPATE_WANTS_SIGMA);
    out.states = all.states, out.planes = all.planes;
    const Pose X = pose_of(*X_WT);
    const bool is_mixed = all.progress < 1;
    if (is_mixed) add_measured(*contact, scene->at(false), X, wants, 1 - all.progress, true, out);
    const ContactResult result =
        add_measured(*contact, newest, X, wants, all.progress, !is_mixed, out);
    if (wants.noise) put_sigma(result.noise, out);
    for (size_t i = 0; i < planes.size(); ++i) {
      for (int axis = 0; axis < 3; ++axis)
        out.planes[4 * i + static_cast<size_t>(axis)] = planes[i].normal[axis];
      out.planes[4 * i + 3] = planes[i].offset;
    }
    give(out, measure);
    return PALPATE_OK;
  });
}

int palpate_contact_measure_many(palpate_contact* contact, const palpate_scene* scene,
                                 const palpate_pose* X_WT, size_t num_poses,
                                 const palpate_answers* answers, palpate_error* error) {
  return guarded_call(error, PALPATE_FAILED, [&] {
    if (const char* const text = lack(contact, scene, X_WT, num_poses)) return fail(error, text);
    if (!is_given(answers))
      return fail(error, "there are no answers with their size set: set it to sizeof");
    const palpate_answers a = taken(answers);
    SceneAnswers to;
    to.contact = {a.volume, a.potential, a.force,        a.torque,      a.stiffness,
                  a.status, kHostMemory, a.volume_sigma, a.force_sigma, a.torque_sigma};
    to.unseen = a.unseen;
    to.clearance = a.clearance;
    to.nearest = a.nearest;
    to.clearance_gradient = a.clearance_gradient;
    if (a.clearance_limit != 0) to.clearance_limit = a.clearance_limit;
    to.sphere_depth = a.sphere_depth;
    to.sphere_volume = a.sphere_volume;
    to.sphere_direction = a.sphere_direction;
    to.max_spheres = contact->contact.max_spheres();
    const Status status =
        contact->contact.measure(scene->at(true), {.X_WT = poses_of(X_WT, num_poses)}, to);
    return status ? PALPATE_OK : fail(error, status.error());
  });
}

int palpate_contact_any(palpate_contact* contact, const palpate_scene* scene,
                        const palpate_pose* X_WT, size_t num_poses, double margin, uint8_t* hits,
                        palpate_error* error) {
  return guarded_call(error, PALPATE_FAILED, [&] {
    if (const char* const text = lack(contact, scene, X_WT, num_poses)) return fail(error, text);
    if (hits == nullptr && num_poses > 0)
      return fail(error, "there is no room for the hits: give a byte for each pose");
    const Status status =
        contact->contact.any(scene->at(true), {.X_WT = poses_of(X_WT, num_poses)}, margin, hits);
    return status ? PALPATE_OK : fail(error, status.error());
  });
}

}  // extern "C"
