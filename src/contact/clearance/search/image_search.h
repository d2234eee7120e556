// The branch and bound over squares of pixels in one image, for a vector of spheres. Included by
// kernel files only.
#pragma once

#include "src/contact/clearance/clearance_search.h"
#include "src/contact/clearance/nearest_rules.h"
#include "src/contact/clearance/search/search_lanes.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

using Image = ClearanceImage;
constexpr int kPerBlock = Image::kPerBlock;
constexpr float kFarAway = 1e30f;  // squared distance beyond all that matters

// Spheres in the frame of a camera.
struct SphereLanes {
  CameraPoint<VecF> at;
  VecF radius;
};

// The nearest part of an image that each lane has found.
struct Found {
  VecF distance2;  // no more than this matters
  VecI pixel;      // -1: none; -2 - k: border k
};

// Narrows a range of pixels to those that show a ball.
PALPATE_LANE_CODE inline void clip(float x, float reach, float near_scale, float far_scale,
                                   float focal, float center, int& first, int& last) {
  float low = 0, high = 0;
  find_pixels(x, reach, near_scale, far_scale, focal, center, 1.0f, low, high);
  const float limit = static_cast<float>(last);
  first = low > 0 ? static_cast<int>(low < limit + 1 ? low : limit + 1) : 0;
  last = high < limit ? (high < 0 ? -1 : static_cast<int>(high)) : last;
}

// Squares that show a ball: three by three at most, unless they are the widest ones.
struct Squares {
  int level = 0, left = 0, right = -1, top = 0, bottom = -1;

  PALPATE_LANE_CODE bool is_empty() const { return right < left || bottom < top; }
  PALPATE_LANE_CODE int wide() const { return right - left + 1; }
  PALPATE_LANE_CODE int high() const { return bottom - top + 1; }
};
PALPATE_LANE_CODE inline Squares squares_around(const Image& image, const CameraPoint<float>& at,
                                                float reach) {
  Squares to{0, 0, image.width - 1, 0, image.height - 1};
  const float near = at.z - reach;
  if (near > 0.005f) {
    const float near_scale = 1 / near, far_scale = 1 / (at.z + reach);
    clip(at.x, reach, near_scale, far_scale, image.fx, image.cx, to.left, to.right);
    clip(at.y, reach, near_scale, far_scale, image.fy, image.cy, to.top, to.bottom);
  } else if (at.z + reach < 0) {
    return {};
  }
  if (to.left > to.right || to.top > to.bottom) return {};
  const auto is_wide = [&] {
    const int shift = 2 * to.level;
    return (to.right >> shift) - (to.left >> shift) > 2 ||
           (to.bottom >> shift) - (to.top >> shift) > 2;
  };
  while (to.level < Image::kLevels - 1 && is_wide()) ++to.level;
  const int shift = 2 * to.level;
  return {to.level, to.left >> shift, to.right >> shift, to.top >> shift, to.bottom >> shift};
}

// The squared distance from points to the solid space on the rays of pixels, or the free one.
template <bool kFront>
PALPATE_LANE_INLINE VecF pixel_distance2(const Image& image, const CameraPoint<VecF>& at, VecF x,
                                         VecF y, VecF depth) {
  if constexpr (kFront) {
    return ray_distance2(at, x, y, depth, depth + image.solid_behind);
  } else {
    const VecF before = ray_distance2(at, x, y, VecF{}, depth);
    if (image.solid_behind >= kNoSurface) return before;
    return min(before, ray_distance2(at, x, y, depth + image.solid_behind, splat(kNoSurface)));
  }
}

// A search of all lanes in one image. `kFront`: the nearest solid space of spheres outside of it;
// else the nearest free space of those inside. `kSingle`: of one sphere, which takes the pixels of
// a block at once.
template <bool kFront, bool kSingle>
class ImageSearch {
 public:
  // `best`: the value to beat. `is_shared`: lanes outbid each other.
  PALPATE_LANE_CODE ImageSearch(const Image& image, const SphereLanes& spheres, VecI lanes,
                                Found& found, float best, float enough, bool is_shared)
      : image_(image),
        spheres_(spheres),
        lanes_(lanes),
        found_(found),
        best_(best),
        enough_(enough),
        is_shared_(is_shared) {
    const auto& at = spheres.at;
    if constexpr (kSingle) {
      lane_ = first_lane(mask_bits(lanes));
      radius_ = lane_of(spheres.radius, lane_);
      middle_ = {lane_of(at.x, lane_), lane_of(at.y, lane_), lane_of(at.z, lane_)};
      distance2_ = lane_of(found.distance2, lane_);
      pixel_ = lane_of(found.pixel, lane_);
    } else {
      const auto middle = [&](VecF v) {
        const float low = min_lane(select(lanes, v, splat(kFarAway)));
        return 0.5f * (low + max_lane(select(lanes, v, splat(-kFarAway))));
      };
      middle_ = {middle(at.x), middle(at.y), middle(at.z)};
      const VecF x = at.x - middle_.x, y = at.y - middle_.y, z = at.z - middle_.z;
      from_middle_ = sqrt(x * x + y * y + z * z) * 1.0001f + 1e-6f;
    }
    tighten();
  }

