// The noise of a measure from the patches that it touches (noise_grid.h), compiled once per
// instruction set.
#include <cstring>

#include "src/contact/noise/noise_sums.h"
#include "src/core/internal/simd.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {
namespace {

using Numbers = float __attribute__((vector_size(kNoiseNumbers * sizeof(float))));
using Four = float __attribute__((vector_size(4 * sizeof(float))));  // x, y, z, and one more

inline Four four(const float (&xyz)[3]) { return Four{xyz[0], xyz[1], xyz[2], 0}; }
inline Four cross(Four a, Four b) {
  return __builtin_shufflevector(a, a, 1, 2, 0, 3) * __builtin_shufflevector(b, b, 2, 0, 1, 3) -
         __builtin_shufflevector(a, a, 2, 0, 1, 3) * __builtin_shufflevector(b, b, 1, 2, 0, 3);
}
/// Joins a force, a volume behind it, and the torque that the force has at lever l.
inline Numbers numbers_of(Four force, Four l) {
  return __builtin_shufflevector(force, cross(l, force), 0, 1, 2, 3, 4, 5, 6, 7);
}

/// A camera, and its axes in W as vectors.
struct CameraAxes {
  explicit CameraAxes(const NoiseCamera& of) : camera(of) {
    const auto& R = of.R_WC;
    for (int axis = 0; axis < 3; ++axis) axes[axis] = Four{R[0][axis], R[1][axis], R[2][axis], 0};
  }
  const NoiseCamera& camera;
  Four axes[3];
};

/// Changes by a cell for each meter of depth at its place, and for each meter per pixel.
struct NoiseChange {
  Numbers by_depth, by_u, by_v;
};
inline NoiseChange noise_change(const NoisePatch& cell, const CameraAxes& from) {
  const NoiseCamera& camera = from.camera;
  const float share = 1 / cell.weight, z = cell.depth * share;
  const float u = cell.u * share, v = cell.v * share;
  const Four n = share * four(cell.n);
  const Four l = (u * z / camera.fx - camera.p_WC[0]) * from.axes[0] +
                 (v * z / camera.fy - camera.p_WC[1]) * from.axes[1] +
                 (z - camera.p_WC[2]) * from.axes[2];
  NoiseChange change;
  change.by_depth = numbers_of(cell.disc * (n + Four{0, 0, 0, 1}), l);
  // The pixel of a place moves by (fx, 0, -x) / z and (0, fy, -y) / z along the camera's axes. The
  // gradient turns by that, less what is along n, as it has a length of 1.
  const auto turned = [&](Four j) {
    const Four along = j * n;
    return numbers_of(cell.moved * (j - (along[0] + along[1] + along[2]) * n), l);
  };
  change.by_u = turned(camera.fx * from.axes[0] - u * from.axes[2]);
  change.by_v = turned(camera.fy * from.axes[1] - v * from.axes[2]);
  return change;
}

/// Sums of patches by the node that is nearest.
struct PatchCells {
  using Sums = float __attribute__((vector_size(sizeof(NoisePatch))));
  NoisePatch cells[kNoiseNodes][kNoiseNodes];

  void clear(const CellWindow& window) {
    for (int v = 0; v <= window.bottom - window.top; ++v) {
      std::memset(cells[v], 0,
                  static_cast<std::size_t>(window.right - window.left + 1) * sizeof(NoisePatch));
    }
  }
  void add(const NoisePatch& patch, const NoiseCamera& camera, const CellWindow& window,
           float scale) {
    const auto place = [&](float pixel, int begin) {
      return static_cast<int>((pixel + 0.5f) * scale - static_cast<float>(begin));
    };
    NoisePatch& cell = cells[place(patch.at_v + camera.cy, window.top)]
                            [place(patch.at_u + camera.cx, window.left)];
    Sums sum, more;
    std::memcpy(&sum, &cell, sizeof sum);
    std::memcpy(&more, &patch, sizeof more);
    sum += more;
    std::memcpy(&cell, &sum, sizeof sum);
  }
};

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

