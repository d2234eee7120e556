#include "src/contact/points/donors/donors.h"

#include <algorithm>

namespace palpate { inline namespace v0 {

Donors::Donors(std::span<const Sphere> spheres) : spheres_(spheres) {
  donors_.reserve(spheres.size());
  ids_.reserve(spheres.size());
  planes_.reserve(spheres.size());
  for (std::vector<float>& channel : channels_) channel.reserve(spheres.size() + kPadding);
}

void Donors::clear() {
  donors_.clear();
  ids_.clear();
  planes_.clear();
  for (std::vector<float>& channel : channels_) channel.clear();
}

void Donors::add(const Donor& donor) {
  donors_.push_back(donor);
  ids_.push_back(donor.sphere_id);
  planes_.push_back(donor.plane_T);
  const Vec3f& c = spheres_[static_cast<std::size_t>(donor.sphere_id)].center;
  const Vec3f n = to_float(donor.plane_T.normal);
  const float values[kNumChannels] = {c.x,
                                      c.y,
                                      c.z,
                                      n.x,
                                      n.y,
                                      n.z,
                                      static_cast<float>(donor.plane_T.offset),
                                      static_cast<float>(donor.weight),
                                      static_cast<float>(donor.presence)};
  for (int channel = 0; channel < kNumChannels; ++channel) {
    channels_[channel].push_back(values[channel]);
  }
}

void Donors::pad() {
  for (int channel = 0; channel < kNumChannels; ++channel) {
    channels_[channel].resize(donors_.size() + kPadding, channel <= kZ ? 1e12f : 0.0f);
  }
}

BoundaryPlanes Donors::view(bool with_presence) const {
  const auto data = [&](Channel channel) { return channels_[channel].data(); };
  return {size(),
          ids_.data(),
          data(kX),
          data(kY),
          data(kZ),
          data(kNx),
          data(kNy),
          data(kNz),
          data(kOffset),
          data(kWeight),
          with_presence ? data(kPresence) : nullptr,
          planes_.data()};
}

std::int32_t Donors::heaviest() const {
  const std::vector<float>& weight = channels_[kWeight];
  return static_cast<std::int32_t>(std::max_element(weight.begin(), weight.begin() + size()) -
                                   weight.begin());
}

}}  // namespace palpate::v0
