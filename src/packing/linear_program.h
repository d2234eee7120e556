// The four-variable linear program behind one step of the ascent.
#pragma once

#include <vector>

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// Constraints t <= f_i + n_i . d, each a column so that pricing them runs in vector registers.
struct LinearConstraints {
  std::vector<double> nx, ny, nz, f;

  void clear() { nx.clear(), ny.clear(), nz.clear(), f.clear(); }
  std::size_t size() const { return f.size(); }
  void add(const Vec3d& n, double value) {
    nx.push_back(n.x), ny.push_back(n.y), nz.push_back(n.z), f.push_back(value);
  }
};

struct LinearOptimum {
  Vec3d d;
  double t = 0;
};

/// Maximises t over d and t, subject to the constraints (at least one, n_i of length <= 1) and
/// |d_k| <= box.
LinearOptimum solve_linear_program(const LinearConstraints& constraints, double box);

}}  // namespace palpate::v0
