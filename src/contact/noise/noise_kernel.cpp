// The noise of a measure from the elements that touch (noise_grid.h), compiled once per instruction
// set.
#include <cmath>
#include <cstring>

#include "src/contact/noise/noise_sums.h"
#include "src/core/internal/simd.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {
namespace {

using Numbers = float __attribute__((vector_size(kNoiseNumbers * sizeof(float))));

inline Numbers numbers_of(const float (&from)[kNoiseNumbers]) {
  Numbers numbers;
  std::memcpy(&numbers, from, sizeof numbers);
  return numbers;
}

/// Nodes in rows of kNoiseNodes.
struct NodeGrid {
  Numbers nodes[kNoiseNodes][kNoiseNodes];
  CellWindow window;

  void clear(const CellWindow& to) {
    window = to;
    for (int v = 0; v <= window.bottom - window.top; ++v) {
      std::memset(nodes[v], 0,
                  static_cast<std::size_t>(window.right - window.left + 1) * sizeof(Numbers));
    }
  }

  void add(const NoiseRows& rows, std::ptrdiff_t element, const NoiseCamera& camera, float scale) {
    const NoiseChange change = noise_change(rows, element, camera);
    const Numbers by_depth = numbers_of(change.by_depth), by_u = numbers_of(change.by_u),
                  by_v = numbers_of(change.by_v);
    const NodeWeights u = node_weights(rows.at(NoiseRow::u, element), window.left, scale);
    const NodeWeights v = node_weights(rows.at(NoiseRow::v, element), window.top, scale);
    for (int q = 0; q < 3; ++q) {
      const Numbers plain = by_depth * v.value[q] + by_v * v.slope[q], sloped = by_u * v.value[q];
      Numbers* const row = &nodes[v.first + q][u.first];
      for (int p = 0; p < 3; ++p) row[p] += plain * u.value[p] + sloped * u.slope[p];
    }
  }

  /// Adds the sums of squares over all nodes, and those of products of neighboring axes.
  void add_squares(float variance, MeasureNoise& to) const {
    using Places = std::int32_t __attribute__((vector_size(kNoiseNumbers * sizeof(float))));
    constexpr Places turned = {0, 2, 3, 1, 5, 6, 4, 7};
    Numbers squares{}, products{};
    for (int v = 0; v <= window.bottom - window.top; ++v) {
      for (int u = 0; u <= window.right - window.left; ++u) {
        const Numbers node = nodes[v][u];
        squares += node * node;
#if defined(__clang__)
        products += node * __builtin_shufflevector(node, node, 0, 2, 3, 1, 5, 6, 4, 7);
#else
        products += node * __builtin_shuffle(node, turned);
#endif
      }
    }
    add_variances(reinterpret_cast<const float*>(&squares),
                  reinterpret_cast<const float*>(&products), variance, to);
    (void)turned;
  }

  /// Becomes the grid of the next wider level.
  void widen_from(const NodeGrid& finer) {
    const CellWindow& from = finer.window;
    clear(wider_nodes(from));
    for (int v = window.top; v <= window.bottom; ++v) {
      for (int u = window.left; u <= window.right; ++u) {
        Numbers& node = nodes[v - window.top][u - window.left];
        for_finer_nodes(from, u, v, [&](float weight, int p, int q) {
          node += weight * finer.nodes[q - from.top][p - from.left];
        });
      }
    }
  }
};

/// Calls f(element) for the elements of a camera that change something.
template <class F>
void for_elements(const NoiseSums& sums, int camera, const F& f) {
  for (int group = 0; group < sums.num_groups; ++group) {
    const std::ptrdiff_t first = first_noise_row(group);
    for (std::ptrdiff_t i = first; i < first + sums.rows.num[group]; ++i) {
      if (sums.rows.change(0, i) == 0 && sums.rows.at(NoiseRow::volume, i) == 0) continue;
      if (sums.rows.at(NoiseRow::camera, i) == static_cast<float>(camera)) f(i);
    }
  }
}

}  // namespace

void add_measure_noise(const NoiseSums& sums, int camera, const NoiseCamera& view,
                       const DepthFieldView& field, MeasureNoise& to) {
  NoiseReach reach;
  for_elements(sums, camera, [&](std::ptrdiff_t i) { reach.add(sums.rows, i); });
  if (reach.weight == 0 || field.noise == nullptr) return;
  if (!is_number(reach.weight + reach.level + reach.depth)) {
    constexpr float none[kNoiseNumbers] = {};
    return add_variances(none, none, NAN, to);
  }
  NodeGrid grids[2];
  int now = 0;
  grids[now].clear(noise_window(reach));
  const float scale = 1 / static_cast<float>(1 << grids[now].window.level);
  for_elements(sums, camera, [&](std::ptrdiff_t i) { grids[now].add(sums.rows, i, view, scale); });
  NoiseScales scales = noise_scales(*field.noise, reach.depth / reach.weight);
  const FieldGrid grid = grid_of(field);
  const FieldPixels pixels = pixels_of(field);
  const auto left_of = [&](const CellWindow& window, float variance) {
    return noise_left(grid, pixels, window, variance);
  };
  place_scales(grids[now].window, left_of, scales);
  const int first = grids[now].window.level;
  for (int level = first; level < first + num_noise_grids(first); ++level) {
    if (level > first) {
      grids[1 - now].widen_from(grids[now]);
      now = 1 - now;
    }
    const float variance = node_variance(scales, level);
    if (variance != 0) grids[now].add_squares(variance, to);
  }
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
