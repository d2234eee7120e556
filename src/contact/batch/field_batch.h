// Batches by the field method on a CPU.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "palpate/contact/contact.h"
#include "src/contact/field/field_contact.h"

namespace palpate { inline namespace v0 {

/// Checks that all backends share. Errors: batches that do not fit together.
Status check_batch(const SurfaceBatch& surfaces, const PoseBatch& poses);

/// Each pose is measured by one thread, as FieldContact does it.
class FieldBatch final : public BatchQuery {
 public:
  FieldBatch(std::shared_ptr<const ToolIndex> index, const FieldMethod& method,
             const ExecutionOptions& execution);
  ~FieldBatch() override;

  Status measure(const SurfaceBatch& surfaces, const PoseBatch& poses, const BatchAnswers& answers,
                 std::optional<CallerStream> stream) const override;
  Status reserve(int num_surfaces, int num_poses) const override;

 private:
  struct Overview;
  struct Worker;

  std::shared_ptr<const ToolIndex> index_;
  const FieldElements* elements_;  // owned by the index
  Vec3d p_TC_;                     // center of mass
  FieldContactKernels kernels_;
  Isa isa_;
  float largest_radius_, reach_;             // of elements; of the tool from its origin
  mutable std::vector<Overview> overviews_;  // of the surfaces, if that pays
  mutable ThreadPool own_pool_{1};
  ThreadPool* pool_;
};

/// Writes the results of one pose to the arrays that are not null.
void put_answers(std::size_t pose, const ContactResult& result, const BatchAnswers& answers);

}}  // namespace palpate::v0