  void add(const NoisePatch& cell, const CameraAxes& from, float scale) {
    const auto [by_depth, by_u, by_v] = noise_change(cell, from);
    const float share = 1 / cell.weight;
    const NodeWeights u =
        node_weights(cell.u * share + from.camera.cx, window.left, window.right, scale);
    const NodeWeights v =
        node_weights(cell.v * share + from.camera.cy, window.top, window.bottom, scale);
    for (int q = 0; q < 3; ++q) {
      const Numbers plain = by_depth * v.value[q] + by_v * v.slope[q], sloped = by_u * v.value[q];
      Numbers* const row = &nodes[v.first + q][u.first];
      for (int p = 0; p < 3; ++p) row[p] += plain * u.value[p] + sloped * u.slope[p];
    }
  }

  /// Adds the sums of squares over all nodes, and those of products of neighboring axes.
  void add_squares(float variance, MeasureNoise& to) const {
    Numbers squares{}, products{};
    for (int v = 0; v <= window.bottom - window.top; ++v) {
      for (int u = 0; u <= window.right - window.left; ++u) {
        const Numbers node = nodes[v][u];
        squares += node * node;
        products += node * __builtin_shufflevector(node, node, 1, 2, 0, 3, 5, 6, 4, 7);
      }
    }
    add_variances(reinterpret_cast<const float*>(&squares),
                  reinterpret_cast<const float*>(&products), variance, to);
  }

  /// Becomes the grid of the next wider level.
  void widen_from(const NodeGrid& finer) {
    const CellWindow& from = finer.window;
    const auto halved = [](int cell) { return cell >> 1; };
    clear({from.level + 1, halved(from.left - 1), halved(from.top - 1), halved(from.right + 1),
           halved(from.bottom + 1)});
    constexpr float weight[4] = {0.25f, 0.75f, 0.75f, 0.25f};
    for (int v = from.top; v <= from.bottom; ++v) {
      for (int u = from.left; u <= from.right; ++u) {
        const Numbers node = finer.nodes[v - from.top][u - from.left];
        // A cell belongs to its own wider one and to the one on its other side.
        for (int q = 0; q < 2; ++q) {
          const int row = ((v - 1) >> 1) + q, child_v = v - 2 * row + 1;
          for (int p = 0; p < 2; ++p) {
            const int column = ((u - 1) >> 1) + p, child_u = u - 2 * column + 1;
            nodes[row - window.top][column - window.left] +=
                (weight[child_v] * weight[child_u]) * node;
          }
        }
      }
    }
  }
};

/// Calls f(patch) for the patches of a camera.
template <class F>
void for_patches(const NoisePatches& patches, int camera, const F& f) {
  for (int group = 0; group < patches.num_groups; ++group) {
    const NoisePatch* const first = patches.of_group(group);
    for (int i = 0; i < patches.num[group]; ++i) {
      if (first[i].camera == static_cast<float>(camera)) f(first[i]);
    }
  }
}

}  // namespace

void add_measure_noise(const NoisePatches& patches, int camera, const NoiseCamera& view,
                       const DepthFieldView& field, MeasureNoise& to) {
  NoiseReach reach;
  for_patches(patches, camera, [&](const NoisePatch& patch) { reach.add(patch); });
  if (!(reach.weight > 0) || field.noise == nullptr) return;
  NodeGrid grids[2];
  int now = 0;
  grids[now].clear(noise_window(reach, view));
  const CellWindow& window = grids[now].window;
  const float scale = 1 / static_cast<float>(1 << window.level);
  PatchCells sums;
  sums.clear(window);
  for_patches(patches, camera,
              [&](const NoisePatch& patch) { sums.add(patch, view, window, scale); });
  const CameraAxes axes(view);
  for (int v = 1; v < window.bottom - window.top; ++v) {
    for (int u = 1; u < window.right - window.left; ++u) {
      if (sums.cells[v][u].weight > 0) grids[now].add(sums.cells[v][u], axes, scale);
    }
  }
  NoiseScales scales = noise_scales(*field.noise, reach.depth / reach.weight);
  place_scales(field, grids[now].window, scales);
  const int first = grids[now].window.level;
  if (first >= kNumNoiseLevels - 1) {
    grids[now].add_squares(scales.variance[kNumNoiseLevels - 1] *
                               static_cast<float>(1.0 / (1 << 2 * (first - kNumNoiseLevels + 1))),
                           to);
    return;
  }
  for (int level = first; level < kNumNoiseLevels; ++level) {
    if (level > first) {
      grids[1 - now].widen_from(grids[now]);
      now = 1 - now;
    }
    if (scales.variance[level] > 0) grids[now].add_squares(scales.variance[level], to);
  }
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
