#include "src/contact/graph_traversal.h"

#include <algorithm>
#include <limits>

namespace palpate {
namespace {

typedef float Vec4f __attribute__((vector_size(16)));
typedef std::int32_t Vec4i __attribute__((vector_size(16)));

// Single-precision dot products of unit vectors err by less; closer calls are decided in double.
constexpr float kRounding = 1e-6f;

constexpr double kFarAway = std::numeric_limits<double>::infinity();
constexpr std::int32_t kNoSeed = std::numeric_limits<std::int32_t>::min();

}  // namespace

GraphTraversal::GraphTraversal(std::span<const Sphere> spheres, const LeafGraph& graph)
    : spheres_(spheres),
      offers_(spheres.size() + 1, Offer{kFarAway, kNoSeed}),
      visits_(spheres.size() + 1) {
  const auto padding = static_cast<std::int32_t>(spheres.size());
  offers_.back().path_length = -kFarAway;
  for (std::size_t i = 0; i < spheres.size(); ++i) {
    first_block_.push_back(static_cast<std::int32_t>(blocks_.size()));
    const Vec3d c = to_double(spheres[i].centre);
    const std::int32_t begin = graph.row_starts()[i], end = graph.row_starts()[i + 1];
    for (std::int32_t e = begin; e < end; ++e) {
      const std::int32_t slot = (e - begin) % EdgeBlock::kSize;
      if (slot == 0) {
        blocks_.push_back({{}, {}, {}, {padding, padding, padding, padding}});
        lengths_.resize(lengths_.size() + EdgeBlock::kSize);
      }
      const auto edge = static_cast<std::size_t>(e);
      const std::int32_t j = graph.neighbours()[edge];
      const Vec3f direction =
          to_float(normalized(to_double(spheres[static_cast<std::size_t>(j)].centre) - c));
      EdgeBlock& block = blocks_.back();
      block.x[slot] = direction.x;
      block.y[slot] = direction.y;
      block.z[slot] = direction.z;
      block.neighbour[slot] = j;
      lengths_[(blocks_.size() - 1) * EdgeBlock::kSize + static_cast<std::size_t>(slot)] =
          graph.lengths()[edge];
    }
  }
  first_block_.push_back(static_cast<std::int32_t>(blocks_.size()));
}

bool GraphTraversal::points_away_exactly(std::int32_t from, std::int32_t to,
                                         const Vec3d& normal) const {
  if (static_cast<std::size_t>(to) == spheres_.size()) return false;  // padding
  return dot(to_double(spheres_[static_cast<std::size_t>(to)].centre) -
                 to_double(spheres_[static_cast<std::size_t>(from)].centre),
             normal) < 0;
}

// Offers the reference of `from` to its neighbours. Whether an edge points away, and whether an offer
// is accepted, is as good as random, so nothing here branches on it.
void GraphTraversal::walk_edges(const Visit& from, const Vec3d& normal) {
  const Vec3f n = to_float(normal);
  const auto i = static_cast<std::size_t>(from.sphere_id);
  for (std::int32_t b = first_block_[i]; b < first_block_[i + 1]; ++b) {
    const EdgeBlock& block = blocks_[static_cast<std::size_t>(b)];
    const double* lengths = &lengths_[static_cast<std::size_t>(b) * EdgeBlock::kSize];
    const Vec4f cosine = *reinterpret_cast<const Vec4f*>(block.x) * n.x +
                         *reinterpret_cast<const Vec4f*>(block.y) * n.y +
                         *reinterpret_cast<const Vec4f*>(block.z) * n.z;
    Vec4i away = cosine < 0.0f;
    const Vec4i close = (cosine < kRounding) & (cosine > -kRounding);
    if ((close[0] | close[1] | close[2] | close[3]) != 0) {
      for (int slot = 0; slot < EdgeBlock::kSize; ++slot) {
        if (close[slot] == 0) continue;
        away[slot] = points_away_exactly(from.sphere_id, block.neighbour[slot], normal) ? -1 : 0;
      }
    }
    for (int slot = 0; slot < EdgeBlock::kSize; ++slot) {
      const std::int32_t j = block.neighbour[slot];
      Offer& best = offers_[static_cast<std::size_t>(j)];
      const double path_length = away[slot] != 0 ? from.path_length + lengths[slot] : kFarAway;
      const bool shorter = path_length < best.path_length;
      const bool tie = (path_length == best.path_length) & (from.seed < best.seed);
      const bool accepted = shorter | tie;
      visits_[num_visits_].sphere_id = j;
      num_visits_ += accepted & (best.seed == kNoSeed);
      best.path_length = accepted ? path_length : best.path_length;
      best.seed = accepted ? from.seed : best.seed;
    }
  }
}

std::span<const GraphTraversal::Visit> GraphTraversal::run(std::span<const Seed> seeds) {
  for (std::size_t v = 0; v < num_visits_; ++v) {
    offers_[static_cast<std::size_t>(visits_[v].sphere_id)] = {kFarAway, kNoSeed};
  }
  num_visits_ = 0;
  for (std::size_t s = 0; s < seeds.size(); ++s) {
    const auto seed = static_cast<std::int32_t>(s);
    visits_[num_visits_++] = {0.0, seeds[s].sphere_id, seed};
    offers_[static_cast<std::size_t>(seeds[s].sphere_id)] = {-kFarAway, seed};
  }
  for (std::size_t round_begin = 0; round_begin < num_visits_;) {
    const std::size_t round_end = num_visits_;
    for (std::size_t v = round_begin; v < round_end; ++v) {
      constexpr std::size_t kAhead = 4;
      const auto next = static_cast<std::size_t>(visits_[std::min(v + kAhead, round_end)].sphere_id);
      __builtin_prefetch(&blocks_[static_cast<std::size_t>(first_block_[next])]);
      walk_edges(visits_[v], seeds[static_cast<std::size_t>(visits_[v].seed)].normal);
    }
    // What the round reached is settled now.
    for (std::size_t v = round_end; v < num_visits_; ++v) {
      Offer& offer = offers_[static_cast<std::size_t>(visits_[v].sphere_id)];
      visits_[v].path_length = offer.path_length;
      visits_[v].seed = offer.seed;
      offer.path_length = -kFarAway;
    }
    round_begin = round_end;
  }
  return std::span(visits_).subspan(seeds.size(), num_visits_ - seeds.size());
}

}  // namespace palpate
