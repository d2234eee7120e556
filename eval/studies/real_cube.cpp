#include "eval/studies/real_cube.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "eval/studies/frozen_frame.h"
#include "eval/studies/range.h"
#include "palpate/cloud/point_cloud.h"
#include "palpate/io/files.h"
#include "palpate/io/formats.h"
#include "src/math/internal/rotation_vector.h"

namespace palpate::eval {
namespace {

constexpr const char* kRecording = "sequences/visp_rbt";
/// X_WC by time, in the format of a camera's `poses=`.
constexpr const char* kTracked = "trajectories/visp_rbt_camera_in_grid_tum.txt";
/// Approximate pose of the cube in the first image, estimated by eye.
const Pose kFirstGuess{{-0.05, 0.05, 0.5}, normalized(Quaternion{-0.36, 0.63, -0.62, -0.29})};

constexpr double kMargin = 0.006;  // m from edges, where pixels are mixed
constexpr double kMinSlant = 0.25;
constexpr double kTypical = 0.003;  // m: scale of the robust weights; larger residuals count less
constexpr std::size_t kMinPixels = 100;

using Vec6 = std::array<double, 6>;

/// Solves a x = b for a symmetric, positive a (Gauss-Jordan; the largest pivots are on the
/// diagonal).
Vec6 solved(std::array<Vec6, 6> a, Vec6 b) {
  for (std::size_t i = 0; i < 6; ++i) {
    for (std::size_t row = 0; row < 6; ++row) {
      if (row == i) continue;
      const double factor = a[row][i] / a[i][i];
      for (std::size_t k = i; k < 6; ++k) a[row][k] -= factor * a[i][k];
      b[row] -= factor * b[i];
    }
  }
  for (std::size_t i = 0; i < 6; ++i) b[i] /= a[i][i];
  return b;
}

/// Slides the cube along the least visible axis to where most of its pixels agree: two planes leave
/// the motion along their edge free, but its ends constrain it.
void slide(const DepthStreamInfo& stream, const DepthFrame& frame, double half, std::size_t axis,
           Pose& X_CB) {
  constexpr int kStep = 3;
  constexpr double kReach = 0.02, kShift = 0.001, kAgrees = 0.005;  // m
  int most = -1000000;
  Pose best = X_CB;
  for (double shift = -kReach; shift < kReach; shift += kShift) {
    Vec3d moved;
    moved[axis] = shift;
    const Pose X_CM = X_CB * Pose{moved, {}};
    int score = 0;
    for_each_cube_pixel(stream, X_CM, half, kStep, [&](std::size_t pixel, const CubeHit& hit) {
      if (frame.pixels[pixel] == 0) return;
      score += std::abs(frame.pixels[pixel] * stream.unit - hit.z) < kAgrees ? 1 : -1;
    });
    if (score > most) most = score, best = X_CM;
  }
  X_CB = best;
}

}  // namespace

Pose middle_pose(const std::vector<Pose>& X_WB) {
  Pose middle;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    for (const Pose& X : X_WB) values.push_back(X.translation[axis]);
    middle.translation[axis] = percentile(std::move(values), 0.5);
  }
  double least = INFINITY;
  for (const Pose& candidate : X_WB) {
    double sum = 0;
    for (const Pose& X : X_WB) sum += norm(rotation_between(candidate.rotation, X.rotation));
    if (sum < least) least = sum, middle.rotation = normalized(candidate.rotation);
  }
  return middle;
}

Result<std::vector<Pose>> poses_by_depth(const RealCube& cube, int& num_by_tracking) {
  constexpr double kFarMoved = 0.12, kFarTurned = 12 * kPi / 180;  // m, rad: a new key frame
  struct KeyFrame {
    FrozenFrame seen;
    Pose X_WC, tracked_X_WC;
  };
  std::optional<KeyFrame> key;
  std::vector<Pose> poses;
  num_by_tracking = 0;
  for (std::size_t i = 0; i < cube.frames.size(); ++i) {
    const DepthFrame& frame = cube.frames[i].frame;
    auto seen = FrozenFrame::create(cube.stream, frame);
    if (!seen) return seen.error();
    const auto align = [&]() -> std::optional<Pose> {
      const Pose guess = key->X_WC * (inverse(key->tracked_X_WC) * frame.X_WC);
      const PointCloudView clouds[] = {key->seen.cloud(), seen->cloud()};
      const auto aligned = align_views(clouds, std::array{key->X_WC, guess}, {});
      return aligned ? std::optional(aligned->X_WC[1]) : std::nullopt;
    };
    const auto is_far = [&](const Pose& X_WC) {
      const Pose way = inverse(key->X_WC) * X_WC;
      return norm(way.translation) > kFarMoved ||
             norm(rotation_between({}, way.rotation)) > kFarTurned;
    };
    std::optional<Pose> X_WC = key ? align() : frame.X_WC;
    if (!X_WC) {
      ++num_by_tracking;
      X_WC = poses.back() * (inverse(cube.frames[i - 1].frame.X_WC) * frame.X_WC);
    }
    poses.push_back(*X_WC);
    if (!key || is_far(*X_WC)) key.emplace(KeyFrame{*std::move(seen), *X_WC, frame.X_WC});
  }
  return poses;
}

