#include "src/contact/internal/pose_gradients.h"

#include "src/contact/batch/pose_numbers.h"

namespace palpate { inline namespace v0 {

Status put_pose_gradients(const PoseGradients& job, [[maybe_unused]] CallerStream stream) {
  if (job.poses.gpu != kHostMemory) {
#if defined(PALPATE_CUDA)
    return put_pose_gradients_cuda(job, stream);
#else
    return find_gpus().error();
#endif
  }
  for_numbers(job.poses, [&]<class Numbers, class Real>(Numbers*, Real) {
    const auto num = static_cast<std::ptrdiff_t>(job.poses.num);
    for (std::ptrdiff_t i = 0; i < num; ++i) put_pose_gradient<Numbers, Real>(job, i);
  });
  return Done{};
}

Status put_plain_poses(const PoseNumbers& poses, double* to, [[maybe_unused]] CallerStream stream) {
  if (poses.gpu != kHostMemory) {
#if defined(PALPATE_CUDA)
    return put_plain_poses_cuda(poses, to, stream);
#else
    return find_gpus().error();
#endif
  }
  for_numbers(poses, [&]<class Numbers, class Real>(Numbers*, Real) {
    const auto num = static_cast<std::ptrdiff_t>(poses.num);
    for (std::ptrdiff_t i = 0; i < num; ++i) put_plain_pose<Numbers, Real>(poses, to, i);
  });
  return Done{};
}

}}  // namespace palpate::v0
