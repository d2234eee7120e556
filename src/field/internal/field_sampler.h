// The steps of a query of a depth field (formulas: field_sample.h): an element samples the pixels
// of the one or two levels of its size, and wider ones where it lies deep. One text for all that
// ask: a `Lane` has the numbers of one element (OneLane: a thread of a GPU, or double precision),
// or of as many beside each other as a vector has (src/contact/field/field_lanes.h), and the
// operations in which these differ. So a processor and a GPU compute the same; the order of work is
// their own.
#pragma once

#include <cstring>
#include <type_traits>

#include "src/field/internal/field_curvature.h"

namespace palpate { inline namespace v0 {

/// Camera and level sizes, which fields of one camera share.
struct FieldGrid {
  float fx = 0, fy = 0, cx = 0, cy = 0;
  float width = 0, height = 0, thickness = 0;
  std::int32_t stride = 0, last_level = -1;             ///< -1: no field
  std::int32_t start[DepthFieldView::kMaxLevels] = {};  ///< pixel (0, 0) of each level
};
PALPATE_FORMULA FieldGrid grid_of(const DepthFieldView& view) {
  FieldGrid grid;
  grid.fx = static_cast<float>(view.intrinsics.fx);
  grid.fy = static_cast<float>(view.intrinsics.fy);
  grid.cx = static_cast<float>(view.intrinsics.cx);
  grid.cy = static_cast<float>(view.intrinsics.cy);
  grid.width = static_cast<float>(view.levels[0].width);
  grid.height = static_cast<float>(view.levels[0].height);
  grid.thickness = view.thickness;
  grid.stride = view.levels[0].stride;
  grid.last_level = view.num_levels - 1;
  for (int k = 0; k < view.num_levels; ++k) {
    grid.start[k] =
        static_cast<std::int32_t>(view.levels[k].near_silhouette - view.levels[0].near_silhouette);
  }
  return grid;
}

/// The pixels of one field, from level 0 on; the other levels follow.
struct FieldPixels {
  const float* planes = nullptr;
  const Silhouette* silhouettes = nullptr;
  const std::uint8_t* near_silhouette = nullptr;
};
PALPATE_FORMULA FieldPixels pixels_of(const DepthFieldView& view) {
  return {view.levels[0].planes, view.levels[0].silhouettes, view.levels[0].near_silhouette};
}

/// One element by itself.
template <class Number>
struct OneLane {
  using Real = Number;
  using Int = std::int32_t;
  using Mask = bool;
  using Grid = FieldGrid;
  static constexpr bool kHasMany = false;

  PALPATE_FORMULA static bool is_any(bool mask) { return mask; }
  /// Rounds towards zero.
  PALPATE_FORMULA static Int whole(Real number) { return static_cast<Int>(number); }
  PALPATE_FORMULA static Real real(Int number) { return static_cast<Real>(number); }
  /// Returns the largest e with 2^e <= number, for numbers from 1 on.
  PALPATE_FORMULA static Int exponent(Real number) {
    const float rounded = static_cast<float>(number);
    Int bits;
    std::memcpy(&bits, &rounded, sizeof bits);
    return (bits >> 23) - 127;
  }
  PALPATE_FORMULA static Real inverse_power(Int exponent) {  // 2^-exponent
    const Int bits = (127 - exponent) << 23;
    float number;
    std::memcpy(&number, &bits, sizeof number);
    return static_cast<Real>(number);
  }
  PALPATE_FORMULA static Int start(const Grid& grid, Int level) { return grid.start[level]; }
  PALPATE_FORMULA static bool is_near_silhouette(const FieldPixels& pixels, Int pixel) {
    return pixels.near_silhouette[pixel] != 0;
  }
  /// Reads the planes of three pixels from `pixel` on: offset, slope, offset, ...
  PALPATE_FORMULA static void read_planes(const float* planes, Int pixel, Real (&pairs)[6]) {
    const auto* const from = reinterpret_cast<const PlanePair*>(planes) + pixel;
    for (int p = 0; p < 3; ++p) {
      const PlanePair pair = from[p];
      pairs[2 * p] = static_cast<Real>(pair.offset);
      pairs[2 * p + 1] = static_cast<Real>(pair.slope);
    }
  }
  /// Reads side, offset and slope.
  PALPATE_FORMULA static void read_silhouette(const Silhouette* from, Int number,
                                              Real (&numbers)[4]) {
    const Silhouette at = from[number];
    numbers[0] = static_cast<Real>(at.side);
    numbers[1] = static_cast<Real>(at.offset);
    numbers[2] = static_cast<Real>(at.slope);
  }

