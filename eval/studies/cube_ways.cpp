#include "eval/studies/cube_ways.h"

#include <algorithm>

namespace palpate::eval {
namespace {

Vec3d normal_of(int face) {
  Vec3d n;
  n[static_cast<std::size_t>(face / 2)] = face % 2 == 0 ? -1 : 1;
  return n;
}

}  // namespace

std::array<int, 2> best_faces(const RealCube& cube) {
  std::array<int, 6> num{};
  for (const CubeFrame& f : cube.frames) {
    for_each_cube_pixel(
        cube.stream, f.X_CB, cube.half_size, 4,
        [&](std::size_t, const CubeHit& hit) { ++num[static_cast<std::size_t>(hit.face)]; });
  }
  const auto most = [&] {
    const auto at = std::max_element(num.begin(), num.end());
    *at = -1;
    return static_cast<int>(at - num.begin());
  };
  const int first = most();
  return {first, most()};
}

std::vector<CubeWay> ways_on(const std::array<int, 2>& faces, double half_size) {
  const Vec3d a = normal_of(faces[0]), b = normal_of(faces[1]);
  return {{"large face", -a, half_size * a},
          {"slanted face", -b, half_size * b},
          {"edge between them", -1 * normalized(a + b), half_size * (a + b)}};
}

Pose pose_on(const CubeWay& way, const TriangleMesh& tool_T, double depth) {
  double reach = 0;
  for (const Vec3d& p : tool_T.vertices) {
    reach = std::max(reach, dot(rotate(kTurned, p), way.into_B));
  }
  return {way.contact_B + (depth - reach) * way.into_B, kTurned};
}

}  // namespace palpate::eval