  PALPATE_LANE_CODE void run() {
    if (!(reach_ >= 0)) return;
    const Squares squares = squares_around(image_, middle_, reach_);
    if (squares.is_empty()) return;
    switch (squares.level) {
      case 0: visit_all<0>(squares); break;
      case 1: visit_all<1>(squares); break;
      case 2: visit_all<2>(squares); break;
      case 3: visit_all<3>(squares); break;
      default: visit_all<Image::kLevels - 1>(squares);
    }
    if constexpr (kSingle) {
      found_.distance2 = select(lanes_, splat(distance2_), found_.distance2);
      found_.pixel = select(lanes_, splat(pixel_), found_.pixel);
    }
  }

  PALPATE_LANE_CODE float best() const { return best_; }

 private:
  static constexpr int kVectors =
      kLanes < kPerBlock ? kPerBlock / kLanes : 1;  // of sixteen squares

  // Lowers what can still matter to what has been found.
  PALPATE_LANE_CODE void tighten() {
    if constexpr (kSingle) return tighten_one();
    if constexpr (kFront) {
      if (is_shared_) {
        const VecF value = sqrt(found_.distance2) - spheres_.radius;
        best_ = lesser(best_,
                       min_lane(select(lanes_ & (found_.pixel != splat(-1)), value, splat(best_))));
        const VecF limit = max(best_ + spheres_.radius, VecF{});
        limit2_ = select(lanes_, limit * limit * 1.000002f, splat(-1.0f));
      } else {
        limit2_ = select(lanes_, found_.distance2, splat(-1.0f));
      }
    } else {
      // A lane that is no deeper than the deepest one cannot win.
      const VecI may_win = sqrt(found_.distance2) + spheres_.radius >= splat(-best_);
      limit2_ = select(lanes_ & may_win, found_.distance2, splat(-1.0f));
    }
    const VecF reach =
        select(limit2_ >= VecF{}, from_middle_ + sqrt(max(limit2_, VecF{})), splat(-1.0f));
    reach_ = max_lane(reach) * 1.0001f;
    reach2_ = reach_ >= 0 ? reach_ * reach_ : -1;
  }

  // The same for one sphere.
  PALPATE_LANE_CODE void tighten_one() {
    float limit2 = distance2_;
    if constexpr (kFront) {
      if (is_shared_) {
        if (pixel_ != -1) best_ = lesser(best_, root(limit2) - radius_);
        const float limit = greater(best_ + radius_, 0.0f);
        limit2 = limit * limit * 1.000002f;
      }
    } else if (!(root(limit2) + radius_ >= -best_)) {
      limit2 = -1;
    }
    limit2_ = select(lanes_, splat(limit2), splat(-1.0f));
    reach_ = limit2 >= 0 ? (1e-6f + root(limit2)) * 1.0001f : -1;
    reach2_ = reach_ >= 0 ? reach_ * reach_ : -1;
  }

  PALPATE_LANE_CODE bool is_done() const { return kFront && best_ < enough_; }

  template <int kLevel>
  PALPATE_LANE_CODE void visit_all(const Squares& squares) {
    if constexpr (kSingle && kLevel < Image::kLevels - 1) {
      visit_best<kLevel>(squares);
    } else {
      if (kSingle && squares.wide() * squares.high() <= kPerBlock) {
        return visit_best<kLevel>(squares);
      }
      for (int row = squares.top; row <= squares.bottom; ++row) {
        for (int column = squares.left; column <= squares.right; ++column) {
          visit<kLevel>(column, row, false);
        }
      }
    }
  }

