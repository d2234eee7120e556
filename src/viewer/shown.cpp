#include "src/viewer/shown.h"

namespace palpate {

ViewSurface surface_shown(const PointCloud& seen, const PointCloudView& felt,
                          std::uint64_t frame_number) {
  ViewSurface shown{frame_number, seen.width(), seen.height(), {}, {}, {}};
  shown.points.reserve(seen.size());
  shown.normals.reserve(seen.size());
  for (std::size_t i = 0; i < seen.size(); ++i) {
    shown.points.push_back(seen.point(i));
    shown.normals.push_back(seen.normal(i));
  }
  if (felt.edge_x == nullptr || felt.gpu != kHostMemory || felt.size() != seen.size()) return shown;
  shown.edges.reserve(seen.size());
  for (std::size_t i = 0; i < seen.size(); ++i) {
    shown.edges.push_back({felt.edge_x[i], felt.edge_y[i], felt.edge_z[i]});
  }
  return shown;
}

ViewContact contact_shown(const ContactQuery& query, const Pose& X_WT, double time,
                          std::uint64_t frame_number) {
  const auto states = query.states();
  const auto planes = query.planes();
  return {time, frame_number, X_WT, {states.begin(), states.end()}, {planes.begin(), planes.end()}};
}

ForceScale force_shown(const Tool& tool, const ContactOptions& contact) {
  constexpr double kForceAtEighth = 10;  // N
  return thesis_force_scale(kForceAtEighth, full_volume(tool, contact));
}

ViewSample sample_shown(double time, const Pose& X_WT, const Wrench& measure_W, double volume,
                        double query_seconds, const ForceScale& scale) {
  ViewSample sample;
  sample.time = time;
  sample.contact_W = {scale.newtons_per_cubic_metre * measure_W.force,
                      scale.newtons_per_cubic_metre * measure_W.torque};
  sample.volume = volume;
  sample.compute_seconds = query_seconds;
  sample.X_WT = sample.X_WT_hand = X_WT;
  return sample;
}

}  // namespace palpate
