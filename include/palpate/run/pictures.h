// Pictures of a run for humans who look on: how the spheres are, and the surface.
#pragma once

#include <cstdint>
#include <vector>

#include "palpate/contact/contact_query.h"
#include "palpate/run/records.h"

namespace palpate {

/// How every sphere of the tool was at one contact.
struct ContactPicture {
  std::uint64_t contact_number = 0, frame_number = 0;
  Pose X_WT;
  BodyPoses bodies;                  ///< of objects that move
  std::vector<SphereState> states;   ///< of every sphere
  std::vector<Plane<float>> planes;  ///< ContactQuery::planes
};

/// The newest surface, as it was estimated: per pixel a point with normal and depth-change vector.
struct SurfacePicture {
  std::uint64_t frame_number = 0;
  int width = 0, height = 0;
  std::vector<Vec3f> points, normals;  ///< NaN where there is none
  std::vector<Vec3f> edges;            ///< depth-change vectors; empty if they are not looked for
};

inline void make_surface_picture(const PointCloud& seen, std::uint64_t frame_number,
                                 SurfacePicture& picture) {
  picture.frame_number = frame_number;
  picture.width = seen.width();
  picture.height = seen.height();
  picture.points.resize(seen.size());
  picture.normals.resize(seen.size());
  picture.edges.resize(seen.has_edges() ? seen.size() : 0);
  for (std::size_t i = 0; i < seen.size(); ++i) {
    picture.points[i] = seen.point(i);
    picture.normals[i] = seen.normal(i);
    if (seen.has_edges()) picture.edges[i] = seen.edge(i);
  }
}

}  // namespace palpate