  // Looks into a square unless it is too far away for all. `is_near`: it is not for the middle.
  template <int kLevel>
  PALPATE_LANE_CODE void visit(int column, int row, bool is_near) {
    const std::int32_t place = image_.place(kLevel, column, row);
    const float nearest = image_.nearest[kLevel][place];
    if (kFront && nearest > middle_.z + reach_) return;
    constexpr float kSize = 1 << (2 * kLevel);
    const float left = (static_cast<float>(column) * kSize - image_.cx) * image_.per_fx;
    const float top = (static_cast<float>(row) * kSize - image_.cy) * image_.per_fy;
    if constexpr (kLevel == 0) {
      look_at(column, row, left, top, nearest);
    } else if (kSingle && is_near) {
      expand<kLevel - 1>(column, row);
    } else {
      const RaySquare<VecF> rays{splat(left), splat(left + (kSize - 1) * image_.per_fx), splat(top),
                                 splat(top + (kSize - 1) * image_.per_fy)};
      const VecF bound =
          bound_of(spheres_.at, rays, splat(nearest), splat(image_.farthest[kLevel][place]));
      if (is_any_set(bound <= limit2_)) expand<kLevel - 1>(column, row);
    }
  }

  // A lower bound of the squared distance from points to what is looked for in squares.
  PALPATE_LANE_INLINE VecF bound_of(const CameraPoint<VecF>& at, const RaySquare<VecF>& rays,
                                    VecF nearest, VecF farthest) const {
    if constexpr (kFront) {
      return square_bound2(at, rays, nearest, farthest + image_.solid_behind);
    } else {
      const VecF before = square_bound2(at, rays, VecF{}, farthest);
      if (image_.solid_behind >= kNoSurface) return before;
      return min(before, square_bound2(at, rays, nearest + image_.solid_behind, splat(kNoSurface)));
    }
  }

  // Looks into those of a block's squares that come near enough to the middle of all lanes, the
  // nearest ones first.
  template <int kLevel>
  PALPATE_LANE_CODE void expand(int block_column, int block_row) {
    const std::int32_t first = (block_row * image_.blocks_wide[kLevel] + block_column) * kPerBlock;
    constexpr float kSize = 1 << (2 * kLevel);
    const float span_x = (kSize - 1) * image_.per_fx, span_y = (kSize - 1) * image_.per_fy;
    const CameraPoint<VecF> middle{splat(middle_.x), splat(middle_.y), splat(middle_.z)};
    VecF bounds[kVectors];
    const VecF width = splat(static_cast<float>(image_.width));
    const VecF height = splat(static_cast<float>(image_.height));
    for (int k = 0; k < kVectors; ++k) {
      const VecI id = number_of(k);
      const VecF column = to_float((id & 3) + 4 * block_column) * kSize;
      const VecF row = to_float((id >> 2) + 4 * block_row) * kSize;
      const VecF left = (column - image_.cx) * image_.per_fx;
      const VecF top = (row - image_.cy) * image_.per_fy;
      const VecF nearest = load_part(image_.nearest[kLevel] + first, k);
      bounds[k] = kLevel == 0 ? pixel_distance2<kFront>(image_, middle, left, top, nearest)
                              : bound_of(middle, {left, left + span_x, top, top + span_y}, nearest,
                                         load_part(image_.farthest[kLevel] + first, k));
      if (kSingle && kLevel == 0) {
        bounds[k] = select((column < width) & (row < height), bounds[k], splat(kFarAway));
      }
    }
    take_best(bounds, [&](int child, float nearest) {
      const int column = 4 * block_column + (child & 3), row = 4 * block_row + (child >> 2);
      if constexpr (kSingle && kLevel == 0) {
        take_one(nearest, column, row);
        return false;
      } else {
        visit<kLevel>(column, row, true);
        return true;
      }
    });
  }

  // Visits the nearest of sixteen squares while they come near enough, and visit(number, bound)
  // wants more.
  template <class Visit>
  PALPATE_LANE_INLINE void take_best(VecF (&bounds)[kVectors], const Visit& visit) {
    while (!is_done()) {
      VecF least = bounds[0];
      for (int k = 1; k < kVectors; ++k) least = min(least, bounds[k]);
      const float nearest = min_lane(least);
      if (!(nearest <= reach2_)) return;
      int child = 0;
      for (int k = kVectors - 1; k >= 0; --k) {
        const std::uint32_t bits = mask_bits(bounds[k] == splat(nearest));
        if (bits != 0) child = k * kLanes + first_lane(bits);
      }
      for (int k = 0; k < kVectors; ++k) {
        bounds[k] = select(number_of(k) == splat(child), splat(kFarAway), bounds[k]);
      }
      if (!visit(child, nearest)) return;
    }
  }

