// The spheres inserted so far, with a fast search for near ones of any size.
#pragma once

#include <cstdint>
#include <vector>

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// A hash grid per power of two of the radius. A level keeps a sphere in every cell that lies
/// within a margin of it, so a search not wider than the margin reads one cell per level. Reading
/// from several threads is safe, inserting is not.
class SphereLevels {
 public:
  void insert(const Sphere& sphere);

  /// Distance from p to the nearest sphere surface (negative inside), or `reach` if that is less.
  double clearance(const Vec3d& p, double reach) const;

  /// The same, and which sphere it is; `sphere` is left alone when none is within reach.
  double nearest(const Vec3d& p, double reach, Sphere& sphere) const;

  /// Appends the spheres whose surface is not farther than `reach` from p, perhaps some twice;
  /// false, with a part of them appended, as soon as they are more than `limit`.
  bool gather(const Vec3d& p, double reach, std::size_t limit, std::vector<Sphere>& out) const;

 private:
  static constexpr int kBlockSize = 6;
  struct Block {
    Sphere spheres[kBlockSize];
    std::int32_t num;
    std::int32_t next;
  };
  struct Cell {
    std::uint64_t key;
    std::int32_t head;  ///< newest block; -1: the cell is free
  };
  struct Level {
    int exponent = 0;
    double cell_size = 0, margin = 0;
    std::size_t num_cells = 0;
    std::vector<Cell> cells;  ///< open addressing, a power of two
    std::vector<Sphere> spheres;

    std::int32_t* find_or_add(std::uint64_t key);
    std::int32_t find(std::uint64_t key) const;
    void grow();
  };

  template <class Visit>
  void visit(const Vec3d& p, double reach, Visit&& visit) const;

  std::vector<Level> levels_;  ///< by descending radius
  std::vector<Block> blocks_;
};

}}  // namespace palpate::v0
