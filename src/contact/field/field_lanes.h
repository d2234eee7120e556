// Queries of a depth field by elements of a tool, as many at once as a vector has lanes: the steps
// of src/field/internal/field_sample.h and field_curvature.h. Included by kernel files only.
#pragma once

#include <type_traits>

#include "src/contact/field/field_contact.h"
#include "src/core/internal/simd.h"
#include "src/core/internal/simd_rows.h"
#include "src/field/internal/field_curvature.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

inline constexpr int kSize = SphereClusters::kSize;

// Camera and level sizes that all fields of a query share.
struct Grid {
  explicit Grid(const DepthFieldView& view)
      : fx(static_cast<float>(view.intrinsics.fx)),
        fy(static_cast<float>(view.intrinsics.fy)),
        cx(static_cast<float>(view.intrinsics.cx)),
        cy(static_cast<float>(view.intrinsics.cy)),
        width(static_cast<float>(view.levels[0].width)),
        height(static_cast<float>(view.levels[0].height)),
        thickness(view.thickness),
        stride(view.levels[0].stride),
        last_level(view.num_levels - 1) {
    for (int k = 0; k < view.num_levels; ++k) {
      start.entries[k] = static_cast<std::int32_t>(view.levels[k].near_silhouette -
                                                   view.levels[0].near_silhouette);
    }
  }

  float fx, fy, cx, cy, width, height, thickness;
  std::int32_t stride, last_level;
  LaneTable<std::int32_t> start;  // pixel (0, 0) of each level
};

// The pixels of one field, from level 0 on; the other levels follow.
struct Pixels {
  const float* planes;
  const Silhouette* silhouettes;
  const std::uint8_t* near_silhouette;
};
inline Pixels pixels_of(const DepthFieldView& view) {
  return {view.levels[0].planes, view.levels[0].silhouettes, view.levels[0].near_silhouette};
}

// Positions of elements on one level.
struct Spot {
  VecI pixel;
  VecF s, t;  // from the middle of the pixel
};

// 2^-level
[[gnu::always_inline]] inline VecF scale_of(VecI level) {
  return reinterpret_cast<VecF>((127 - level) << 23);
}

[[gnu::always_inline]] inline Spot spot_at(const Grid& grid, VecF u, VecF v, VecI level) {
  const VecF scale = scale_of(level);
  const auto place = [&](VecF pixels, float size, VecF& offset) {
    VecF p = (pixels + 0.5f) * scale - 0.5f;
    p = min(max(p, splat(DepthFieldLevel::kFirst)), size * scale - DepthFieldLevel::kFirst);
    static_assert(DepthFieldLevel::kFirst > -16);
    const VecI pixel = to_int(p + 16.5f) - 16;  // rounded down
    offset = p - to_float(pixel);
    return pixel;
  };
  Spot spot;
  const VecI column = place(u, grid.width, spot.s), row = place(v, grid.height, spot.t);
  spot.pixel = look_up(grid.start, level) + row * grid.stride + column;
  return spot;
}

// Level that elements sample, and the blend with the next wider one: a footprint m 2^e with m in
// [1, 2) lies between levels e and e + 1.
struct LevelBlend {
  VecI level, is_single;
  VecF x, x_by_z;  // of smooth_step
  Sloped<VecF> step;

