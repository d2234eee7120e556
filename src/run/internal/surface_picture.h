// Makes the surface of a run that is shown.
#pragma once

#include <cstddef>
#include <cstdint>

#include "palpate/run/run_loop.h"

namespace palpate { inline namespace v0 {

/// Makes a picture of the points of a frame, in the memory of an older one.
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

}}  // namespace palpate::v0
