// How much of the tool is inside the scene, and the wrench that follows (thesis sections 3.2, 3.3):
// one pose at a time, or many.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <utility>

#include "palpate/contact/contact_options.h"
#include "palpate/core/core.h"
#include "palpate/field/sensor.h"
#include "palpate/gpu/devices.h"
#include "palpate/tool/tool.h"

namespace palpate::inline v0 {

// What contact queries know of a tool, whatever its pose.

/// Spheres in spatial order, the grid that finds the sphere of a point, the leaf graph in that
/// order, and the elements that ask the depth field: built once for a tool and shared by all its
/// queries and bodies, on any thread. Each part is built when a query first needs it, so that one
/// by `field` pays for the elements alone.
class ToolIndex {
 public:
  /// `tool` must outlive it. O(1).
  static std::shared_ptr<const ToolIndex> create(const Tool& tool);
  static std::shared_ptr<const ToolIndex> create(const Tool&&) = delete;
  ~ToolIndex();

  const Tool& tool() const { return *tool_; }
  /// Memory of the parts that have been built, bytes.
  std::size_t num_bytes() const;

  /// For the contact module: src/contact/index/tool_parts.h.
  struct Parts;
  const Parts& parts() const { return *parts_; }

 private:
  explicit ToolIndex(const Tool& tool);

  const Tool* tool_;
  std::unique_ptr<const Parts> parts_;
};

/// Measures one tool by one method. All memory is allocated at construction. One thread at a time.
class ContactQuery {
 public:
  virtual ~ContactQuery() = default;

  /// One measurement at a pose, in the world that SurfaceView::X_WC says. O(points in the tool's
  /// image window + spheres), with stiffness half as much more, with states or planes twice as
  /// much. No allocation, no lock. The same input gives the same bits, whatever was asked before
  /// and for any number of threads. A GPU may be given views of host memory and of other GPUs: they
  /// are copied once for each stamp, with memory for the first ones of their size.
  ContactResult measure(const SurfaceView& surface, const Pose& X_WT,
                        const ContactWants& wants = {}) const noexcept {
    return measure(surface, surface, 1, X_WT, wants);
  }
  /// Between two surfaces: (1 - alpha) times the measure against `from` and alpha times that
  /// against `to`, whose are counts, states and planes. Whatever changed between the two, the force
  /// so goes from the one to the other, and with `field` it is at every alpha the exact gradient of
  /// one potential. With alpha = 1 `from` is not looked at; else it takes up to twice as long.
  ContactResult measure(const SurfaceView& from, const SurfaceView& to, double alpha,
                        const Pose& X_WT, const ContactWants& wants = {}) const noexcept {
    const SurfaceBlend camera{from, to, alpha};
    return measure({&camera, 1}, X_WT, wants);
  }

  /// Against what all cameras together know: the depth hull (docs/decisions/0029-depth-hull.md). A
  /// sphere is as deep as the camera says that has it least deep; cameras that do not see it
  /// abstain. By the field, force and torque still are the exact derivatives of one potential. At
  /// most K times as long with K cameras, and what one of them sees free in front of its surface
  /// costs nothing more. One camera is measured against as by the other calls. No surface of any
  /// camera, more than kMostCameras, several without SurfaceView::seen_free, or several by a method
  /// of points (which take `joined_clouds`): StepStatus::no_surface.
  ContactResult measure(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                        const ContactWants& wants = {}) const noexcept;

  const ContactMethod& method() const { return method_; }
  /// For other queries and bodies of the same tool.
  const std::shared_ptr<const ToolIndex>& index() const { return index_; }

 protected:
  ContactQuery() = default;
  ContactQuery(std::shared_ptr<const ToolIndex> index, const ContactMethod& method)
      : index_(std::move(index)), method_(method) {}

  /// Between two surfaces of one camera, in its frame.
  virtual ContactResult measure_one(const SurfaceView& from, const SurfaceView& to, double alpha,
                                    const Pose& X_CT, const ContactWants& wants) const noexcept = 0;
  /// More than one camera, or one with a memory; the pose is finite.
  virtual ContactResult measure_hull(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                                     const ContactWants& wants) const noexcept;
  /// What one camera by itself does not see, m3, at a finite pose in its frame; marks
  /// ContactWants::unseen, which is zero. By the field, on a CPU; else 0.
  virtual double unseen_by_one(const SurfaceView& surface, const Pose& X_CT,
                               std::span<std::uint8_t> unseen) const noexcept;

