#include "src/viewer/protocol/samples.h"

namespace palpate { inline namespace v0 {

ViewSample sample_of(const TickRecord& tick, bool has_hand) {
  ViewSample sample;
  sample.time = tick.time;
  sample.F_H_B = has_hand ? tick.F_H_B : tick.step.contact_W;
  sample.contact_W = tick.step.contact_W;
  sample.volume = tick.penetration.volume;
  sample.compute_seconds = 1e-9 * static_cast<double>(tick.compute_nanoseconds);
  sample.contact_age = tick.contact_age;
  sample.sensor_age = tick.sensor_age;
  sample.stretch = tick.step.stretch;
  sample.gain = tick.safety.gain;
  sample.energy = tick.safety.energy;
  sample.X_WT = tick.step.X_WT;
  sample.X_WT_hand = tick.step.X_WT_hand;
  return sample;
}

void SampleQueue::add(const ViewSample& sample) {
  samples_.push_back(sample);
  while (samples_.size() > kMaxSamples || samples_.front().time < sample.time - kSeconds) {
    samples_.pop_front();
  }
}

void SampleQueue::take(std::vector<ViewSample>& samples) {
  samples.insert(samples.end(), samples_.begin(), samples_.end());
  samples_.clear();
}

}}  // namespace palpate::v0
