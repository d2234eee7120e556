// Tools and straight ways into the recorded cube, the same in all its figures.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "eval/studies/real_cube.h"

namespace palpate::eval {

inline constexpr const char* kTools[] = {"box", "octahedron"};
inline constexpr double kToolSize = 0.03;  // m
inline constexpr int kSpheres = 2000;
/// Orientation of the tools in the cube's frame B.
inline const Quaternion kTurned = axis_angle({0.3, 1, 0.2}, 0.4);

inline constexpr double kBefore = 0.002;    // m from first contact, where ways begin
inline constexpr double kDeepest = 0.008;   // m
inline constexpr double kMinShare = 0.005;  // of a tool: less has no reliable direction

/// A straight way into the cube, in B.
struct CubeWay {
  std::string name;
  Vec3d into_B, contact_B;
};

/// Returns the best-visible faces of the cube: those with most pixels.
std::array<int, 2> best_faces(const RealCube& cube);

/// Returns the ways into the middle of both faces and onto the edge between them.
std::vector<CubeWay> ways_on(const std::array<int, 2>& faces, double half_size);

/// Returns the pose of the tool at a depth of a way.
Pose pose_on(const CubeWay& way, const TriangleMesh& tool_T, double depth);

}  // namespace palpate::eval
