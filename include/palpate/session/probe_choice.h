// What a path that nobody gave is to touch, and what was chosen.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "palpate/math/vec3.h"

namespace palpate {

/// What people say about a probing path. All may be empty: then it is chosen.
struct ProbeAim {
  std::optional<std::array<double, 2>> pixel = {};  ///< of the depth image; this or `point_W`
  std::optional<Vec3d> point_W = {};                ///< m, on a surface that the camera sees
  std::optional<Vec3d> tip_T = {};                  ///< m, on the tool: the end that leads
};

/// For people; decides nothing any more.
struct ProbeChoice {
  double u = 0, v = 0;    ///< pixel at which the tool goes in
  Vec3d p_W;              ///< the surface there when it arrives
  double time = 0;        ///< s, when that is
  Vec3d tip_T;            ///< the point of the tool that leads
  std::string why_place;  ///< "the nearest ..."
  std::string why_tip;
  std::string note;  ///< what people should know about the path, and what helps; else empty
};

/// How to choose otherwise, by the options of `palpate touch`.
inline constexpr const char* kHowToAim =
    "aim with --probe u,v (a pixel of the depth image) or --probe x,y,z (a point, m, in camera "
    "axes); choose the end that leads with --tip x,y,z (a point of the tool, m, in the frame of "
    "its mesh)";

}  // namespace palpate