 private:
  // Two neighbors among DepthFieldLevel::planes, which a GPU loads at once.
  struct alignas(2 * sizeof(float)) PlanePair {
    float offset, slope;
  };
};

/// The nearest pixel of a level, and how far right of and below its middle.
template <class Lane>
struct PixelSpot {
  typename Lane::Int pixel;
  typename Lane::Real s, t;
};
template <class Lane, class Real, class Int>
PALPATE_FORMULA PixelSpot<Lane> spot_at(const typename Lane::Grid& grid, Real u, Real v,
                                        Int level) {
  const Real scale = Lane::inverse_power(level);
  constexpr float kFirst = DepthFieldLevel::kFirst;
  const auto place = [&](Real at, float size, Real& offset) {
    const Real first = Real{} + kFirst, last = size * scale - kFirst;
    Real p = (at + 0.5f) * scale - 0.5f;
    p = p > first ? p : first;  // NaN: the first
    p = p < last ? p : last;
    static_assert(kFirst > -16);
    const Int pixel = Lane::whole(p + 16.5f) - 16;  // rounded down
    offset = p - Lane::real(pixel);
    return pixel;
  };
  PixelSpot<Lane> spot;
  const Int column = place(u, grid.width, spot.s), row = place(v, grid.height, spot.t);
  spot.pixel = Lane::start(grid, level) + row * grid.stride + column;
  return spot;
}

/// Level that elements sample, and the blend with the next wider one: a footprint m 2^e with m in
/// [1, 2) lies between levels e and e + 1.
template <class Lane>
struct LevelChoice {
  using Real = typename Lane::Real;

  typename Lane::Int level, wider;
  typename Lane::Mask is_single;
  Real x, x_by_z;  // of smooth_step
  Sloped<Real> step;

