// The boundary spheres that have a plane to lend.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "src/contact/points/donors/lender.h"
#include "src/contact/points/donors/plane_borrowing.h"

namespace palpate {

/// Ascending by sphere id. All memory is allocated at construction.
class Lenders {
 public:
  /// Places behind the last lender, for whole vectors: far away, no weight.
  static constexpr std::size_t kPadding = 16;

  /// Keeps the view of the spheres.
  explicit Lenders(std::span<const Sphere> spheres);

  void clear();
  void add(const Lender& lender);
  /// After the last one.
  void pad();

  bool empty() const { return lenders_.empty(); }
  int size() const { return static_cast<int>(lenders_.size()); }
  const Lender& operator[](std::int32_t i) const { return lenders_[static_cast<std::size_t>(i)]; }

  /// For the kernels. With presences only if they are asked for: they cost time.
  BoundaryPlanes view(bool with_presence) const;
  /// Most weight, ties to the lowest sphere id. There must be one.
  std::int32_t heaviest() const;

  LendersView lenders() const { return {spheres_.data(), lenders_.data(), size()}; }

 private:
  enum Channel { kX, kY, kZ, kNx, kNy, kNz, kOffset, kWeight, kPresence, kNumChannels };

  std::span<const Sphere> spheres_;
  std::vector<Lender> lenders_;
  // The same as the kernels want it.
  std::vector<std::int32_t> ids_;
  std::vector<Plane<double>> planes_;
  std::vector<float> channels_[kNumChannels];
};

}  // namespace palpate
