#include "src/contact/lenders.h"

#include <algorithm>

namespace palpate {

Lenders::Lenders(std::span<const Sphere> spheres) : spheres_(spheres) {
  lenders_.reserve(spheres.size());
  ids_.reserve(spheres.size());
  planes_.reserve(spheres.size());
  for (std::vector<float>& channel : channels_) channel.reserve(spheres.size() + kPadding);
}

void Lenders::clear() {
  lenders_.clear();
  ids_.clear();
  planes_.clear();
  for (std::vector<float>& channel : channels_) channel.clear();
}

void Lenders::add(const Lender& lender) {
  lenders_.push_back(lender);
  ids_.push_back(lender.sphere_id);
  planes_.push_back(lender.plane_T);
  const Vec3f& c = spheres_[static_cast<std::size_t>(lender.sphere_id)].centre;
  const Vec3f n = to_float(lender.plane_T.normal);
  const float values[kNumChannels] = {c.x,
                                      c.y,
                                      c.z,
                                      n.x,
                                      n.y,
                                      n.z,
                                      static_cast<float>(lender.plane_T.offset),
                                      static_cast<float>(lender.weight),
                                      static_cast<float>(lender.presence)};
  for (int channel = 0; channel < kNumChannels; ++channel) {
    channels_[channel].push_back(values[channel]);
  }
}

void Lenders::pad() {
  for (int channel = 0; channel < kNumChannels; ++channel) {
    channels_[channel].resize(lenders_.size() + kPadding, channel <= kZ ? 1e12f : 0.0f);
  }
}

BoundaryPlanes Lenders::view(bool with_presence) const {
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

std::int32_t Lenders::heaviest() const {
  const std::vector<float>& weight = channels_[kWeight];
  return static_cast<std::int32_t>(std::max_element(weight.begin(), weight.begin() + size()) -
                                   weight.begin());
}

Borrowed Lenders::borrow_from(const Lender& lender, std::int32_t sphere_id,
                              const BorrowRule& rule) const {
  const Sphere& sphere = spheres_[static_cast<std::size_t>(sphere_id)];
  const Plane<double>& plane = lender.plane_T;
  const double volume =
      rule.edges != nullptr
          ? rule.edges->volume(sphere_id, plane, lender.point)
          : cap_volume(static_cast<double>(sphere.radius),
                       dot(plane.normal, to_double(sphere.centre)) - plane.offset);
  return {volume, volume * plane.normal};
}

Borrowed Lenders::average(std::int32_t sphere_id, const BorrowRule& rule) const {
  Borrowed sum;
  double weights = 0;
  const Vec3d c = centre(sphere_id);
  for (const Lender& lender : lenders_) {
    if (lender.sphere_id == sphere_id) continue;
    const double weight =
        lender.presence *
        (rule.by_count ? lender.weight : 1.0 / norm(centre(lender.sphere_id) - c));
    const Borrowed part = borrow_from(lender, sphere_id, rule);
    weights += weight;
    sum.volume += weight * part.volume;
    sum.force += weight * part.force;
  }
  if (!(weights > 0)) return {};
  return {sum.volume / weights, sum.force / weights};
}

Borrowed Lenders::borrow(std::int32_t sphere_id, const BorrowRule& rule) const {
  if (rule.edges != nullptr && rule.edges->cuts_off(sphere_id)) return {};
  if (rule.average) return average(sphere_id, rule);
  constexpr int kMost = 4;
  struct Choice {
    double badness = 1e300;
    const Lender* lender = nullptr;
  } best[kMost];
  const Vec3d c = centre(sphere_id);
  for (const Lender& lender : lenders_) {
    const Vec3d d = centre(lender.sphere_id) - c;
    const double badness = rule.by_count ? -lender.weight : dot(d, d);
    if (!(badness < best[kMost - 1].badness) || lender.sphere_id == sphere_id) continue;
    int place = kMost - 1;  // behind those that are as good
    for (; place > 0 && badness < best[place - 1].badness; --place) best[place] = best[place - 1];
    best[place] = {badness, &lender};
  }
  Borrowed sum;
  double weights = 0, uncovered = 1;
  for (const Choice& choice : best) {
    if (choice.lender == nullptr) break;
    const double weight = uncovered * choice.lender->presence;
    const Borrowed part = borrow_from(*choice.lender, sphere_id, rule);
    weights += weight;
    uncovered -= weight;
    sum.volume += weight * part.volume;
    sum.force += weight * part.force;
  }
  if (!(weights > 0)) return {};
  return {sum.volume / weights, sum.force / weights};
}

}  // namespace palpate
