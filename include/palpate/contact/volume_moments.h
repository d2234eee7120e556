// Where the volume of a contact lies: what friction needs to know beside the wrench.
#pragma once

namespace palpate {

/// Levers l_s go from the tool's centre of mass to the spheres, in W.
struct VolumeMoments {
  double first[3][3] = {};  ///< sum of l_s (V_s n_s)^T, m4
  double polar = 0;  ///< sum of V_s |l_s x n_s|^2 and of what cut balls have of their own, m5
};

}  // namespace palpate
