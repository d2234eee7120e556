// Boundary spheres that have a plane to lend, and what one sphere gets from all of them.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "src/contact/edge_planes.h"
#include "src/contact/plane_borrowing.h"

namespace palpate {

struct Lender {
  std::int32_t sphere_id = -1;
  Plane<double> plane_T;
  LenderPoint point;
  double weight = 0;    ///< points inside, or the sum of their kernel weights: priority `count`
  double presence = 1;  ///< 0 for a sphere that a point is about to enter; see Continuity
};

/// V_s and V_s n_s.
struct Borrowed {
  double volume = 0;
  Vec3d force;
};

/// How a sphere borrows.
struct BorrowRule {
  bool average = false;  ///< over all lenders; otherwise from the best one
  bool by_count = false;
  const EdgePlanes* edges = nullptr;
};

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

  /// What one lender gives to a sphere.
  Borrowed borrow_from(const Lender& lender, std::int32_t sphere_id, const BorrowRule& rule) const;
  /// What all lenders but the sphere itself give to it. The best one covers those behind it, but
  /// only as far as it is present: up to four are laid over each other, nearest first. So a lender
  /// that appears or vanishes changes nothing suddenly.
  Borrowed borrow(std::int32_t sphere_id, const BorrowRule& rule) const;

 private:
  enum Channel { kX, kY, kZ, kNx, kNy, kNz, kOffset, kWeight, kPresence, kNumChannels };

  Borrowed average(std::int32_t sphere_id, const BorrowRule& rule) const;
  Vec3d centre(std::int32_t sphere_id) const {
    return to_double(spheres_[static_cast<std::size_t>(sphere_id)].centre);
  }

  std::span<const Sphere> spheres_;
  std::vector<Lender> lenders_;
  // The same as the kernels want it.
  std::vector<std::int32_t> ids_;
  std::vector<Plane<double>> planes_;
  std::vector<float> channels_[kNumChannels];
};

}  // namespace palpate