  VecI wider(const Grid& grid) const {
    const VecI last = splat(grid.last_level);
    return level < last ? level + 1 : last;
  }
  VecF blend() const { return select(is_single, VecF{}, step.value); }
  VecF blend_by_z() const { return select(is_single, VecF{}, step.slope * x_by_z); }
  VecF blend_by_zz(VecF inverse_depth) const {
    const VecI is_between = (x > VecF{}) & (x < splat(1.0f));
    const VecF bend = select(is_between, 6.0f - 12.0f * x, VecF{});
    return select(is_single, VecF{}, x_by_z * (bend * x_by_z - 2.0f * step.slope * inverse_depth));
  }
};
[[gnu::always_inline]] inline LevelBlend choose_levels(const Grid& grid, VecF radius,
                                                       VecF inverse_depth) {
  const VecI last = splat(grid.last_level);
  const VecF footprint = max(kFootprint * radius * grid.fx * inverse_depth, splat(1.0f));
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

// Returns the value of a pixel at `depth`, limited by its silhouettes.
[[gnu::always_inline]] inline Curved<VecF> silhouette_value(const Grid& grid, const Pixels& pixels,
                                                            VecI pixel, const Curved<VecF>& own,
                                                            VecF depth, VecF k_by) {
  VecF numbers[4];  // of a Silhouette
  gather_fours(&pixels.silhouettes->side, 2 * pixel + (own.value < VecF{} ? VecI{} : VecI{} + 1),
               numbers);
  const VecF& side = numbers[0];
  if (mask_bits(side != VecF{}) == 0) return own;  // as clamped_at_silhouette would
  Curved<VecF> plane = plane_value(numbers[1], numbers[2], depth);
  if (grid.thickness < static_cast<float>(kSolidBehind)) {
    plane = with_back(plane, splat(grid.thickness));
  }
  return clamped_at_silhouette(own, plane, side, depth, k_by);
}

// True if one of the nine pixels around an element is near a silhouette.
[[gnu::always_inline]] inline bool is_near_silhouette(const Pixels& pixels, VecI pixel) {
  return any_byte(pixels.near_silhouette, pixel) &&
         mask_bits(gather_bytes(pixels.near_silhouette, pixel) != 0) != 0;
}

// Computes the values of the nine pixels around, row by row, each element on its own level.
[[gnu::always_inline]] inline void values_around(const Grid& grid, const Pixels& pixels, VecI pixel,
                                                 VecI level, VecF depth,
                                                 Curved<VecF> (&values)[3][3]) {
  const VecI is_near = gather_bytes(pixels.near_silhouette, pixel) != 0;
  const VecF k_by = kCorner / (scale_of(level) * grid.fx);
  for (int q = 0; q < 3; ++q) {
    VecF pairs[6];  // offset, slope, offset, slope, ...
    gather_three_pairs(pixels.planes + 2 * ((q - 1) * grid.stride - 1), pixel, pairs);
    for (int p = 0; p < 3; ++p) {
      Curved<VecF>& value = values[q][p];
      value = plane_value(pairs[2 * p], pairs[2 * p + 1], depth);
      if (grid.thickness < static_cast<float>(kSolidBehind)) {
        value = with_back(value, splat(grid.thickness));
      }
      // Memory of other pixels may be stale.
      const VecI at = is_near ? pixel + (q - 1) * grid.stride + (p - 1) : VecI{};
      value = chosen(is_near, silhouette_value(grid, pixels, at, value, depth, k_by), value);
    }
  }
}

// phi with its derivatives by the image, near silhouettes. `Sample` is an ImageGradient or an
// ImageCurvature.
template <class Sample>
[[gnu::noinline]] Sample sample_silhouettes(const Grid& grid, const Pixels& pixels, const Spot& at,
                                            VecI level, VecF depth) {
  Curved<VecF> values[3][3];
  values_around(grid, pixels, at.pixel, level, depth, values);
  if constexpr (std::is_same_v<Sample, ImageCurvature<VecF>>) {
    return curvature_of(values, at.s, at.t, scale_of(level));
  } else {
    return gradient_of(values, at.s, at.t, scale_of(level));
  }
}

// The values of nine pixels of which none is near a silhouette: planes.
struct Planes {
  VecF value[3][3], slope[3][3];

  /// True if with_back keeps the values of all elements.
  [[gnu::always_inline]] bool have_no_back(float thickness) const {
    if (!(thickness < static_cast<float>(kSolidBehind))) return true;
    VecF least = value[0][0];
    for (const VecF(&row)[3] : value) {
      for (const VecF& each : row) least = min(least, each);
    }
    return mask_bits(~(below_unbent(least, splat(thickness)) <= VecF{})) == 0;
  }
};
[[gnu::always_inline]] inline Planes planes_around(const Grid& grid, const Pixels& pixels,
                                                   VecI pixel, VecF depth) {
  Planes planes;
  for (int q = 0; q < 3; ++q) {
    VecF pairs[6];  // offset, slope, offset, slope, ...
    gather_three_pairs(pixels.planes + 2 * ((q - 1) * grid.stride - 1), pixel, pairs);
    for (int p = 0; p < 3; ++p) {
      planes.value[q][p] = pairs[2 * p] - depth * pairs[2 * p + 1];
      planes.slope[q][p] = -pairs[2 * p + 1];
    }
  }
  return planes;
}

// phi with its derivatives by the image, where no pixel around is near a silhouette.
template <class Sample>
[[gnu::always_inline]] inline Sample sample_planes(const Planes& planes, const Spot& at,
                                                   VecI level) {
  Curved<VecF> phi[3], by_z[3];
  for (int q = 0; q < 3; ++q) {
    const VecF(&value)[3] = planes.value[q], (&slope)[3] = planes.slope[q];
    phi[q] = spline(value[0], value[1], value[2], at.s);
    by_z[q] = spline(slope[0], slope[1], slope[2], at.s);
  }
  const VecF scale = scale_of(level);
  const Curved<VecF> value = spline(phi[0].value, phi[1].value, phi[2].value, at.t);
  const Curved<VecF> by_u = spline(phi[0].slope, phi[1].slope, phi[2].slope, at.t);
  const Curved<VecF> z_value = spline(by_z[0].value, by_z[1].value, by_z[2].value, at.t);
  const ImageGradient<VecF> first{value.value, by_u.value * scale, value.slope * scale,
                                  z_value.value};
  if constexpr (std::is_same_v<Sample, ImageCurvature<VecF>>) {
    const VecF squared = scale * scale;
    return {first,
            spline(phi[0].bend, phi[1].bend, phi[2].bend, at.t).value * squared,
            by_u.slope * squared,
            value.bend * squared,
            spline(by_z[0].slope, by_z[1].slope, by_z[2].slope, at.t).value * scale,
            z_value.slope * scale,
            VecF{}};
  } else {
    return first;
  }
}

template <class Sample>
[[gnu::always_inline]] inline Sample sample(const Grid& grid, const Pixels& pixels, const Spot& at,
                                            VecI level, VecF depth) {
  if (!is_near_silhouette(pixels, at.pixel)) {
    const Planes planes = planes_around(grid, pixels, at.pixel, depth);
    if (planes.have_no_back(grid.thickness)) return sample_planes<Sample>(planes, at, level);
  }
  return sample_silhouettes<Sample>(grid, pixels, at, level, depth);
}

// `blend` of the next wider level.
[[gnu::always_inline]] inline ImageGradient<VecF> with_wider(const ImageGradient<VecF>& g,
                                                             const ImageGradient<VecF>& next,
                                                             const LevelBlend& choice, VecF) {
  return mixed(g, next, choice.blend(), choice.blend_by_z());
}
[[gnu::always_inline]] inline ImageCurvature<VecF> with_wider(const ImageCurvature<VecF>& c,
                                                              const ImageCurvature<VecF>& next,
                                                              const LevelBlend& choice,
                                                              VecF inverse_depth) {
  return blended(c, next, choice.blend(), choice.blend_by_z(), choice.blend_by_zz(inverse_depth));
}

// Pixels of elements of some radius on the one or two levels of their size.
struct Look {
  LevelBlend levels;
  VecI wider_level;
  Spot own, wider;
  bool has_wider;
};
[[gnu::always_inline]] inline Look look_at(const Grid& grid, VecF u, VecF v, VecF inverse_depth,
                                           VecF radius) {
  Look look;
  look.levels = choose_levels(grid, radius, inverse_depth);
  look.own = spot_at(grid, u, v, look.levels.level);
  look.has_wider = mask_bits(look.levels.blend() > VecF{}) != 0;
  look.wider_level = look.levels.wider(grid);
  if (look.has_wider) look.wider = spot_at(grid, u, v, look.wider_level);
  return look;
}

// Samples the pixels of `look`.
template <class Sample>
[[gnu::always_inline]] inline Sample query_field(const Grid& grid, const Pixels& pixels,
                                                 const Look& look, VecF depth, VecF inverse_depth) {
  const Sample own = sample<Sample>(grid, pixels, look.own, look.levels.level, depth);
  if (!look.has_wider) return own;
  const Sample next = sample<Sample>(grid, pixels, look.wider, look.wider_level, depth);
  return with_wider(own, next, look.levels, inverse_depth);
}

// Bits of the fields near a ball: the tiles that its elements can sample are not all well behind
// it. In the others every plane is at least the largest radius away from every element.
template <int kFields>
std::uint32_t fields_near(const MeasureJob& job, const Cluster& ball, float largest_radius) {
  constexpr std::uint32_t kAll = (1u << kFields) - 1;
  const int tiles_wide = job.fields[0].tiles_wide, tiles_high = job.fields[0].tiles_high;
  const BallWindow window = window_of(job.frame, ball, largest_radius, tiles_wide, tiles_high);
  if (!window.is_before_camera()) return window.farthest < kMinDepth ? 0 : kAll;
  std::uint32_t near = 0;
  for (int v = window.top; v <= window.bottom && near != kAll; ++v) {
    for (int u = window.left; u <= window.right; ++u) {
      for (int k = 0; k < kFields; ++k) {
        const DepthTile& tile = job.fields[k].tiles[v * tiles_wide + u];
        if (!is_behind(tile, window.farthest, largest_radius)) near |= 1u << k;
      }
    }
  }
  return near;
}

/// Finds the fields near each cluster of a group, as bits. Returns false if none is, by the group.
template <int kFields>
[[gnu::always_inline]] inline bool find_near(
    const MeasureJob& job, int group, std::uint32_t (&near)[SphereClusters::kClustersPerGroup]) {
  const SphereClusters& clusters = *job.clusters;
  const int first = group * SphereClusters::kClustersPerGroup;
  const int last = std::min(first + SphereClusters::kClustersPerGroup, clusters.num_clusters());
  const float* const largest = job.largest_radius;
  if (fields_near<kFields>(job, clusters.groups[static_cast<std::size_t>(group)],
                           *std::max_element(largest + first, largest + last)) == 0) {
    return false;
  }
  std::uint32_t any = 0;
  std::fill(std::begin(near), std::end(near), 0);
  for (int cluster = first; cluster < last; ++cluster) {
    near[cluster - first] = fields_near<kFields>(
        job, clusters.clusters[static_cast<std::size_t>(cluster)], largest[cluster]);
    any |= near[cluster - first];
  }
  return any != 0;
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
