#include "src/contact/cuda/gpu_cloud.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kNumChannels = 9;

}  // namespace

PointCloudView GpuClouds::on_gpu(const PointCloudView& cloud, gpu::Stream& stream) {
  if (cloud.gpu == gpu_ || cloud.size() == 0) return cloud;
  const CopySource source{cloud.stamp, cloud.x, cloud.gpu};
  const auto [slot, is_known] = slots_.choose(source);
  Copy& copy = copies_[slot];

  constexpr std::size_t kPadding = PointCloudView::kPadding;
  const std::size_t num = (cloud.size() + kPadding - 1) / kPadding * kPadding;
  if (num > copy.capacity) {
    stream.wait();  // the memory given up may still be in use
    copy.memory.emplace(gpu_);
    copy.data = copy.memory->take<float>(kNumChannels * num);
    copy.capacity = copy.data != nullptr ? num : 0;
    if (const Status& status = copy.memory->status(); !status) {
      stream.fail(status.error());
      return {};
    }
  }
  PointCloudView view = cloud;
  const float** const ends[] = {&view.x,  &view.y,      &view.z,      &view.nx,    &view.ny,
                                &view.nz, &view.edge_x, &view.edge_y, &view.edge_z};
  for (std::size_t channel = 0; channel < kNumChannels; ++channel) {
    const float*& array = *ends[channel];
    if (array == nullptr) continue;
    float* const here = copy.data + channel * copy.capacity;
    // The depth-change vectors have no padding.
    const std::size_t num_values = channel < 6 ? num : cloud.size();
    if (!is_known) stream.copy(here, array, num_values * sizeof(float));
    array = here;
  }
  view.gpu = gpu_;
  slots_.note(slot, source);
  return view;
}

}}  // namespace palpate::v0
