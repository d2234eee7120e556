// Contact queries: how much of the tool is inside the scene, and the wrench (thesis sections 3.2,
// 3.3); for one pose at a time, or for many.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "palpate/contact/contact_options.h"
#include "palpate/core/core.h"
#include "palpate/field/sensor.h"
#include "palpate/gpu/devices.h"
#include "palpate/tool/tool.h"

namespace palpate { inline namespace v0 {

// The part of a query that depends on the tool only, not on its pose.

struct ToolParts;  // src/contact/index/tool_parts.h

/// Spheres in spatial order, the grid that finds the sphere of a point, the leaf graph in that
/// order, and the elements for the depth field. Built once per tool and shared by all its queries
/// and bodies, on any thread. Each part is built on first use, so `field` builds only the
/// elements.
class ToolIndex {
 public:
  /// `tool` must outlive it. O(1).
  static std::shared_ptr<const ToolIndex> create(const Tool& tool);
  static std::shared_ptr<const ToolIndex> create(const Tool&&) = delete;
  ~ToolIndex();

  const Tool& tool() const { return *tool_; }
  /// Memory of the parts built so far, bytes.
  std::size_t num_bytes() const;

 private:
  friend const ToolParts& parts_of(const ToolIndex& index);
  explicit ToolIndex(const Tool& tool);

  const Tool* tool_;
  std::unique_ptr<const ToolParts> parts_;
};

/// Measures one tool with one method. Allocates at construction only. One thread at a time.
class ContactQuery {
 public:
  virtual ~ContactQuery() = default;

  /// One measurement at a pose, in the world defined by SurfaceView::X_WC. O(points in the tool's
  /// image window + spheres); stiffness adds half, states or planes double it. No allocation, no
  /// lock. The same input gives the same bits, whatever was measured before and for any number of
  /// threads. A GPU accepts views of host memory and of other GPUs: they are copied once per stamp,
  /// with an allocation for the first ones of their size. To a CPU, those of GPUs are no surface.
  ContactResult measure(const SurfaceView& surface, const Pose& X_WT,
                        const ContactWants& wants = {}) const noexcept {
    return measure(surface, surface, 1, X_WT, wants);
  }
  /// Between two surfaces: (1 - alpha) times the measure against `from` plus alpha times the
  /// measure against `to`, whose counts, states and planes are returned. So the force changes
  /// continuously from one to the other, and with `field` it is the exact gradient of one potential
  /// at every alpha. alpha = 1 ignores `from`; otherwise it takes up to twice as long.
  ContactResult measure(const SurfaceView& from, const SurfaceView& to, double alpha,
                        const Pose& X_WT, const ContactWants& wants = {}) const noexcept {
    const SurfaceBlend camera{from, to, alpha};
    return measure({&camera, 1}, X_WT, wants);
  }

  /// Against several cameras combined: the depth hull (docs/decisions/0029-depth-hull.md). A sphere
  /// takes the depth of the camera that has it least deep; cameras that do not see it abstain. With
  /// the field, force and torque are exact derivatives of one potential. Takes at most K times as
  /// long with K cameras; free space in front of a surface costs nothing. One camera is measured as
  /// in the other calls. StepStatus::no_surface if no camera has a surface, for more than
  /// kMaxCameras, for several without SurfaceView::seen_free, and for several with a point method
  /// (use `joined_clouds`).
  ContactResult measure(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                        const ContactWants& wants = {}) const noexcept;

  /// The method with its options.
  const ContactMethod& method() const { return method_; }
  /// For other queries and bodies of the same tool.
  const std::shared_ptr<const ToolIndex>& index() const { return index_; }

 protected:
  ContactQuery() = default;
  ContactQuery(std::shared_ptr<const ToolIndex> index, const ContactMethod& method)
      : index_(std::move(index)), method_(method) {}

  /// Between two surfaces of one camera, in the camera frame.
  virtual ContactResult measure_one(const SurfaceView& from, const SurfaceView& to, double alpha,
                                    const Pose& X_CT, const ContactWants& wants) const noexcept = 0;
  /// More than one camera, or one with memory; the pose is finite.
  virtual ContactResult measure_hull(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                                     const ContactWants& wants) const noexcept;
  /// Returns the unseen volume of one camera by itself, m3, at a finite pose in its frame; marks
  /// ContactWants::unseen, which must be zero. With the field; else 0.
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

/// State of each sphere of a tool, for display; see ContactWants.
struct SpherePicture {
  std::vector<SphereState> states;
  std::vector<Plane<float>> planes;
  std::vector<std::int8_t> deciders;
  std::vector<std::uint8_t> unseen;