bool lay_on(const DepthStreamInfo& stream, const DepthFrame& frame, double half, Pose& X_CB) {
  constexpr int kRounds = 30, kSlideEvery = 10, kStep = 2;
  constexpr double kDamping = 1e-7;
  for (int round = 0; round < kRounds; ++round) {
    const double limit = round < 12 ? 0.03 : round < 20 ? 0.012 : 0.008;  // m
    const Pose X_BC = inverse(X_CB);
    std::array<std::array<Vec6, 6>, 6> squares{};  // by face
    std::array<Vec6, 6> products{};
    std::array<std::size_t, 6> num{};
    for_each_cube_pixel(stream, X_CB, half, kStep, [&](std::size_t pixel, const CubeHit& hit) {
      const double z = frame.pixels[pixel] * stream.unit;
      if (frame.pixels[pixel] == 0 || std::abs(z - hit.z) > limit) return;
      if (hit.border < kMargin || hit.slant < kMinSlant) return;
      const Intrinsics& k = stream.intrinsics;
      const auto u = static_cast<double>(pixel % static_cast<std::size_t>(stream.width));
      const auto v = static_cast<double>(pixel / static_cast<std::size_t>(stream.width));
      const Vec3d p = X_BC * Vec3d{(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z};
      const auto face = static_cast<std::size_t>(hit.face);
      Vec3d n;
      n[face / 2] = face % 2 == 0 ? -1 : 1;
      const double distance = dot(p, n) - half;
      const double weight = 1 / (1 + distance * distance / (kTypical * kTypical));
      const Vec3d turning = cross(p, n);
      const Vec6 slope{turning.x, turning.y, turning.z, n.x, n.y, n.z};
      for (std::size_t i = 0; i < 6; ++i) {
        products[face][i] += weight * slope[i] * distance;
        for (std::size_t j = 0; j < 6; ++j) squares[face][i][j] += weight * slope[i] * slope[j];
      }
      ++num[face];
    });
    std::array<Vec6, 6> a{};
    Vec6 b{};
    std::size_t all = 0;
    for (std::size_t face = 0; face < 6; ++face) {
      all += num[face];
      if (num[face] < kMinPixels) continue;
      const auto count = static_cast<double>(num[face]);
      for (std::size_t i = 0; i < 6; ++i) {
        b[i] += products[face][i] / count;
        for (std::size_t j = 0; j < 6; ++j) a[i][j] += squares[face][i][j] / count;
      }
    }
    if (all < 10 * kMinPixels) return false;
    for (std::size_t i = 0; i < 6; ++i) a[i][i] += kDamping;
    const Vec6 step = solved(a, b);
    X_CB = X_CB * Pose{{step[3], step[4], step[5]}, rotation_by({step[0], step[1], step[2]})};
    X_CB.rotation = normalized(X_CB.rotation);
    if (round % kSlideEvery == kSlideEvery - 1 && round + 1 < kRounds) {
      std::size_t axis = 0;
      const auto seen_of = [&](std::size_t i) { return num[2 * i] + num[2 * i + 1]; };
      for (std::size_t i = 1; i < 3; ++i) axis = seen_of(i) < seen_of(axis) ? i : axis;
      slide(stream, frame, half, axis, X_CB);
    }
  }
  return true;
}

std::optional<CubeHit> hit_cube(const Pose& X_CB, double half_size, const Vec3d& ray_C) {
  const Quaternion R_BC = conjugate(X_CB.rotation);
  const Vec3d from = rotate(R_BC, -X_CB.translation), ray = rotate(R_BC, ray_C);
  double enter = 0, leave = INFINITY;
  std::size_t axis = 3;
  for (std::size_t i = 0; i < 3; ++i) {
    const double a = (-half_size - from[i]) / ray[i], b = (half_size - from[i]) / ray[i];
    if (std::min(a, b) > enter) enter = std::min(a, b), axis = i;
    leave = std::min(leave, std::max(a, b));
  }
  if (axis == 3 || enter >= leave) return std::nullopt;
  const Vec3d p = from + enter * ray;
  CubeHit hit{enter * ray_C.z, static_cast<int>(2 * axis + (ray[axis] < 0)), half_size,
              std::abs(ray[axis]) / norm(ray)};
  for (std::size_t i = 0; i < 3; ++i) {
    if (i != axis) hit.border = std::min(hit.border, half_size - std::abs(p[i]));
  }
  return hit;
}

Result<std::optional<RealCube>> real_cube(Context& context, std::size_t stride) {
  RealCube cube;
  auto frames = context.recorded(kRecording, cube.stream);
  if (!frames) return frames.error();
  if (!*frames) return std::optional<RealCube>();
  const auto& data = context.settings().data;
  const auto tracked = load_trajectory(data / kTracked);
  if (!tracked) return tracked.error();
  const auto mesh = load_mesh(data / "meshes_good/visp_cube.obj");
  if (!mesh) return mesh.error();
  cube.half_size = bounds(*mesh).high.x;

  Pose X_WB;
  for (std::size_t i = 0; i < (*frames)->size(); ++i) {
    CubeFrame seen{std::move((**frames)[i]), kFirstGuess, {}};
    seen.frame.X_WC = pose_at(*tracked, seen.frame.timestamp);
    if (i > 0) seen.X_CB = inverse(seen.frame.X_WC) * X_WB;
    if (!lay_on(cube.stream, seen.frame, cube.half_size, seen.X_CB)) {
      return Error{Errc::bad_input, std::string(kRecording) + ", frame " + std::to_string(i) +
                                        ": the cube cannot be found in it"};
    }
    X_WB = seen.frame.X_WC * seen.X_CB;
    if (i % stride == 0) cube.frames.push_back(std::move(seen));
    context.progress(0.2 * static_cast<double>(i) / static_cast<double>((*frames)->size()));
  }
  std::vector<Pose> X_WB_by_frame;
  for (const CubeFrame& f : cube.frames) X_WB_by_frame.push_back(f.frame.X_WC * f.X_CB);
  cube.X_WB = middle_pose(X_WB_by_frame);
  for (CubeFrame& f : cube.frames) {
    f.tracked_shift = inverse(f.frame.X_WC * f.X_CB) * cube.X_WB;
  }
  return std::optional(std::move(cube));
}

}  // namespace palpate::eval
