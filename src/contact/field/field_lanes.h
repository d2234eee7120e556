// What the vector kernels of the field method share: where elements are seen, and which of them
// need not ask. Included by kernel files only.
#pragma once

#include "palpate/field/field_sample.h"
#include "src/contact/field/field_contact.h"
#include "src/core/simd.h"

namespace palpate::PALPATE_ISA_NAMESPACE {
namespace {

constexpr int kSize = SphereClusters::kSize;

// What a query knows of the field.
struct Field {
  explicit Field(const DepthFieldView& view)
      : fx(static_cast<float>(view.intrinsics.fx)),
        fy(static_cast<float>(view.intrinsics.fy)),
        cx(static_cast<float>(view.intrinsics.cx)),
        cy(static_cast<float>(view.intrinsics.cy)),
        width(static_cast<float>(view.levels[0].width)),
        height(static_cast<float>(view.levels[0].height)),
        thickness(view.thickness),
        stride(view.levels[0].stride),
        last_level(view.num_levels - 1),
        planes(view.levels[0].planes),
        silhouettes(view.levels[0].silhouettes),
        near_silhouette(view.levels[0].near_silhouette) {
    for (int k = 0; k < view.num_levels; ++k) {
      start.entries[k] =
          static_cast<std::int32_t>(view.levels[k].near_silhouette - near_silhouette);
    }
  }

