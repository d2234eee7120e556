// The loops that look for silhouettes in the rows of a depth field, compiled once per instruction
// set.
#include <algorithm>
#include <cstring>

#include "src/core/internal/simd_rows.h"
#include "src/field/pyramid/field_rows.h"
#include "src/field/pyramid/silhouette_rules.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {
namespace {

constexpr int kSegment = SilhouetteScratch::kSegment, kBorder = SilhouetteScratch::kBorder;
static_assert(kSegment % kLanes == 0);

inline RulePlane load_plane(const TangentPlane* from) {
  const Pairs pairs = load_pairs(&from->offset);
  return {pairs.first, pairs.second};
}

inline PixelSilhouettes load_found(const SilhouetteScratch& scratch, std::ptrdiff_t at) {
  const auto nearest = [&](int first) {
    NearestSilhouette n;
    n.du = load(scratch.found[first] + at);
    n.squared = select(n.du != splat(0.0f), n.du * n.du, n.squared);
    n.other = {load(scratch.found[first + 1] + at), load(scratch.found[first + 2] + at)};
    return n;
  };
  return {nearest(0), nearest(3)};
}

inline void store_found(const SilhouetteScratch& scratch, std::ptrdiff_t at,
                        const PixelSilhouettes& found) {
  int channel = 0;
  for (const NearestSilhouette* n : {&found.exit, &found.occluder}) {
    for (const VecF& values : {n->du, n->other.offset, n->other.slope}) {
      store(scratch.found[channel++] + at, values);
    }
  }
}

/// Calls f(column, place in the scratch) for the vectors of a segment.
template <class F>
inline void for_vectors(const SilhouetteScratch& scratch, int v, int segment, const F& f) {
  const std::ptrdiff_t at = scratch.pixel(v, segment);
  for (int i = 0; i < kSegment; i += kLanes) f(segment * kSegment + i - kBorder, at + i);
}

/// The lowest bits, one for each lane of a vector.
struct Lanes {
  std::uint32_t bits;

  Mask mask() const { return ((splat(static_cast<std::int32_t>(bits)) >> lane_ids()) & 1) != 0; }
};
inline Lanes lanes_of(std::uint64_t bits) {
  return {static_cast<std::uint32_t>(bits & ((std::uint64_t{1} << kLanes) - 1))};
}

/// SilhouetteScratch::edges_right of the segment before, of the segment and of the one after it.
inline std::uint64_t edges_around(const SilhouetteScratch& scratch, int v, int segment) {
  const std::uint16_t* const at = scratch.edges_right + scratch.segment(v, segment);
  std::uint64_t edges = std::uint64_t{at[0]} << kSegment;
  if (segment > 0) edges |= at[-1];
  if (segment + 1 < scratch.num_segments) edges |= std::uint64_t{at[1]} << (2 * kSegment);
  return edges;
}

/// The segments [first, end) that have columns of the window, and so many more on both sides.
struct Segments {
  int first, end;

  Segments(const FieldImage& image, const PixelWindow& window, int beside = 0)
      : first(std::max((window.left + kBorder) / kSegment - beside, 0)),
        end(std::min((window.right - 1 + kBorder) / kSegment + 1 + beside,
                     (image.width + 2 * kBorder + kSegment - 1) / kSegment)) {}
};

/// Writes both silhouettes of the pixels of a vector that queries look at.
void store_silhouettes(const FieldImage& image, int v, int u, const PixelSilhouettes& found,
                       VecF exit_side, VecF occluder_side) {
  static_assert(sizeof(Silhouette) == 4 * sizeof(float));
  Silhouette* const to = image.silhouettes + 2 * (v * image.stride + u);
  const int begin = std::max(0, -kSilhouetteBorder - u);
  const int end = std::min(kLanes, image.width + kSilhouetteBorder + 1 - u);
  const VecF& exit_offset = found.exit.other.offset;
  const VecF& occluder_offset = found.occluder.other.offset;
  if (begin == 0 && end == kLanes) {
    store_fours(&to[0].side, 8, {exit_side, exit_offset, found.exit.other.slope, VecF{}});
    store_fours(&to[1].side, 8,
                {occluder_side, occluder_offset, found.occluder.other.slope, VecF{}});
    return;
  }
  for (int i = begin; i < end; ++i) {
    to[2 * i] = {exit_side[i], exit_offset[i], found.exit.other.slope[i], 0};
    to[2 * i + 1] = {occluder_side[i], occluder_offset[i], found.occluder.other.slope[i], 0};
  }
}

}  // namespace

void find_edges(const Intrinsics& k, const FieldImage& image, int level, const PixelWindow& window,
                int v, const SilhouetteScratch& scratch) {
  const RuleLevel rules = rule_level(k, level);
  const TangentPlane* const rows[2] = {image.row(v), image.row(v + 1)};
  const Segments segments(image, window, 1);
  for (int segment = segments.first; segment < segments.end; ++segment) {
    std::uint32_t right = 0, down = 0;
    const std::ptrdiff_t first = scratch.pixel(v, segment);
    for_vectors(scratch, v, segment, [&](int u, std::ptrdiff_t at) {
      const RulePlane own = load_plane(rows[0] + u);
      right |= mask_bits(is_edge(own, load_plane(rows[0] + u + 1), rules.width_u)) << (at - first);
      down |= mask_bits(is_edge(own, load_plane(rows[1] + u), rules.width_v)) << (at - first);
    });
    scratch.edges_right[scratch.segment(v, segment)] = static_cast<std::uint16_t>(right);
    scratch.edges_down[scratch.segment(v, segment)] = static_cast<std::uint16_t>(down);
  }
}