  /// Makes room for a tool of this many spheres.
  void resize(std::size_t num_spheres) {
    states.resize(num_spheres);
    planes.resize(num_spheres);
    deciders.resize(num_spheres);
    unseen.resize(num_spheres);
  }
  /// The wants of a measurement that fills it.
  ContactWants wants() {
    return {.states = states, .planes = planes, .deciders = deciders, .unseen = unseen};
  }
};

/// Instruction set and threads of a query on a CPU.
struct ExecutionOptions {
  Isa isa = best_isa();
  ThreadPool* pool = nullptr;  ///< used inside one query; null: only the caller's thread
  /// Takes the memory for ContactWants::noise at once; otherwise the first such query allocates.
  bool reserves_noise = false;
};

/// Creates a query. Errors: the place is not in this build or on this machine.
Result<std::unique_ptr<ContactQuery>> make_contact_query(const Place& place,
                                                         std::shared_ptr<const ToolIndex> index,
                                                         const ContactMethod& method,
                                                         const ExecutionOptions& execution = {});
/// The same with its own index. `tool` must outlive the query.
Result<std::unique_ptr<ContactQuery>> make_contact_query(const Place& place, const Tool& tool,
                                                         const ContactMethod& method = {},
                                                         const ExecutionOptions& execution = {});
Result<std::unique_ptr<ContactQuery>> make_contact_query(const Place&, const Tool&&,
                                                         const ContactMethod& = {},
                                                         const ExecutionOptions& = {}) = delete;

// Batches: many poses of one tool against many surfaces in one call, for planning and learning,
// where throughput counts rather than latency.

/// Input of a batch: P poses of the tool, each against one surface.
struct PoseBatch {
  /// P poses: 7 doubles each, translation x y z (m) and unit quaternion x y z w.
  std::span<const Pose> X_WT = {};
  /// P indices of surfaces. Empty: one surface for all, or one per pose. An invalid index gives
  /// StepStatus::no_surface.
  std::span<const std::int32_t> surface_of_pose = {};
  /// Pose in W of the camera of each surface, in host memory. Empty: W is the camera frame C.
  std::span<const Pose> X_WC = {};
  int gpu = kHostMemory;  ///< memory of the first two arrays
};

/// Output of a batch: row-major arrays of the caller. Null arrays are not computed. Stiffness takes
/// about twice as long.
struct BatchAnswers {
  double* volume = nullptr;         ///< P, m3: Penetration::volume
  double* potential = nullptr;      ///< P, m4
  double* force = nullptr;          ///< P x 3, m3, in W: Penetration::measure_W
  double* torque = nullptr;         ///< P x 3, m4, in W, about the tool's center of mass C
  double* stiffness = nullptr;      ///< P x 6 x 6, in W: Stiffness
  std::uint32_t* status = nullptr;  ///< P: ContactStatus::bits; if unmeasured the rest is zero
  int gpu = kHostMemory;            ///< memory of the arrays
  double* volume_std = nullptr;     ///< P, m3: MeasureNoise; not a number if it is unknown
  double* force_std = nullptr;      ///< P x 3, m3, in W
  double* torque_std = nullptr;     ///< P x 3, m4, in W

  bool want_noise() const {
    return volume_std != nullptr || force_std != nullptr || torque_std != nullptr;
  }
};

/// Measures batches with FieldMethod. One thread at a time.
class BatchQuery {
 public:
  virtual ~BatchQuery() = default;