 private:
  ContactResult measure_camera(const SurfaceBlend& camera, const Pose& X_WT,
                               const ContactWants& wants) const noexcept;
  ContactResult measure_alone(SurfaceBlend camera, const Pose& X_WT,
                              const ContactWants& wants) const noexcept;

  std::shared_ptr<const ToolIndex> index_;
  ContactMethod method_;
};

struct ExecutionOptions {
  Isa isa = best_isa();
  ThreadPool* pool = nullptr;  ///< used inside one query; null: the caller's thread alone
  int gpu = 0;                 ///< which one, for the CUDA backend
};

/// Errors: the backend is not in this build or on this machine.
Result<std::unique_ptr<ContactQuery>> make_contact_query(Backend backend,
                                                         std::shared_ptr<const ToolIndex> index,
                                                         const ContactMethod& method,
                                                         const ExecutionOptions& capacities = {});
/// The same with an index of its own. `tool` must outlive the query.
Result<std::unique_ptr<ContactQuery>> make_contact_query(Backend backend, const Tool& tool,
                                                         const ContactMethod& method = {},
                                                         const ExecutionOptions& capacities = {});
Result<std::unique_ptr<ContactQuery>> make_contact_query(Backend, const Tool&&,
                                                         const ContactMethod& = {},
                                                         const ExecutionOptions& = {}) = delete;

// Many poses of one tool against many surfaces in one call: for planning and learning, where not
// the time of one query counts but how many are answered in a second.

/// What is asked: P poses of the tool, each against one surface.
struct PoseBatch {
  /// P poses: 7 doubles each, the translation x y z (m) and the unit quaternion x y z w.
  std::span<const Pose> X_WT = {};
  /// P numbers of surfaces. Empty: there is one surface, or each pose has its own. A number that no
  /// surface has gives StepStatus::no_surface.
  std::span<const std::int32_t> surface_of_pose = {};
  /// Of each surface, where its camera is in W. Empty: W is the camera's frame C for all.
  std::span<const Pose> X_WC = {};
  int gpu = kHostMemory;  ///< whose memory all three are in
};

/// Where the answers go: row-major arrays of the caller's. What is null is not wanted; a stiffness
/// takes about twice as long.
struct BatchAnswers {
  double* volume = nullptr;         ///< P, m3: Penetration::volume
  double* potential = nullptr;      ///< P, m4
  double* force = nullptr;          ///< P x 3, m3, in W: Penetration::measure_W
  double* torque = nullptr;         ///< P x 3, m4, in W, about the tool's centre of mass C
  double* stiffness = nullptr;      ///< P x 6 x 6, in W: Stiffness
  std::uint32_t* status = nullptr;  ///< P: ContactStatus::bits; where unmeasured all is zero
  int gpu = kHostMemory;            ///< whose memory they are in
};

/// Measures batches by FieldMethod. One thread at a time.
class BatchQuery {
 public:
  virtual ~BatchQuery() = default;