void find_in_row(const Intrinsics& k, const FieldImage& image, int level, const PixelWindow& window,
                 int v, const SilhouetteScratch& scratch) {
  const RuleLevel rules = rule_level(k, level);
  const TangentPlane* const row = image.row(v);
  const float* const shares = image.share_row(v);
  const Segments segments(image, window);
  for (int segment = segments.first; segment < segments.end; ++segment) {
    if (!scratch.is_active(v, segment)) continue;
    const std::uint64_t edges = edges_around(scratch, v, segment);
    const std::ptrdiff_t first = scratch.pixel(v, segment);
    for_vectors(scratch, v, segment, [&](int u, std::ptrdiff_t at) {
      const RulePlane own = load_plane(row + u);
      PixelSilhouettes found;
      // The edge between pixels u + from and u + from + 1.
      const auto take = [&](int from) {
        const Lanes is_any = lanes_of(edges >> (kSegment + (at - first) + from));
        if (is_any.bits == 0) return;
        const VecF shift = edge_shift(load(shares + u + from), load(shares + u + from + 1));
        take_edge(own, load_plane(row + u + from), load_plane(row + u + from + 1), is_any.mask(),
                  static_cast<float>(from) + 0.5f + shift, splat(0.0f), rules.width_u, found);
      };
      for (int n = 1; n <= kReach; ++n) {
        take(n - 1);
        take(-n);
      }
      store_found(scratch, at, found);
    });
  }
}

void find_silhouettes(const Intrinsics& k, const FieldImage& image, int level,
                      const PixelWindow& window, int v, const SilhouetteScratch& scratch) {
  const RuleLevel rules = rule_level(k, level);
  const float y = rules.first_v + static_cast<float>(v) * rules.width_v;
  const Segments segments(image, window);
  for (int segment = segments.first; segment < segments.end; ++segment) {
    // Queries beside a silhouette read up to two rows farther on.
    bool is_active = false;
    for (int row = std::max(v - kReach - 2, window.top - kReach);
         row < std::min(v + kReach + 3, window.bottom + kReach); ++row) {
      is_active = is_active || scratch.is_active(row, segment);
    }
    if (!is_active) {
      std::memset(scratch.has_any + scratch.pixel(v, segment), 0, kSegment);
      scratch.any_found[scratch.segment(v, segment)] = 0;
      continue;
    }
    std::uint32_t any_found = 0;
    const std::ptrdiff_t first = scratch.pixel(v, segment);
    for_vectors(scratch, v, segment, [&](int u, std::ptrdiff_t at) {
      const RulePlane own = load_plane(image.row(v) + u);
      PixelSilhouettes found;
      if (scratch.is_active(v, segment)) found = load_found(scratch, at);
      // The edge between rows v + from and v + from + 1.
      const auto take = [&](int from) {
        const Lanes is_any =
            lanes_of(scratch.edges_down[scratch.segment(v + from, segment)] >> (at - first));
        if (is_any.bits == 0) return;
        const VecF shift = edge_shift(load(image.share_row(v + from) + u),
                                      load(image.share_row(v + from + 1) + u));
        take_edge(own, load_plane(image.row(v + from) + u), load_plane(image.row(v + from + 1) + u),
                  is_any.mask(), splat(0.0f), static_cast<float>(from) + 0.5f + shift,
                  rules.width_v, found);
      };
      for (int n = 1; n <= kReach; ++n) {
        take(n - 1);
        take(-n);
        for (const int row : {n, -n}) {
          if (!scratch.is_active(v + row, segment)) continue;
          take_found(own, load_found(scratch, at + row * scratch.stride()),
                     splat(static_cast<float>(row)), rules.width_u, found);
        }
      }
      const VecF x = rules.first_u + (to_float(lane_ids()) + static_cast<float>(u)) * rules.width_u;
      const Mask has_exit = is_any(found.exit), has_occluder = is_any(found.occluder);
      const VecF zero{};
      store_silhouettes(image, v, u, found,
                        select(has_exit, -side_of(found.exit, x, splat(y), rules), zero),
                        select(has_occluder, side_of(found.occluder, x, splat(y), rules), zero));
      const std::uint32_t any = mask_bits(has_exit | has_occluder);
      for (int i = 0; i < kLanes; ++i) scratch.has_any[at + i] = any >> i & 1;
      any_found |= any;
    });
    scratch.any_found[scratch.segment(v, segment)] = any_found != 0;
  }
}

void mark_silhouettes(const FieldImage& image, const PixelWindow& window, int v,
                      const SilhouetteScratch& scratch) {
  std::uint8_t* const near = image.near_silhouette + v * image.stride;
  const std::ptrdiff_t stride = scratch.stride();
  const Segments segments(image, window);
  for (int segment = segments.first; segment < segments.end; ++segment) {
    const int first = segment * kSegment - kBorder;
    const int begin = std::max(first, 1 - kSilhouetteBorder);
    const int end = std::min(first + kSegment, image.width + kSilhouetteBorder);
    const std::uint8_t* const has_any = scratch.has_any + scratch.pixel(v, segment) - first;
    bool is_any_near = false;
    for (int row = v - 1; row <= v + 1; ++row) is_any_near |= scratch.has_found(row, segment);
    if (!is_any_near) {
      if (begin < end) std::memset(near + begin, 0, static_cast<std::size_t>(end - begin));
      continue;
    }
    for (int u = begin; u < end; ++u) {
      const std::uint8_t *const low = has_any + u - stride, *const at = has_any + u,
                                *const high = has_any + u + stride;
      near[u] = low[-1] | low[0] | low[1] | at[-1] | at[0] | at[1] | high[-1] | high[0] | high[1];
    }
  }
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
