#include "src/viewer/protocol/samples.h"

namespace palpate { inline namespace v0 {

ViewSample sample_of(const TickRecord& tick, bool has_hand) {
  ViewSample sample;
  sample.time = tick.time;
  sample.F_H_B = has_hand ? tick.F_H_B : tick.step.contact_W;
  sample.contact_W = tick.step.contact_W;
  sample.volume = tick.penetration.volume;
  sample.objects_volume = tick.objects.volume;
  sample.compute_seconds = 1e-9 * static_cast<double>(tick.compute_nanoseconds);
  sample.contact_age = tick.contact_age;
  sample.sensor_age = tick.sensor_age;
  sample.stretch = tick.step.stretch;
  sample.gain = tick.safety.gain;
  sample.energy = tick.safety.energy;
  sample.X_WT = tick.step.X_WT;
  sample.X_WT_hand = tick.step.X_WT_hand;
  // A tick knows the scale of its newtons by its force alone, without which there is no arrow.
  const double measure = norm(tick.penetration.measure_W.force);
  if (tick.noise && measure > 0) {
    const double newtons = norm(tick.step.contact_W.force) / measure;
    const auto& m = tick.noise->force.m;
    sample.force_covariance = {m[0][0], m[0][1], m[0][2], m[1][1], m[1][2], m[2][2]};
    for (double& each : sample.force_covariance) each *= newtons * newtons;
  }
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
