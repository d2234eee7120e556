#include "src/contact/graph_traversal.h"

namespace palpate {

GraphTraversal::GraphTraversal(std::span<const Sphere> spheres, const LeafGraph& graph)
    : spheres_(spheres), graph_(&graph), reached_(spheres.size()), queue_(spheres.size()) {}

std::span<const std::int32_t> GraphTraversal::run(std::span<const Seed> seeds) {
  for (std::size_t i = 0; i < num_queued_; ++i) {
    reached_[static_cast<std::size_t>(queue_[i])].round = kUnreached;
  }
  num_queued_ = 0;
  for (std::size_t s = 0; s < seeds.size(); ++s) {
    queue_[num_queued_++] = seeds[s].sphere_id;
    reached_[static_cast<std::size_t>(seeds[s].sphere_id)] = {0, static_cast<std::int32_t>(s), 0.0};
  }

  const std::span<const std::int32_t> row_starts = graph_->row_starts();
  const std::span<const std::int32_t> neighbours = graph_->neighbours();
  const std::span<const double> lengths = graph_->lengths();
  std::size_t round_begin = 0;
  for (std::int32_t round = 1; round_begin < num_queued_; ++round) {
    const std::size_t round_end = num_queued_;
    for (std::size_t q = round_begin; q < round_end; ++q) {
      const auto i = static_cast<std::size_t>(queue_[q]);
      const Reached from = reached_[i];
      const Vec3d n = seeds[static_cast<std::size_t>(from.seed)].normal;
      const Vec3d c = to_double(spheres_[i].centre);
      const auto row_end = static_cast<std::size_t>(row_starts[i + 1]);
      for (auto e = static_cast<std::size_t>(row_starts[i]); e < row_end; ++e) {
        const auto j = static_cast<std::size_t>(neighbours[e]);
        Reached& to = reached_[j];
        // Reached in an earlier round, or a boundary sphere (round 0).
        if (to.round != kUnreached && to.round != round) continue;
        if (!(dot(to_double(spheres_[j].centre) - c, n) < 0)) continue;
        const double path_length = from.path_length + lengths[e];
        if (to.round == kUnreached) {
          queue_[num_queued_++] = static_cast<std::int32_t>(j);
        } else if (path_length > to.path_length ||
                   (path_length == to.path_length && from.seed >= to.seed)) {
          continue;
        }
        to = {round, from.seed, path_length};
      }
    }
    round_begin = round_end;
  }
  return std::span(queue_).subspan(seeds.size(), num_queued_ - seeds.size());
}

}  // namespace palpate
