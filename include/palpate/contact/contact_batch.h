// Many poses of one tool against many surfaces in one call: for planning and learning, where not
// the time of one query counts but how many are answered in a second.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "palpate/contact/contact_query.h"
#include "palpate/field/surface_batch.h"
#include "palpate/gpu/caller_stream.h"

namespace palpate {

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

}  // namespace palpate