  // Numbers of squares in vector k of sixteen.
  PALPATE_LANE_INLINE static VecI number_of(int k) {
    return (lane_ids() + k * kLanes) & (kPerBlock - 1);
  }

  // Looks into up to sixteen squares of an image for one sphere, the nearest ones first.
  template <int kLevel>
  PALPATE_LANE_CODE void visit_best(const Squares& squares) {
    const int wide = squares.wide(), high = squares.high();
    constexpr float kSize = 1 << (2 * kLevel);
    const float span_x = (kSize - 1) * image_.per_fx, span_y = (kSize - 1) * image_.per_fy;
    const float per_wide = 1.0f / static_cast<float>(wide);
    const CameraPoint<VecF> middle{splat(middle_.x), splat(middle_.y), splat(middle_.z)};
    VecF bounds[kVectors];
    for (int k = 0; k < kVectors; ++k) {
      const VecI id = number_of(k), row_in = to_int((to_float(id) + 0.5f) * per_wide);
      const VecI is_there = row_in < splat(high);
      const VecI row = select(is_there, row_in, VecI{}) + squares.top;
      const VecI column = id + row_in * -wide + squares.left;
      const VecI place = ((row >> 2) * image_.blocks_wide[kLevel] + (column >> 2)) * kPerBlock +
                         ((row & 3) << 2) + (column & 3);
      const VecF left = (to_float(column) * kSize - image_.cx) * image_.per_fx;
      const VecF top = (to_float(row) * kSize - image_.cy) * image_.per_fy;
      const VecF nearest = gather(image_.nearest[kLevel], place);
      const VecF bound = kLevel == 0 ? pixel_distance2<kFront>(image_, middle, left, top, nearest)
                                     : bound_of(middle, {left, left + span_x, top, top + span_y},
                                                nearest, gather(image_.farthest[kLevel], place));
      bounds[k] = select(is_there, bound, splat(kFarAway));
    }
    take_best(bounds, [&](int child, float nearest) {
      const int row_in = child / wide;
      const int column = squares.left + child - row_in * wide, row = squares.top + row_in;
      if constexpr (kLevel == 0) {
        take_one(nearest, column, row);
        return false;
      } else {
        expand<kLevel - 1>(column, row);
        return true;
      }
    });
  }

  // Measures all lanes to the ray of a pixel.
  PALPATE_LANE_CODE void look_at(int column, int row, float x, float y, float depth) {
    if (column >= image_.width || row >= image_.height) return;
    take(pixel_distance2<kFront>(image_, spheres_.at, splat(x), splat(y), splat(depth)), column,
         row);
  }

  // Takes a pixel for the only sphere if it is nearer than what it has, of equal ones the first.
  PALPATE_LANE_CODE void take_one(float distance2, int column, int row) {
    const std::int32_t pixel = row * image_.width + column;
    const bool is_first = distance2 == distance2_ && pixel_ >= 0 && pixel < pixel_;
    if (!(distance2 < distance2_ || is_first)) return;
    distance2_ = distance2;
    pixel_ = pixel;
    tighten_one();
  }

  // Takes a pixel where it is nearer than what lanes have, of equal ones the first.
  PALPATE_LANE_CODE void take(VecF distance2, int column, int row) {
    const VecI pixel = splat(row * image_.width + column);
    const VecI is_nearer =
        lanes_ &
        ((distance2 < found_.distance2) |
         ((distance2 == found_.distance2) & (found_.pixel >= splat(0)) & (pixel < found_.pixel)));
    if (!is_any_set(is_nearer)) return;
    found_.distance2 = select(is_nearer, distance2, found_.distance2);
    found_.pixel = select(is_nearer, pixel, found_.pixel);
    tighten();
  }

  const Image& image_;
  const SphereLanes& spheres_;
  VecI lanes_;
  Found& found_;
  float best_, enough_;
  bool is_shared_;
  CameraPoint<float> middle_;
  VecF from_middle_;
  // The only sphere: its lane, and what it has found so far.
  int lane_ = 0;
  float radius_ = 0, distance2_ = 0;
  std::int32_t pixel_ = -1;
  VecF limit2_;   // squared distance above which nothing matters to a lane; negative: nothing does
  float reach_;   // from the middle, to all that matters; negative: nothing does
  float reach2_;  // its square; negative likewise
};

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