  float fx, fy, cx, cy, width, height, thickness;
  std::int32_t stride, last_level;
  const float* planes;  // of level 0; the other levels follow
  const Silhouette* silhouettes;
  const std::uint8_t* near_silhouette;
  LaneTable<std::int32_t> start;  // pixel (0, 0) of each level
};

// Where on one level elements are seen.
struct Spot {
  VecI pixel;
  VecF s, t;  // from the middle of the pixel
};

// 2^-level
[[gnu::always_inline]] inline VecF scale_of(VecI level) {
  return reinterpret_cast<VecF>((127 - level) << 23);
}

[[gnu::always_inline]] inline Spot spot_at(const Field& field, VecF u, VecF v, VecI level) {
  const VecF scale = scale_of(level);
  const auto place = [&](VecF pixels, float size, VecF& offset) {
    VecF p = (pixels + 0.5f) * scale - 0.5f;
    p = min(max(p, splat(DepthFieldLevel::kFirst)), size * scale + 5.0f);
    const VecI pixel = to_int(p + 8.5f) - 8;  // rounded down: p > -8
    offset = p - to_float(pixel);
    return pixel;
  };
  Spot spot;
  const VecI column = place(u, field.width, spot.s), row = place(v, field.height, spot.t);
  spot.pixel = look_up(field.start, level) + row * field.stride + column;
  return spot;
}

// Which level elements ask, and how much of the next wider one is blended in: a footprint m 2^e
// with m in [1, 2) lies between levels e and e + 1.
struct LevelBlend {
  VecI level, is_single;
  VecF x, x_by_z;  // of smooth_step
  Sloped<VecF> step;
};
[[gnu::always_inline]] inline LevelBlend choose_levels(const Field& field, VecF radius,
                                                       VecF inverse_depth) {
  const VecI last = splat(field.last_level);
  const VecF footprint = max(kFootprint * radius * field.fx * inverse_depth, splat(1.0f));
  const VecI bits = reinterpret_cast<VecI>(footprint);
  const VecI exponent = (bits >> 23) - 127;
  const VecF m = reinterpret_cast<VecF>((bits & 0x7fffff) | 0x3f800000);
  LevelBlend choice;
  choice.x = (m - 1.0f) * (1.0f / (kBlendEnd - 1));
  choice.x_by_z = m * inverse_depth * (-1.0f / (kBlendEnd - 1));
  choice.step = smooth_step(choice.x);
  const VecI is_next = (choice.step.value >= splat(1.0f)) & (exponent < last);
  choice.is_single = is_next | (exponent >= last);
  choice.level = exponent < last ? exponent - is_next : last;
  return choice;
}

// The value of a pixel at `depth` as its silhouettes have it.
[[gnu::always_inline]] inline Curved<VecF> silhouette_value(const Field& field, VecI pixel,
                                                            const Curved<VecF>& own, VecF depth,
                                                            VecF k_by) {
  const float* const table = &field.silhouettes->side;
  const VecI at = 8 * pixel + (own.value < VecF{} ? VecI{} : VecI{} + 4);
  const VecF side = gather(table, at);
  Curved<VecF> plane = plane_value(gather(table + 1, at), gather(table + 2, at), depth);
  if (field.thickness < static_cast<float>(kSolidBehind)) {
    plane = with_back(plane, splat(field.thickness));
  }
  return clamped_at_silhouette(own, plane, side, depth, k_by);
}

// Have the pixels around elements any value beside that of their own plane?
[[gnu::always_inline]] inline bool are_plain(const Field& field, VecI pixel) {
  return field.thickness >= static_cast<float>(kSolidBehind) &&
         !any_byte(field.near_silhouette, pixel);
}

// The values of the nine pixels around, row by row, each element on a level of its own.
[[gnu::always_inline]] inline void values_around(const Field& field, VecI pixel, VecI level,
                                                 VecF depth, Curved<VecF> (&values)[3][3]) {
  const VecI is_near = gather_bytes(field.near_silhouette, pixel) != 0;
  const VecF k_by = kCorner / (scale_of(level) * field.fx);
  for (int q = 0; q < 3; ++q) {
    VecF pairs[6];  // offset, slope, offset, slope, ...
    gather_three_pairs(field.planes + 2 * ((q - 1) * field.stride - 1), pixel, pairs);
    for (int p = 0; p < 3; ++p) {
      Curved<VecF>& value = values[q][p];
      value = plane_value(pairs[2 * p], pairs[2 * p + 1], depth);
      if (field.thickness < static_cast<float>(kSolidBehind)) {
        value = with_back(value, splat(field.thickness));
      }
      // Elsewhere what is written there may be old.
      const VecI at = is_near ? pixel + (q - 1) * field.stride + (p - 1) : VecI{};
      value = chosen(is_near, silhouette_value(field, at, value, depth, k_by), value);
    }
  }
}

// The elements of a cluster between the steps of measuring them. Each step is a short loop: then
// the processor has several vectors in flight, where one long loop would wait for each vector's
// chain.
struct Elements {
  alignas(64) float lx[kSize], ly[kSize], lz[kSize];  // from C, in W
  alignas(64) float from_u[kSize], from_v[kSize], depth[kSize], inverse_depth[kSize];
  alignas(64) std::int32_t level[kSize], pixel[kSize];
  alignas(64) float s[kSize], t[kSize];
  alignas(64) float blend[kSize], blend_by_z[kSize];  // with the next wider level
  alignas(64) float phi[kSize], by_u[kSize], by_v[kSize], by_z[kSize];
};

// Step 1: where the elements are seen, and on which level.
[[gnu::always_inline]] inline void aim(const MeasureJob& job, const Field& field, std::size_t begin,
                                       Elements& to) {
  const SphereClusters& c = *job.clusters;
  for (int i = 0; i < kSize; i += kLanes) {
    const std::size_t place = begin + static_cast<std::size_t>(i);
    const VecF x_T = load(&c.x[place]), y_T = load(&c.y[place]), z_T = load(&c.z[place]);
    const auto rotated = [&](const float(&row)[3]) {
      return row[0] * x_T + row[1] * y_T + row[2] * z_T;
    };
    const VecF lx = rotated(job.frame.R_WT[0]), ly = rotated(job.frame.R_WT[1]),
               lz = rotated(job.frame.R_WT[2]);
    const VecF depth = max(lz + job.frame.p_WC[2], splat(kLeastDepth)),
               inverse_depth = 1.0f / depth;
    const VecF from_u = field.fx * (lx + job.frame.p_WC[0]) * inverse_depth;
    const VecF from_v = field.fy * (ly + job.frame.p_WC[1]) * inverse_depth;

    const VecF radius = load(job.radius + place);
    const LevelBlend choice = choose_levels(field, radius, inverse_depth);
    const Spot spot = spot_at(field, from_u + field.cx, from_v + field.cy, choice.level);

    store(to.lx + i, lx);
    store(to.ly + i, ly);
    store(to.lz + i, lz);
    store(to.from_u + i, from_u);
    store(to.from_v + i, from_v);
    store(to.depth + i, depth);
    store(to.inverse_depth + i, inverse_depth);
    store(to.level + i, choice.level);
    store(to.pixel + i, spot.pixel);
    store(to.s + i, spot.s);
    store(to.t + i, spot.t);
    store(to.blend + i, select(choice.is_single, VecF{}, choice.step.value));
    store(to.blend_by_z + i, select(choice.is_single, VecF{}, choice.step.slope * choice.x_by_z));
  }
}

// True if the tiles that spheres in a ball can ask about are all well behind it: every plane is at
// least the largest radius away from every sphere.
bool is_in_front(const MeasureJob& job, const Cluster& ball, float largest_radius) {
  const DepthFieldView& field = job.field;
  const BallWindow window =
      window_of(job.frame, ball, largest_radius, field.tiles_wide, field.tiles_high);
  if (!window.is_before_camera()) return window.farthest < kLeastDepth;
  for (int v = window.top; v <= window.bottom; ++v) {
    for (int u = window.left; u <= window.right; ++u) {
      const DepthTile& tile = field.tiles[v * field.tiles_wide + u];
      if (!is_behind(tile, window.farthest, largest_radius)) return false;
    }
  }
  return true;
}

/// Calls f(field, first place, elements) for the clusters of a group that are not well in front of
/// everything, each after step 1.
template <class F>
[[gnu::always_inline]] inline void for_near_clusters(const MeasureJob& job, int group, const F& f) {
  if (job.field.num_levels == 0) return;
  const SphereClusters& clusters = *job.clusters;
  const int first = group * SphereClusters::kClustersPerGroup;
  const int last = std::min(first + SphereClusters::kClustersPerGroup, clusters.num_clusters());
  const float largest_radius =
      *std::max_element(job.largest_radius + first, job.largest_radius + last);
  if (is_in_front(job, clusters.groups[static_cast<std::size_t>(group)], largest_radius)) return;
  const Field field(job.field);
  Elements elements;
  for (int cluster = first; cluster < last; ++cluster) {
    const Cluster& ball = clusters.clusters[static_cast<std::size_t>(cluster)];
    if (is_in_front(job, ball, job.largest_radius[cluster])) continue;
    const auto begin = static_cast<std::size_t>(cluster) * kSize;
    aim(job, field, begin, elements);
    f(field, begin, elements);
  }
}

}  // namespace
}  // namespace palpate::PALPATE_ISA_NAMESPACE
