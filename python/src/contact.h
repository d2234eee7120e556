// palpate.Contact, for its files of bindings.
#pragma once

#include <algorithm>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/contact/scene.h"
#include "python/src/arrays.h"
#include "python/src/bindings.h"

namespace palpate::python {

class PyContact {
 public:
  /// One tool or more.
  PyContact(std::vector<PyTool> tools, const ContactMethod& method, const Place& place, int threads)
      : tools_(std::move(tools)),
        place_(place),
        contact_(make(*tools_.front().tool, method, place, threads)) {}

  const PyTool& tool() const { return tools_.front(); }
  const std::vector<PyTool>& tools() const { return tools_; }
  /// Spheres of the largest tool.
  std::size_t max_spheres() const {
    std::size_t most = 0;
    for (const PyTool& tool : tools_) most = std::max(most, tool.tool->spheres().size());
    return most;
  }
  const Place& place() const { return place_; }
  std::string method() const {
    return std::string(name_of(contact_options(contact_.query().method()).method));
  }
  /// One thread at a time; without the GIL.
  template <class Work>
  auto alone(const Work& work) {
    const nb::gil_scoped_release no_gil;
    const std::lock_guard lock(mutex_);
    return work(contact_);
  }
  /// Likewise, with what measures all tools in scenes, which is made when it is first needed.
  template <class Work>
  Status with_scenes(const Work& work) {
    const nb::gil_scoped_release no_gil;
    const std::lock_guard lock(mutex_);
    if (!scenes_) {
      std::vector<const Tool*> tools;
      for (const PyTool& tool : tools_) tools.push_back(tool.tool.get());
      auto made = SceneContact::create(tools, contact_.query().method(), place_);
      if (!made) return made.error();
      scenes_.emplace(*std::move(made));
    }
    return work(*scenes_);
  }
  /// Measures many poses against bodies. The query of some bodies is kept until other bodies are
  /// queried. `keeper`: keeps the bodies' shapes alive.
  Status measure_bodies(const std::vector<PlacedBody>& bodies, std::vector<PyTool> keeper,
                        const PoseBatch& poses, const BatchAnswers& answers) {
    const nb::gil_scoped_release no_gil;
    const std::lock_guard lock(mutex_);
    const auto is_same = [](const PlacedBody& a, const PlacedBody& b) {
      return a.shape == b.shape && a.X_WB == b.X_WB;
    };
    if (body_batch_ == nullptr ||
        !std::equal(bodies.begin(), bodies.end(), bodies_.begin(), bodies_.end(), is_same)) {
      if (body_pool_ == nullptr) body_pool_ = std::make_unique<ThreadPool>(0);
      auto made =
          make_body_batch_query(place_, contact_.query().index(), bodies, {}, body_pool_.get());
      if (!made) return made.error();
      body_batch_ = *std::move(made);
      bodies_ = bodies;
      shapes_ = std::move(keeper);
    }
    return body_batch_->measure(poses.X_WT, poses.surface_of_pose, answers);
  }

 private:
  static Contact make(const Tool& tool, const ContactMethod& method, const Place& place,
                      int threads) {
    Result<Contact> contact = Error{};
    {
      const nb::gil_scoped_release no_gil;
      contact = Contact::create(tool, method, place, threads);
    }
    return taken(std::move(contact));
  }

  std::vector<PyTool> tools_;  // outlive the contact
  Place place_;
  Contact contact_;
  std::optional<SceneContact> scenes_;
  std::vector<PyTool> shapes_;
  std::vector<PlacedBody> bodies_;
  std::unique_ptr<ThreadPool> body_pool_;
  std::unique_ptr<BodyBatchQuery> body_batch_;
  std::mutex mutex_;
};

struct PyBatch;

/// Requested results of a scene.
struct SceneWants {
  bool stiffness = false, noise = false, clearance = false, per_sphere = false, unseen = false;
  double limit = kClearanceLimit, smoothing = 0;
};
/// Poses and scene of a question; None: not given.
struct SceneQuestion {
  nb::handle scene, poses;
  nb::handle tool_of_pose = nb::none(), group_of_pose = nb::none(), stream = nb::none();
};
/// Measures P poses in a scene, into arrays where the poses are; in bind_scene.cpp.
std::unique_ptr<PyBatch> measure_scene(PyContact& self, const SceneQuestion& question,
                                       SceneWants wants);
/// The same into arrays of the caller.
void measure_scene(PyContact& self, const SceneQuestion& question, const SceneWants& wants,
                   const PyBatch& out);
/// The scene of an argument, and what keeps it alive.
struct HeldScene {
  Scene scene;
  std::vector<nb::object> cameras, bodies;
};
/// Converts a palpate.Scene, a surface, a body, or a list of them. TypeError: anything else.
HeldScene held_scene(nb::handle given);
/// True for a palpate.Scene.
bool is_scene(nb::handle given);
/// Adds palpate.Scene, and Contact.any.
void bind_scene(nb::module_& m, nb::class_<PyContact>& contact);

/// Measures P poses at once; in bind_batch.cpp.
nb::object measure_batch(PyContact& self, nb::handle surfaces, nb::handle poses,
                         nb::handle surface_of_pose, bool stiffness, bool with_std, nb::handle out,
                         nb::handle stream);
/// The same of surfaces or of a scene; in bind_scene_batch.cpp.
nb::object measure_many(PyContact& self, nb::handle surfaces, nb::handle poses,
                        nb::handle surface_of_pose, bool stiffness, bool with_std, nb::handle out,
                        nb::handle stream, bool clearance, bool per_sphere, double limit,
                        double smoothing, nb::handle tool_of_pose, nb::handle group_of_pose);

/// Checks that a contact knows what noise does to it. Error: its method does not.
inline void check_std(const PyContact& contact) {
  if (contact.method() == "field") return;
  throw PalpateError("std: the method \"" + contact.method() +
                     "\" does not say what noise does to it; create the contact with \"field\"");
}

}  // namespace palpate::python