  /// O(poses * spheres). The result of a pose has the same bits whatever else is in the batch, and
  /// on every run. On a CPU it equals ContactQuery::measure to the bit (up to rounding with an
  /// X_WC), on a GPU to 1e-5 of its results.
  ///
  /// On a GPU one launch, and one for standard deviations. With poses and outputs in GPU memory and
  /// a stream, the call only enqueues the work; otherwise it waits. After the first call with as
  /// many surfaces it allocates nothing, and a CUDA graph may capture it: a replay uses the
  /// captured arrays of poses, fields and outputs. Poses and outputs in host memory are copied,
  /// some ten thousand at a time, and surfaces in host memory once per stamp.
  ///
  /// On a GPU standard deviations are those of a CPU to 1e-4 of them, but at the border of two
  /// grids (docs/decisions/0048-how-sure-it-is.md). The first call that asks for them allocates,
  /// and only later ones can be captured. They go through memory of the query: replay graphs of one
  /// query that have them in one stream. A replay has the noise of a frame as it was captured;
  /// images of Sensor::update_batch that learn theirs have that of the images that lie there then.
  ///
  /// Errors: surface_of_pose has another size than X_WT, or is empty and there are neither one
  /// surface nor as many as poses; X_WC has another size than there are surfaces; arrays in memory
  /// that the query cannot read; on a GPU, a field for a window of the image; out of memory; the
  /// GPU has failed. Then there is no result.
  virtual Status measure(const SurfaceBatch& surfaces, const PoseBatch& poses,
                         const BatchAnswers& answers,
                         std::optional<CallerStream> stream = {}) const = 0;
  /// Allocates for so many surfaces, and poses in host memory, but not for standard deviations.
  /// Error: too little memory.
  virtual Status reserve(int num_surfaces, int num_poses) const = 0;
};

/// Creates a batch query; `execution.pool` spreads a batch over its threads. Errors: a method
/// other than FieldMethod; the place is not in this build or on this machine.
Result<std::unique_ptr<BatchQuery>> make_batch_query(const Place& place,
                                                     std::shared_ptr<const ToolIndex> index,
                                                     const ContactMethod& method = {},
                                                     const ExecutionOptions& execution = {});

/// A ContactQuery with its own threads: the simplest way to measure. One thread at a time.
class Contact {
 public:
  /// Creates a contact; `tool` must outlive it. On a CPU, a measurement uses the caller's thread
  /// and `num_threads` - 1 more. 0: one per core, but at most one for each 50,000 spheres, which is
  /// as many as pay. Errors: the place is not in this build or on this machine.
  static Result<Contact> create(const Tool& tool, const ContactMethod& method = FieldMethod{},
                                const Place& place = Place::cpu(), int num_threads = 0);
  static Result<Contact> create(const Tool&&, const ContactMethod& = FieldMethod{},
                                const Place& = Place::cpu(), int = 1) = delete;

  /// See ContactQuery::measure: the tool at the pose X_WT. No allocation.
  ContactResult measure(const SurfaceView& surface, const Pose& X_WT,
                        const ContactWants& wants = {}) const noexcept {
    return query_->measure(surface, X_WT, wants);
  }
  /// Between two surfaces: alpha = 0 is `from`, 1 is `to`.
  ContactResult measure(const SurfaceView& from, const SurfaceView& to, double alpha,
                        const Pose& X_WT, const ContactWants& wants = {}) const noexcept {
    return query_->measure(from, to, alpha, X_WT, wants);
  }
  /// Against several cameras combined, each with its pose in the world.
  ContactResult measure(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                        const ContactWants& wants = {}) const noexcept {
    return query_->measure(cameras, X_WT, wants);
  }
  /// See BatchQuery::measure: many poses in one call, with FieldMethod. On a CPU over all cores.
  /// The first call allocates threads and memory.
  Status measure_batch(const SurfaceBatch& surfaces, const PoseBatch& poses,
                       const BatchAnswers& answers, std::optional<CallerStream> stream = {}) const {
    if (const Status status = make_batches(); !status) return status;
    return batches_->measure(surfaces, poses, answers, stream);
  }
  /// Allocates for the first batch: so many surfaces, and poses in host memory; see
  /// BatchQuery::reserve.
  Status reserve_batch(int num_surfaces, int num_poses = 0) const {
    if (const Status status = make_batches(); !status) return status;
    return batches_->reserve(num_surfaces, num_poses);
  }
  /// The volume relative to that of the whole tool.
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
    auto made =
        make_batch_query(place_, query_->index(), query_->method(), {best_isa(), pool.get()});
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

}}  // namespace palpate::v0
