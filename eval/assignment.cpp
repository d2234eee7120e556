#include "eval/assignment.h"

#include <algorithm>
#include <cmath>
#include <queue>
#include <utility>

#include "palpate/math/sphere.h"

namespace palpate::eval {
namespace {

class Assignment {
 public:
  Assignment(const Tool& tool, const SeenScene& scene, AssignPriority priority, bool is_average)
      : tool_(tool),
        surface_{scene.surface.cloud(), scene.field.view()},
        priority_(priority),
        is_average_(is_average),
        query_(make_contact_query(Backend::cpu, tool,
                                  WeightedMethod{.volumes = SphereVolumes::represented})
                   .value()),
        states_(tool.spheres().size()),
        planes_(tool.spheres().size()) {
    const Bounds box = bounds(tool.mesh());
    const Vec3d size = box.high - box.low;
    sigma_ = std::max({size.x, size.y, size.z}) / 12;
  }

  Penetration at(const Pose& X_WT) {
    query_->measure(surface_, X_WT, {.states = states_, .planes = planes_});
    donors_.clear();
    for (std::size_t i = 0; i < states_.size(); ++i) {
      if (states_[i] != SphereState::boundary || norm(planes_[i].normal) == 0) continue;
      donors_.push_back(i);
    }
    if (priority_ == AssignPriority::along) find_ways();
    Penetration sum;
    for (std::size_t i = 0; i < states_.size(); ++i) {
      double volume = 0;
      Vec3d force_T;
      if (states_[i] == SphereState::boundary) {
        if (norm(planes_[i].normal) > 0) take(i, i, 1, volume, force_T);
      } else {
        assign(i, volume, force_T);
      }
      const Vec3d c_T = centre(i);
      sum.volume += volume;
      sum.measure_W.force += force_T;
      sum.measure_W.torque += cross(c_T - tool_.sphere_mass().centre_of_mass, force_T);
    }
    sum.measure_W.force = rotate(X_WT.rotation, sum.measure_W.force);
    sum.measure_W.torque = rotate(X_WT.rotation, sum.measure_W.torque);
    return sum;
  }

 private:
  Vec3d centre(std::size_t i) const { return to_double(tool_.spheres()[i].centre); }

  /// Adds `weight` times what sphere i has behind the plane of `donor`.
  void take(std::size_t i, std::size_t donor, double weight, double& volume, Vec3d& force) const {
    const Plane<float>& plane = planes_[donor];
    const Vec3d n = to_double(plane.normal);
    const double radius = tool_.spheres()[i].radius;
    const double part = weight * tool_.represented_volumes()[i] / sphere_volume(radius) *
                        cap_volume(radius, dot(n, centre(i)) - static_cast<double>(plane.offset));
    volume += part;
    force += part * n;
  }

  double weight_of(std::size_t i, std::size_t l) const {
    const std::size_t donor = donors_[l];
    const Vec3d d = centre(donor) - centre(i);
    const double d2 = dot(d, d), length = std::sqrt(d2);
    switch (priority_) {
      case AssignPriority::distance: return 1 / length;
      case AssignPriority::square: return 1 / d2;
      case AssignPriority::fourth: return 1 / (d2 * d2);
      case AssignPriority::gaussian: return std::exp(-d2 / (2 * sigma_ * sigma_)) + 1e-300;
      case AssignPriority::agreement:
        return std::max(1e-3, dot(to_double(planes_[donor].normal), d) / length) / length;
      case AssignPriority::along: return 1 / ways_[l][i];
    }
    return 0;
  }

  void assign(std::size_t i, double& volume, Vec3d& force) const {
    double weights = 0, most = 0;
    std::size_t best = 0;
    for (std::size_t l = 0; l < donors_.size(); ++l) {
      const double weight = weight_of(i, l);
      weights += weight;
      if (is_average_) take(i, donors_[l], weight, volume, force);
      if (weight > most) most = weight, best = l;
    }
    if (donors_.empty()) return;
    if (is_average_) {
      volume /= weights;
      force = 1 / weights * force;
    } else {
      take(i, donors_[best], 1, volume, force);
    }
  }

  /// From every donor to all spheres (Dijkstra).
  void find_ways() {
    const auto starts = tool_.graph().row_starts(), neighbours = tool_.graph().neighbours();
    using Entry = std::pair<double, std::size_t>;
    ways_.assign(donors_.size(), std::vector<double>(states_.size(), 1e9));
    for (std::size_t l = 0; l < donors_.size(); ++l) {
      std::vector<double>& way = ways_[l];
      std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
      way[donors_[l]] = 0;
      open.push({0, donors_[l]});
      while (!open.empty()) {
        const auto [length, i] = open.top();
        open.pop();
        if (length > way[i]) continue;
        for (auto e = starts[i]; e < starts[i + 1]; ++e) {
          const auto j = static_cast<std::size_t>(neighbours[static_cast<std::size_t>(e)]);
          const double longer = length + norm(centre(j) - centre(i));
          if (longer >= way[j]) continue;
          way[j] = longer;
          open.push({longer, j});
        }
      }
    }
  }

  const Tool& tool_;
  SurfaceView surface_;
  AssignPriority priority_;
  bool is_average_;
  double sigma_ = 0;
  std::unique_ptr<ContactQuery> query_;
  std::vector<SphereState> states_;
  std::vector<Plane<float>> planes_;
  std::vector<std::size_t> donors_;
  std::vector<std::vector<double>> ways_;  ///< of a donor to a sphere
};

}  // namespace

Measure assignment_measure(const Tool& tool, const SeenScene& scene, AssignPriority priority,
                           bool is_average) {
  const auto assignment = std::make_shared<Assignment>(tool, scene, priority, is_average);
  return {full_volume(tool, SphereVolumes::represented),
          [assignment](const Pose& X_WT) { return assignment->at(X_WT); }};
}

}  // namespace palpate::eval