  PALPATE_FORMULA Real blend() const { return is_single ? Real{} : step.value; }
  PALPATE_FORMULA Real blend_by_z() const { return is_single ? Real{} : step.slope * x_by_z; }
  PALPATE_FORMULA Real blend_by_zz(Real inverse_depth) const {
    const auto is_between = (x > Real{}) & (x < Real{} + 1.0f);
    const Real bend = is_between ? 6.0f - 12.0f * x : Real{};
    const Real by_zz = x_by_z * (bend * x_by_z - 2.0f * step.slope * inverse_depth);
    return is_single ? Real{} : by_zz;
  }
};
template <class Lane, class Real>
PALPATE_FORMULA LevelChoice<Lane> choose_levels(const typename Lane::Grid& grid, Real radius,
                                                Real inverse_depth) {
  using Int = typename Lane::Int;
  const Real one = Real{} + 1.0f, wide = kFootprint * radius * grid.fx * inverse_depth;
  const Real footprint = wide > one ? wide : one;
  const Int last = Int{} + grid.last_level, exponent = Lane::exponent(footprint);
  const Real m = footprint * Lane::inverse_power(exponent);
  LevelChoice<Lane> choice;
  choice.x = (m - 1.0f) * (1.0f / (kBlendEnd - 1));
  choice.x_by_z = m * inverse_depth * (-1.0f / (kBlendEnd - 1));
  choice.step = smooth_step(choice.x);
  const typename Lane::Mask is_last = exponent >= last;
  const typename Lane::Mask is_next = (choice.step.value >= one) & (exponent < last);
  choice.is_single = is_next | is_last;
  choice.level = is_last ? last : (is_next ? exponent + 1 : exponent);
  choice.wider = choice.level < last ? choice.level + 1 : last;
  return choice;
}

/// Pixels of elements of some radius on the one or two levels of their size.
template <class Lane>
struct PixelLook {
  LevelChoice<Lane> levels;
  typename Lane::Real u, v;    ///< pixels of level 0
  PixelSpot<Lane> own, wider;  ///< of many elements, the latter if has_wider
  bool has_wider;
};
template <class Lane, class Real>
PALPATE_FORMULA PixelLook<Lane> look_at(const typename Lane::Grid& grid, Real u, Real v,
                                        Real inverse_depth, Real radius) {
  PixelLook<Lane> look;
  look.u = u;
  look.v = v;
  look.levels = choose_levels<Lane>(grid, radius, inverse_depth);
  look.has_wider = Lane::is_any(look.levels.blend() > Real{});
  if constexpr (Lane::kHasMany) {
    look.own = spot_at<Lane>(grid, u, v, look.levels.level);
    if (look.has_wider) look.wider = spot_at<Lane>(grid, u, v, look.levels.wider);
  }
  return look;
}

/// Reads the values of the nine pixels around, row by row, as if no silhouette was near. Calls
/// each(row, column, value) in between.
template <class Lane, class Real, class Int, class Each>
PALPATE_FORMULA void planes_around(const typename Lane::Grid& grid, const FieldPixels& pixels,
                                   Int pixel, Real depth, Curved<Real> (&values)[3][3],
                                   const Each& each) {
  for (int q = 0; q < 3; ++q) {
    const std::int32_t first = (q - 1) * grid.stride - 1;
    Real pairs[6];
    if constexpr (Lane::kHasMany) {
      Lane::read_planes(pixels.planes + 2 * std::ptrdiff_t{first}, pixel, pairs);
    } else {
      Lane::read_planes(pixels.planes, pixel + first, pairs);
    }
    for (int p = 0; p < 3; ++p) {
      values[q][p] = plane_value(pairs[2 * p], pairs[2 * p + 1], depth);
      each(q, p, values[q][p]);
    }
  }
}

/// The number of the silhouette that limits a pixel with this value.
template <class Int, class Real>
PALPATE_FORMULA Int silhouette_of(Int pixel, Real value) {
  return 2 * pixel + (value < Real{} ? Int{} : Int{} + 1);
}

/// Limits the value of a pixel at `depth` by its silhouette, if it has one: side, offset and slope;
/// k_by: width of corners.
template <class Real>
PALPATE_FORMULA Curved<Real> limited_by(const Real (&silhouette)[4], const Curved<Real>& own,
                                        float thickness, Real depth, Real k_by) {
  Curved<Real> plane = plane_value(silhouette[1], silhouette[2], depth);
  if (thickness < static_cast<float>(kSolidBehind)) plane = with_back(plane, Real{} + thickness);
  return clamped_at_silhouette(own, plane, silhouette[0], depth, k_by);
}

/// The values of the nine pixels around, each element on its own level, limited for those that are
/// near a silhouette. On a GPU they stay in registers if the loops over silhouettes are unrolled,
/// which second derivatives (`kBends`), short of registers, do better without.
template <bool kBends, class Lane, class Real, class Int>
PALPATE_FORMULA void values_around(const typename Lane::Grid& grid, const FieldPixels& pixels,
                                   Int pixel, Int level, Real depth, typename Lane::Mask is_near,
                                   Curved<Real> (&values)[3][3]) {
  const Real k_by = kCorner / (Lane::inverse_power(level) * grid.fx);
  planes_around<Lane>(grid, pixels, pixel, depth, values, [&](int, int, Curved<Real>& value) {
    if (grid.thickness < static_cast<float>(kSolidBehind)) {
      value = with_back(value, Real{} + grid.thickness);
    }
  });
  if constexpr (Lane::kHasMany) {
    Lane::template limit<kBends>(grid, pixels, pixel, is_near, depth, k_by, values);
  } else {  // all was read before anything waits for it
    if (!is_near) return;
#ifdef __CUDA_ARCH__
    constexpr int kUnrolled = kBends ? 1 : 3;
#pragma unroll kUnrolled
#endif
    for (int q = 0; q < 3; ++q) {
#ifdef __CUDA_ARCH__
#pragma unroll kUnrolled
#endif
      for (int p = 0; p < 3; ++p) {
        Curved<Real>& value = values[q][p];
        const Int at = pixel + ((q - 1) * grid.stride + p - 1);
        Real silhouette[4];
        Lane::read_silhouette(pixels.silhouettes, silhouette_of(at, value.value), silhouette);
        if (silhouette[0] == Real{}) continue;
        value = limited_by(silhouette, value, grid.thickness, depth, k_by);
      }
    }
  }
}

/// Splines the values of nine pixels; with planes alone they are linear in depth.
template <bool kArePlanes, class Lane, class Sample, class Real>
PALPATE_FORMULA Sample splined(const Curved<Real> (&values)[3][3], const PixelSpot<Lane>& at,
                               Real scale) {
  if constexpr (std::is_same_v<Sample, ImageCurvature<Real>>) {
    return curvature_of<kArePlanes>(values, at.s, at.t, scale);
  } else {
    return gradient_of(values, at.s, at.t, scale);
  }
}

/// phi with its derivatives by the image, by one level. `Sample` is an ImageGradient or an
/// ImageCurvature.
template <class Lane, class Sample, class Real, class Int>
PALPATE_FORMULA Sample sample_values(const typename Lane::Grid& grid, const FieldPixels& pixels,
                                     const PixelSpot<Lane>& at, Int level, Real depth,
                                     typename Lane::Mask is_near) {
  Curved<Real> values[3][3];
  constexpr bool kBends = std::is_same_v<Sample, ImageCurvature<Real>>;
  values_around<kBends, Lane>(grid, pixels, at.pixel, level, depth, is_near, values);
  return splined<false, Lane, Sample>(values, at, Lane::inverse_power(level));
}
template <class Lane, class Sample, class Real, class Int>
[[gnu::noinline]] PALPATE_HOSTDEV Sample sample_by_call(const typename Lane::Grid& grid,
                                                        const FieldPixels& pixels,
                                                        const PixelSpot<Lane>& at, Int level,
                                                        Real depth, typename Lane::Mask is_near) {
  return sample_values<Lane, Sample>(grid, pixels, at, level, depth, is_near);
}

/// True if with_back keeps the values of all elements.
template <class Lane, class Real>
PALPATE_FORMULA bool have_no_back(const Curved<Real> (&values)[3][3], float thickness) {
  if (!(thickness < static_cast<float>(kSolidBehind))) return true;
  Real least = values[0][0].value;
  for (const Curved<Real>(&row)[3] : values) {
    for (const Curved<Real>& each : row) least = least < each.value ? least : each.value;
  }
  return !Lane::is_any(below_unbent(least, Real{} + thickness) > Real{});
}

/// The same for elements of which none is near a silhouette, if `are_smooth`: planes are enough,
/// but for what is deeper than surfaces are thick.
template <class Lane, class Sample, class Real, class Int>
PALPATE_FORMULA Sample sample_level(const typename Lane::Grid& grid, const FieldPixels& pixels,
                                    const PixelSpot<Lane>& at, Int level, Real depth,
                                    typename Lane::Mask is_near, bool are_smooth) {
  Curved<Real> values[3][3];
  const auto read = [&] {
    planes_around<Lane>(grid, pixels, at.pixel, depth, values, [](int, int, Curved<Real>&) {});
  };
  if constexpr (!Lane::kHasMany) read();  // before anything waits for the answer
  if (are_smooth) {
    if constexpr (Lane::kHasMany) read();
    if (have_no_back<Lane>(values, grid.thickness)) {
      return splined<true, Lane, Sample>(values, at, Lane::inverse_power(level));
    }
  }
  return sample_by_call<Lane, Sample>(grid, pixels, at, level, depth, is_near);
}
template <class Lane, class Sample, class Real, class Int>
PALPATE_FORMULA Sample sample_level(const typename Lane::Grid& grid, const FieldPixels& pixels,
                                    const PixelSpot<Lane>& at, Int level, Real depth) {
  const typename Lane::Mask is_near = Lane::is_near_silhouette(pixels, at.pixel);
  return sample_level<Lane, Sample>(grid, pixels, at, level, depth, is_near,
                                    !Lane::is_any(is_near));
}

/// `blend` of the next wider level.
template <class Lane, class Real>
PALPATE_FORMULA ImageGradient<Real> with_wider(const ImageGradient<Real>& g,
                                               const ImageGradient<Real>& next,
                                               const LevelChoice<Lane>& levels, Real) {
  return mixed(g, next, levels.blend(), levels.blend_by_z());
}
template <class Lane, class Real>
PALPATE_FORMULA ImageCurvature<Real> with_wider(const ImageCurvature<Real>& c,
                                                const ImageCurvature<Real>& next,
                                                const LevelChoice<Lane>& levels,
                                                Real inverse_depth) {
  return blended(c, next, levels.blend(), levels.blend_by_z(), levels.blend_by_zz(inverse_depth));
}

/// Samples the pixels of `look` for one element.
template <class Sample, class Lane, class Real>
PALPATE_FORMULA Sample query_field(const typename Lane::Grid& grid, const FieldPixels& pixels,
                                   const PixelLook<Lane>& look, Real depth, Real inverse_depth) {
  const LevelChoice<Lane>& levels = look.levels;
  Sample answer{};
  // One body: a GPU has few registers.
#ifdef __CUDA_ARCH__
#pragma unroll 1
#endif
  for (int k = 0; k <= static_cast<int>(look.has_wider); ++k) {
    const auto level = levels.level + k;
    const Sample here = sample_level<Lane, Sample>(
        grid, pixels, spot_at<Lane>(grid, look.u, look.v, level), level, depth);
    answer = k > 0 ? with_wider(answer, here, levels, inverse_depth) : here;
  }
  return answer;
}

}}  // namespace palpate::v0