  /// O(poses * spheres). What a pose is answered is the same to the last bit whatever else is in
  /// the batch, and on every run. On a CPU it is what ContactQuery::measure answers, to the bit
  /// (but rounding where there is an X_WC), on a GPU to 1e-5 of its results.
  ///
  /// On a GPU one launch. If poses and answers are there and a stream is given, the call only asks
  /// for the work; else it waits for it. After the first call with as many surfaces it allocates
  /// nothing and may be captured in a CUDA graph: a replay reads the poses, fields and places for
  /// answers that it was captured with. Poses and answers in host memory are copied, some ten
  /// thousand at a time; so are surfaces in host memory, once for each stamp.
  ///
  /// Errors: surface_of_pose has another size than X_WT, or is empty and there are neither one
  /// surface nor as many as poses; X_WC has another size than there are surfaces; arrays in memory
  /// where the query cannot read them; on a GPU, a field made for a window of the image only; no
  /// memory; the GPU has failed. Then nothing has been answered.
  virtual Status measure(const SurfaceBatch& surfaces, const PoseBatch& poses,
                         const BatchAnswers& answers,
                         std::optional<CallerStream> stream = {}) const = 0;
  /// Takes the memory for so many surfaces, and poses in host memory. Errors: there is too little.
  virtual Status reserve(int num_surfaces, int num_poses) const = 0;
};

/// Errors: a method other than FieldMethod; the backend is not in this build or on this machine.
/// `capacities.pool` spreads a batch over its threads.
Result<std::unique_ptr<BatchQuery>> make_batch_query(Backend backend,
                                                     std::shared_ptr<const ToolIndex> index,
                                                     const ContactMethod& method = {},
                                                     const ExecutionOptions& capacities = {});

/// A ContactQuery of a tool with the threads that it needs. One thread at a time.
class Contact {
 public:
  /// `tool` must outlive it. On a CPU a measurement runs on the caller's thread and on
  /// `num_threads` - 1 more (0: one per core), which pay for tools of more than about 50,000
  /// spheres. Errors: the place is not in this build or on this machine.
  static Result<Contact> create(const Tool& tool, const ContactMethod& method = FieldMethod{},
                                const Place& place = Place::cpu(), int num_threads = 1) {
    auto pool = std::make_unique<ThreadPool>(num_threads);
    auto query =
        make_contact_query(place.backend, tool, method, {best_isa(), pool.get(), place.gpu});
    if (!query) return query.error();
    return Contact(tool, place, std::move(pool), *std::move(query));
  }
  static Result<Contact> create(const Tool&&, const ContactMethod& = FieldMethod{},
                                const Place& = Place::cpu(), int = 1) = delete;

  /// As ContactQuery::measure: the tool at the pose X_WT. No allocation.
  ContactResult measure(const SurfaceView& surface, const Pose& X_WT,
                        const ContactWants& wants = {}) const noexcept {
    return query_->measure(surface, X_WT, wants);
  }
  /// Between two surfaces, alpha of the way from the one to the other.
  ContactResult measure(const SurfaceView& from, const SurfaceView& to, double alpha,
                        const Pose& X_WT, const ContactWants& wants = {}) const noexcept {
    return query_->measure(from, to, alpha, X_WT, wants);
  }
  /// Against what several cameras know together, each somewhere in the world.
  ContactResult measure(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                        const ContactWants& wants = {}) const noexcept {
    return query_->measure(cameras, X_WT, wants);
  }
  /// As BatchQuery::measure: many poses in one call, by FieldMethod. On a CPU over all cores. The
  /// first call takes threads and memory for it.
  Status measure_batch(const SurfaceBatch& surfaces, const PoseBatch& poses,
                       const BatchAnswers& answers, std::optional<CallerStream> stream = {}) const {
    if (const Status status = make_batches(); !status) return status;
    return batches_->measure(surfaces, poses, answers, stream);
  }
  /// So that the first batch need not: memory for so many surfaces, and poses in host memory.
  Status reserve_batch(int num_surfaces, int num_poses = 0) const {
    if (const Status status = make_batches(); !status) return status;
    return batches_->reserve(num_surfaces, num_poses);
  }
  /// The share of the tool that a volume is.
  double fraction(const Penetration& penetration) const {
    return penetration.volume / full_volume_;
  }
  const ContactQuery& query() const { return *query_; }

 private:
  Contact(const Tool& tool, const Place& place, std::unique_ptr<ThreadPool> pool,
          std::unique_ptr<ContactQuery> query)
      : full_volume_(palpate::full_volume(tool, contact_options(query->method()))),
        place_(place),
        pool_(std::move(pool)),
        query_(std::move(query)) {}

  Status make_batches() const {
    if (batches_ != nullptr) return Done{};
    auto pool = std::make_unique<ThreadPool>(place_.backend == Backend::cpu ? 0 : 1);
    auto made = make_batch_query(place_.backend, query_->index(), query_->method(),
                                 {best_isa(), pool.get(), place_.gpu});
    if (!made) return made.error();
    batch_pool_ = std::move(pool);
    batches_ = *std::move(made);
    return Done{};
  }

  double full_volume_;
  Place place_;
  std::unique_ptr<ThreadPool> pool_;
  std::unique_ptr<ContactQuery> query_;
  mutable std::unique_ptr<ThreadPool> batch_pool_;
  mutable std::unique_ptr<BatchQuery> batches_;
};

}  // namespace palpate::inline v0
