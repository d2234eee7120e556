// Derivatives by the numbers of poses on a GPU: a thread takes a pose.
#include "src/gpu/internal/device_code.cuh"
#include "src/gpu/internal/team.cuh"

#include "src/contact/batch/pose_numbers.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {
namespace {

template <class Numbers, class Real>
__global__ void put_gradients(const __grid_constant__ PoseGradients job) {
  const int i = gpu::grid_thread();
  if (static_cast<std::size_t>(i) < job.poses.num) put_pose_gradient<Numbers, Real>(job, i);
}

template <class Numbers, class Real>
__global__ void put_poses(const __grid_constant__ PoseNumbers poses, double* to) {
  const int i = gpu::grid_thread();
  if (static_cast<std::size_t>(i) < poses.num) put_plain_pose<Numbers, Real>(poses, to, i);
}

// Launches kernel_of(numbers, real), as for_numbers calls it, with a thread for each pose.
template <class KernelOf, class... Arguments>
Status launch_in(CallerStream desired, const PoseNumbers& poses, const KernelOf& kernel_of,
                 const Arguments&... arguments) {
  if (poses.num == 0) return Done{};
  constexpr std::size_t kThreads = 128;
  gpu::Stream stream(poses.gpu, desired.handle);
  const int num_blocks = static_cast<int>((poses.num + kThreads - 1) / kThreads);
  for_numbers(poses, [&](auto* numbers, auto real) {
    gpu::launch(stream, {.blocks = num_blocks, .threads = kThreads}, kernel_of(numbers, real),
                arguments...);
  });
  return stream.status();
}

}  // namespace

Status put_pose_gradients_cuda(const PoseGradients& job, CallerStream stream) {
  return launch_in(
      stream, job.poses,
      []<class Numbers, class Real>(Numbers*, Real) { return put_gradients<Numbers, Real>; }, job);
}

Status put_plain_poses_cuda(const PoseNumbers& poses, double* to, CallerStream stream) {
  return launch_in(
      stream, poses,
      []<class Numbers, class Real>(Numbers*, Real) { return put_poses<Numbers, Real>; }, poses,
      to);
}

}}  // namespace palpate::v0
