// The list of plane donors: boundary spheres with a plane.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "src/contact/points/donors/donor.h"
#include "src/contact/points/donors/plane_assignment.h"

namespace palpate { inline namespace v0 {

/// Ascending by sphere id. All memory is allocated at construction.
class Donors {
 public:
  /// Slots behind the last donor, for whole vectors: far away, no weight.
  static constexpr std::size_t kPadding = 16;

  /// Keeps the view of the spheres.
  explicit Donors(std::span<const Sphere> spheres);

  void clear();
  void add(const Donor& donor);
  /// Call after the last one.
  void pad();

  bool empty() const { return donors_.empty(); }
  int size() const { return static_cast<int>(donors_.size()); }
  const Donor& operator[](std::int32_t i) const { return donors_[static_cast<std::size_t>(i)]; }

  /// Returns the arrays for the kernels. Presences only if requested: they cost time.
  BoundaryPlanes view(bool with_presence) const;
  /// Returns the donor with most weight, ties to the lowest sphere id. There must be one.
  std::int32_t heaviest() const;

  DonorsView donors() const { return {spheres_.data(), donors_.data(), size()}; }

 private:
  enum Channel { kX, kY, kZ, kNx, kNy, kNz, kOffset, kWeight, kPresence, kNumChannels };

  std::span<const Sphere> spheres_;
  std::vector<Donor> donors_;
  // The same in the layout of the kernels.
  std::vector<std::int32_t> ids_;
  std::vector<Plane<double>> planes_;
  std::vector<float> channels_[kNumChannels];
};

}}  // namespace palpate::v0
