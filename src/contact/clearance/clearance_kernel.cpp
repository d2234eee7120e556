// The nearest sphere of a tool, compiled once per instruction set.
#include <algorithm>

#include "src/contact/clearance/clearance_search.h"
#include "src/contact/clearance/nearest_rules.h"
#include "src/core/internal/simd.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {
namespace {

using Image = ClearanceImage;
constexpr int kPerBlock = Image::kPerBlock;

// Spheres in the frame of a camera.
struct SphereLanes {
  CameraPoint<VecF> at;
  VecF radius;
  VecI is_sphere;
  std::size_t slot;
};

// What each lane has found in an image.
struct Found {
  VecF distance2;  // no more than this matters
  VecI pixel;      // -1: none; -2 - k: border k
};

// Narrows a range of pixels to those that show a ball.
inline void clip(float x, float reach, float near_scale, float far_scale, float focal, float center,
                 int& first, int& last) {
  float low = 0, high = 0;
  find_pixels(x, reach, near_scale, far_scale, focal, center, 1.0f, low, high);
  const float limit = static_cast<float>(last);
  first = low > 0 ? static_cast<int>(low < limit + 1 ? low : limit + 1) : 0;
  last = high < limit ? (high < 0 ? -1 : static_cast<int>(high)) : last;
}

// Squares that show a ball: three by three at most, unless they are the widest ones. None if
// right < left or bottom < top.
struct Squares {
  int level = 0, left = 0, right = -1, top = 0, bottom = -1;
};
Squares squares_around(const Image& image, const CameraPoint<float>& at, float reach) {
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
[[gnu::always_inline]] inline VecF pixel_distance2(const Image& image, const CameraPoint<VecF>& at,
                                                   VecF x, VecF y, VecF depth) {
  if constexpr (kFront) {
    return ray_distance2(at, x, y, depth, depth + image.solid_behind);
  } else {
    const VecF before = ray_distance2(at, x, y, VecF{}, depth);
    if (image.solid_behind >= kNoSurface) return before;
    return min(before, ray_distance2(at, x, y, depth + image.solid_behind, splat(kNoSurface)));
  }
}

// A search of all lanes in one image. `kFront`: the nearest solid space of spheres outside of it;
// else the nearest free space of those inside.
template <bool kFront>
class ImageSearch {
 public:
  // `best`: the value to beat. `is_shared`: lanes outbid each other.
  ImageSearch(const Image& image, const SphereLanes& spheres, VecI lanes, Found& found, float best,
              float enough, bool is_shared)
      : image_(image),
        spheres_(spheres),
        lanes_(lanes),
        found_(found),
        best_(best),
        enough_(enough),
        is_shared_(is_shared) {
    const auto& at = spheres.at;
    const auto middle = [&](VecF v) {
      const float low = least_lane(select(lanes, v, splat(1e30f)));
      return 0.5f * (low + greatest_lane(select(lanes, v, splat(-1e30f))));
    };
    middle_ = {middle(at.x), middle(at.y), middle(at.z)};
    const VecF x = at.x - middle_.x, y = at.y - middle_.y, z = at.z - middle_.z;
    from_middle_ = sqrt(x * x + y * y + z * z) * 1.0001f + 1e-6f;
    tighten();
  }

  void run() {
    if (!(reach_ >= 0)) return;
    const Squares squares = squares_around(image_, middle_, reach_);
    for (int row = squares.top; row <= squares.bottom; ++row) {
      for (int column = squares.left; column <= squares.right; ++column) {
        visit(squares.level, column, row);
      }
    }
  }

  float best() const { return best_; }

 private:
  // Lowers what can still matter to what has been found.
  void tighten() {
    if constexpr (kFront) {
      if (is_shared_) {
        const VecF value = sqrt(found_.distance2) - spheres_.radius;
        best_ =
            std::min(best_, least_lane(select(lanes_ & (found_.pixel != -1), value, splat(best_))));
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
    reach_ = greatest_lane(reach) * 1.0001f;
  }

  bool is_done() const { return kFront && best_ < enough_; }

  // Looks into a square unless it is too far away for all.
  void visit(int level, int column, int row) {
    const auto place = static_cast<std::size_t>(image_.place(level, column, row));
    const float nearest = image_.nearest[level][place];
    if (kFront && nearest > middle_.z + reach_) return;
    const auto size = static_cast<float>(1 << (2 * level));
    const float left = (static_cast<float>(column) * size - image_.cx) * image_.per_fx;
    const float top = (static_cast<float>(row) * size - image_.cy) * image_.per_fy;
    if (level == 0) return look_at(column, row, left, top, nearest);
    const RaySquare<VecF> rays{splat(left), splat(left + (size - 1) * image_.per_fx), splat(top),
                               splat(top + (size - 1) * image_.per_fy)};
    const VecF bound =
        bound_of(spheres_.at, rays, splat(nearest), splat(image_.farthest[level][place]));
    if (is_any_set(bound <= limit2_)) expand(level - 1, column, row);
  }

  // A lower bound of the squared distance from points to what is looked for in squares.
  [[gnu::always_inline]] VecF bound_of(const CameraPoint<VecF>& at, const RaySquare<VecF>& rays,
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
  void expand(int level, int block_column, int block_row) {
    constexpr int kVectors = kPerBlock / kLanes;
    const std::size_t first =
        static_cast<std::size_t>(block_row * image_.blocks_wide[level] + block_column) * kPerBlock;
    const auto size = static_cast<float>(1 << (2 * level));
    const float span_x = (size - 1) * image_.per_fx, span_y = (size - 1) * image_.per_fy;
    const CameraPoint<VecF> middle{splat(middle_.x), splat(middle_.y), splat(middle_.z)};
    float bounds[kPerBlock];
    std::uint32_t near = 0;
    const float reach2 = reach_ * reach_;
    for (int k = 0; k < kVectors; ++k) {
      const VecI id = lane_ids() + k * kLanes;
      const VecF column = to_float((id & 3) + 4 * block_column) * size;
      const VecF row = to_float((id >> 2) + 4 * block_row) * size;
      const VecF left = (column - image_.cx) * image_.per_fx;
      const VecF top = (row - image_.cy) * image_.per_fy;
      const std::size_t at = first + static_cast<std::size_t>(k * kLanes);
      const VecF nearest = load(image_.nearest[level] + at);
      const VecF farthest = load(image_.farthest[level] + at);
      const VecF bound = level == 0 ? pixel_distance2<kFront>(image_, middle, left, top, nearest)
                                    : bound_of(middle, {left, left + span_x, top, top + span_y},
                                               nearest, farthest);
      store(bounds + k * kLanes, bound);
      near |= mask_bits(bound <= splat(reach2)) << (k * kLanes);
    }
    int order[kPerBlock];
    int num = 0;
    for (; near != 0; near &= near - 1) {
      const int child = __builtin_ctz(near);
      int i = num++;
      for (; i > 0 && bounds[order[i - 1]] > bounds[child]; --i) order[i] = order[i - 1];
      order[i] = child;
    }
    for (int i = 0; i < num; ++i) {
      const int child = order[i];
      if (bounds[child] > reach_ * reach_ || is_done()) break;
      visit(level, 4 * block_column + (child & 3), 4 * block_row + (child >> 2));
    }
  }

  // Measures all lanes to the ray of a pixel.
  void look_at(int column, int row, float x, float y, float depth) {
    if (column >= image_.width || row >= image_.height) return;
    const VecF distance2 =
        pixel_distance2<kFront>(image_, spheres_.at, splat(x), splat(y), splat(depth));
    const VecI pixel = splat(row * image_.width + column);
    const VecI is_nearer =
        lanes_ & ((distance2 < found_.distance2) |
                  ((distance2 == found_.distance2) & (found_.pixel >= 0) & (pixel < found_.pixel)));
    if (!is_any_set(is_nearer)) return;
    found_.distance2 = select(is_nearer, distance2, found_.distance2);
    found_.pixel = is_nearer ? pixel : found_.pixel;
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
  VecF limit2_;  // squared distance above which nothing matters to a lane; negative: nothing does
  float reach_;  // from the middle, to all that matters; negative: nothing does
};

// Signed distances to the planes of an image's border, positive in front of all of it.
struct BorderDistance {
  VecF value;
  VecI number;
};
[[gnu::always_inline]] inline BorderDistance border_distance(const Image& image,
                                                             const CameraPoint<VecF>& p) {
  BorderDistance least{splat(1e30f), VecI{}};
  for (int k = 0; k < 4; ++k) {
    const float(&n)[3] = image.border[k];
    const VecF d = n[0] * p.x + n[1] * p.y + n[2] * p.z;
    least.number = d < least.value ? splat(k) : least.number;
    least.value = min(d, least.value);
  }
  return least;
}

// The place of points in an image, and their own pixels.
struct Sight {
  VecI is_solid;  // the point is
  VecI is_in_image;
  VecI column, row;
  VecF depth;
  BorderDistance border;
};
[[gnu::always_inline]] inline Sight sight_of(const Image& image, const SphereLanes& spheres) {
  const CameraPoint<VecF>& p = spheres.at;
  Sight sight;
  sight.border = border_distance(image, p);
  const VecI is_in_front = p.z > splat(1e-3f);
  const VecF per_z = 1.0f / select(is_in_front, p.z, splat(1.0f));
  const VecF u = p.x * per_z * image.fx + (image.cx + 0.5f);
  const VecF v = p.y * per_z * image.fy + (image.cy + 0.5f);
  sight.is_in_image = is_in_front & (u >= VecF{}) & (v >= VecF{}) &
                      (u < splat(static_cast<float>(image.width))) &
                      (v < splat(static_cast<float>(image.height)));
  const VecI column = sight.column = sight.is_in_image ? to_int(u) : VecI{};
  const VecI row = sight.row = sight.is_in_image ? to_int(v) : VecI{};
  const VecI place = ((row >> 2) * image.blocks_wide[0] + (column >> 2)) * kPerBlock +
                     ((row & 3) << 2) + (column & 3);
  const VecF depth = sight.depth = gather(image.nearest[0], place);
  sight.is_solid = sight.is_in_image & (p.z >= depth) & (p.z <= depth + image.solid_behind);
  if (image.is_blocked_outside != 0) sight.is_solid |= ~sight.is_in_image;
  return sight;
}

[[gnu::always_inline]] inline SphereLanes spheres_at(const ClearanceJob& job,
                                                     const ClearanceCamera& camera,
                                                     std::size_t slot) {
  const SphereClusters& c = *job.spheres;
  const VecF x = load(&c.x[slot]), y = load(&c.y[slot]), z = load(&c.z[slot]);
  const auto row = [&](int k) {
    const float(&r)[3] = camera.R_CT[k];
    return r[0] * x + r[1] * y + r[2] * z + camera.p_CT[k];
  };
  SphereLanes lanes{{row(0), row(1), row(2)}, load(&c.radius[slot]), {}, slot};
  lanes.is_sphere = load(&c.sphere_id[slot]) >= VecI{};
  return lanes;
}

// What is nearest in an image, from outside of its solid space, and whether that is a border.
void look_outside(const Image& image, const SphereLanes& spheres, const Sight& sight, VecI lanes,
                  float& best, float enough, bool is_shared, Found& found) {
  if (image.is_blocked_outside != 0) {
    const VecF d = max(sight.border.value, VecF{});
    const VecI is_nearer = lanes & (d * d < found.distance2);
    found.distance2 = select(is_nearer, d * d, found.distance2);
    found.pixel = is_nearer ? -2 - sight.border.number : found.pixel;
  }
  if (!is_any_set(lanes)) return;
  ImageSearch<true> search(image, spheres, lanes, found, best, enough, is_shared);
  search.run();
  if (is_shared) best = search.best();
}

// The nearest free space in an image, from inside of its solid space.
void look_inside(const Image& image, const SphereLanes& spheres, const Sight& sight, VecI lanes,
                 float best, Found& found) {
  if (!is_any_set(lanes)) return;
  if (image.is_blocked_outside == 0) {
    const VecF d = max(sight.border.value, VecF{});
    const VecI is_nearer = lanes & sight.is_in_image & (d * d < found.distance2);
    found.distance2 = select(is_nearer, d * d, found.distance2);
    found.pixel = is_nearer ? -2 - sight.border.number : found.pixel;
  }
  ImageSearch<false>(image, spheres, lanes, found, best, 0, false).run();
}

// The spheres of one vector against all cameras.
class VectorSearch {
 public:
  VectorSearch(const ClearanceJob& job, std::size_t slot, ClearanceHit& hit)
      : job_(job), slot_(slot), hit_(hit), id_(load(&job.spheres->sphere_id[slot])) {}

  void run() {
    lanes_ = spheres_at(job_, job_.cameras[0], slot_).is_sphere;
    if (job_.num_cameras == 1 && job_.cameras[0].seen_free == nullptr) return run_alone();
    run_hull();
  }

 private:
  float best() const { return hit_.value; }

  // Distances that would beat the best value, squared.
  Found start(VecF radius) const {
    const VecF limit = max(best() + radius, VecF{});
    return {limit * limit * 1.000002f, splat(-1)};
  }
  Found start_inside(VecF radius) const {
    const VecF limit = max(job_.limit - radius, VecF{});
    return {limit * limit, splat(-1)};
  }

  // Keeps the least value among some lanes, of equal ones that of the first sphere.
  void keep(VecI lanes, VecF values, const Found& found, int camera, bool is_of_field,
            bool is_inside) {
    for (std::uint32_t bits = mask_bits(lanes); bits != 0; bits &= bits - 1) {
      const int i = __builtin_ctz(bits);
      if (!(values[i] < hit_.value || (values[i] == hit_.value && id_[i] < hit_.sphere))) continue;
      const std::int32_t pixel = found.pixel[i];
      hit_ = {values[i],
              id_[i],
              static_cast<std::int32_t>(slot_) + i,
              pixel,
              static_cast<std::int16_t>(camera),
              is_of_field,
              ClearanceKind::solid};
      if (is_inside) hit_.kind = pixel == -1 ? ClearanceKind::deep : ClearanceKind::open;
      if (pixel < -1) {
        hit_.kind = ClearanceKind::border;
        hit_.pixel = -2 - pixel;
      }
    }
  }

  void run_alone() {
    const Image& image = *job_.cameras[0].field;
    const SphereLanes spheres = spheres_at(job_, job_.cameras[0], slot_);
    const Sight sight = sight_of(image, spheres);
    const VecI inside = lanes_ & sight.is_solid;
    const VecI outside = lanes_ & ~sight.is_solid & (spheres.radius > splat(-best()));
    if (is_any_set(inside)) {
      if (is_any_set(inside & (-spheres.radius < splat(job_.enough)))) {
        hit_.value = -1e9f;
        hit_.kind = ClearanceKind::deep;
        return;
      }
      find_deepest(image, spheres, sight, inside);
    }
    if (!is_any_set(outside)) return;
    Found found = start(spheres.radius);
    offer<true>(image, spheres, outside & sight.is_in_image, sight.column, sight.row, sight.depth,
                found);
    float value = best();
    look_outside(image, spheres, sight, outside, value, job_.enough, true, found);
    keep(outside & (found.pixel != splat(-1)), sqrt(found.distance2) - spheres.radius, found, 0,
         true, false);
  }

  // Searches for one sphere at a time, the one that may be the deepest first. The free pixel that
  // is nearest to it is often near to the others, too, which then need no search.
  void find_deepest(const Image& image, const SphereLanes& spheres, const Sight& sight,
                    VecI lanes) {
    if (!is_any_set(lanes)) return;
    Found found = start_inside(spheres.radius);
    offer<false>(image, spheres, lanes, sight.column, sight.row, sight.depth, found);
    while (true) {
      const VecF value = select(lanes, depth_value(found, spheres), splat(1e30f));
      const float deepest = least_lane(value);
      if (!(deepest <= best())) return;
      const VecI is_it = lane_ids() == splat(__builtin_ctz(mask_bits(value == splat(deepest))));
      look_inside(image, spheres, sight, is_it, best(), found);
      keep(is_it, depth_value(found, spheres), found, 0, true, true);
      lanes &= ~is_it;
      const int i = __builtin_ctz(mask_bits(is_it));
      const std::int32_t pixel = found.pixel[i];
      if (pixel < 0) continue;
      const std::int32_t column = pixel % image.width, row = pixel / image.width;
      offer<false>(image, spheres, lanes, splat(column), splat(row),
                   splat(image.nearest[0][image.place(0, column, row)]), found);
    }
  }

  // Takes the solid or free space of a pixel where it is nearer than what a lane has.
  template <bool kFront>
  void offer(const Image& image, const SphereLanes& spheres, VecI lanes, VecI column, VecI row,
             VecF depth, Found& found) {
    const VecF x = (to_float(column) - image.cx) * image.per_fx;
    const VecF y = (to_float(row) - image.cy) * image.per_fy;
    const VecF distance2 = pixel_distance2<kFront>(image, spheres.at, x, y, depth);
    const VecI is_nearer = lanes & (distance2 < found.distance2);
    found.distance2 = select(is_nearer, distance2, found.distance2);
    found.pixel = is_nearer ? row * image.width + column : found.pixel;
  }

  VecF depth_value(const Found& found, const SphereLanes& spheres) const {
    const VecF value = -(sqrt(found.distance2) + spheres.radius);
    return select(found.pixel == splat(-1), splat(-job_.limit), value);
  }

  // Joined cameras: the greatest distance to what is not seen to be free, and no less than the
  // least one to the surfaces of `field`.
  void run_hull();

  const ClearanceJob& job_;
  std::size_t slot_;
  ClearanceHit& hit_;
  VecI id_, lanes_;
};

// The better of two answers, lane by lane, with its camera.
struct Choice {
  Found found;
  VecI camera, is_of_field;

  void take(VecI lanes, const Found& other, int number, bool from_field) {
    found.distance2 = select(lanes, other.distance2, found.distance2);
    found.pixel = lanes ? other.pixel : found.pixel;
    camera = lanes ? splat(number) : camera;
    is_of_field = lanes ? splat(from_field ? -1 : 0) : is_of_field;
  }
};

void VectorSearch::run_hull() {
  VecI may_win = lanes_, is_free{};
  VecF radius = load(&job_.spheres->radius[slot_]);
  Choice nearest{{splat(-1.0f), splat(-1)}, VecI{}, VecI{}};
  for (int k = 0; k < job_.num_cameras; ++k) {
    const Image& image = *job_.cameras[k].seen_free;
    const SphereLanes spheres = spheres_at(job_, job_.cameras[k], slot_);
    const Sight sight = sight_of(image, spheres);
    const VecI here = may_win & ~sight.is_solid;
    if (!is_any_set(here)) continue;
    Found found = start(radius);
    float value = best();
    look_outside(image, spheres, sight, here, value, job_.enough, false, found);
    is_free |= here;
    may_win &= ~(here & (found.pixel == splat(-1)));
    nearest.take(here & (found.distance2 > nearest.found.distance2), found, k, false);
  }
  if (!is_any_set(may_win)) return;
  // What the fields say: outside of all of them, the least distance.
  VecI is_in_some{};
  Choice of_fields{start(radius), VecI{}, VecI{}};
  const VecI asked = may_win & (is_free | lanes_);
  for (int k = 0; k < job_.num_cameras; ++k) {
    const Image& image = *job_.cameras[k].field;
    const SphereLanes spheres = spheres_at(job_, job_.cameras[k], slot_);
    const Sight sight = sight_of(image, spheres);
    is_in_some |= asked & sight.is_solid;
    const VecI here = asked & ~sight.is_solid & ~is_in_some;
    if (!is_any_set(here)) continue;
    Found found = of_fields.found;
    float value = best();
    look_outside(image, spheres, sight, here, value, job_.enough, false, found);
    of_fields.take(here & (found.distance2 < of_fields.found.distance2), found, k, true);
  }
  const VecI outside = may_win & (is_free | ~is_in_some);
  const VecI by_field =
      outside & ~is_in_some & ((of_fields.found.distance2 > nearest.found.distance2) | ~is_free);
  may_win &= ~(by_field & (of_fields.found.pixel == splat(-1)));
  const auto keep_each = [&](VecI lanes, const Choice& from, VecF values, bool is_inside) {
    for (int k = 0; k < job_.num_cameras; ++k) {
      const VecI of_camera = lanes & (from.camera == splat(k));
      keep(of_camera & ~from.is_of_field, values, from.found, k, false, is_inside);
      keep(of_camera & from.is_of_field, values, from.found, k, true, is_inside);
    }
  };
  keep_each(may_win & by_field, of_fields, sqrt(of_fields.found.distance2) - radius, false);
  keep_each(may_win & outside & ~by_field, nearest, sqrt(nearest.found.distance2) - radius, false);
  // Seen to be free by none, and inside of a surface: the least way to what one has seen to be
  // free, or out of all surfaces.
  const VecI inside = may_win & ~outside;
  if (!is_any_set(inside)) return;
  Choice to_free{start_inside(radius), VecI{}, VecI{}};
  Choice out_of_fields{{splat(-1.0f), splat(-1)}, VecI{}, VecI{}};
  for (int k = 0; k < job_.num_cameras; ++k) {
    const SphereLanes spheres = spheres_at(job_, job_.cameras[k], slot_);
    const Image& seen_free = *job_.cameras[k].seen_free;
    Found found = to_free.found;
    look_inside(seen_free, spheres, sight_of(seen_free, spheres), inside, best(), found);
    to_free.take(inside & (found.distance2 < to_free.found.distance2), found, k, false);
    const Image& field = *job_.cameras[k].field;
    const Sight sight = sight_of(field, spheres);
    const VecI here = inside & sight.is_solid;
    found = start_inside(radius);
    look_inside(field, spheres, sight, here, best(), found);
    out_of_fields.take(here & (found.distance2 > out_of_fields.found.distance2), found, k, true);
  }
  to_free.take(inside & (out_of_fields.found.distance2 < to_free.found.distance2) &
                   (out_of_fields.found.distance2 >= VecF{}),
               out_of_fields.found, 0, true);
  const VecI was_out = inside & (to_free.is_of_field != VecI{});
  to_free.camera = was_out ? out_of_fields.camera : to_free.camera;
  const VecF values = select(to_free.found.pixel == splat(-1), splat(-job_.limit),
                             -(sqrt(to_free.found.distance2) + radius));
  keep_each(inside, to_free, values, true);
}

CameraPoint<float> center_of(const ClearanceCamera& camera, const Cluster& ball) {
  const auto row = [&](int k) {
    const float(&r)[3] = camera.R_CT[k];
    return r[0] * ball.center.x + r[1] * ball.center.y + r[2] * ball.center.z + camera.p_CT[k];
  };
  return {row(0), row(1), row(2)};
}

// How far a cluster's ball stays in front of the surface of its middle's pixel, for the order of
// clusters.
float rank_of(const ClearanceJob& job, const Cluster& ball) {
  const Image& image = *job.cameras[0].field;
  const CameraPoint<float> p = center_of(job.cameras[0], ball);
  if (!(p.z > 1e-3f)) return 0;
  const float u = p.x / p.z * image.fx + image.cx + 0.5f;
  const float v = p.y / p.z * image.fy + image.cy + 0.5f;
  if (!(u >= 0 && v >= 0 && u < static_cast<float>(image.width) &&
        v < static_cast<float>(image.height))) {
    return 0;
  }
  const int place = image.place(1, static_cast<int>(u) >> 2, static_cast<int>(v) >> 2);
  return image.nearest[1][place] - p.z - ball.reach;
}

// True if a camera by itself sees only what is farther away than a ball and `best` around it.
bool is_far_in_front(const ClearanceJob& job, const Cluster& ball, float best) {
  const ClearanceCamera& camera = job.cameras[0];
  if (job.num_cameras > 1 || camera.seen_free != nullptr) return false;
  const Image& image = *camera.field;
  const float reach = (ball.reach + best) * 1.0001f;
  if (!(reach > 0)) return false;
  const CameraPoint<float> p = center_of(camera, ball);
  const Squares squares = squares_around(image, p, reach);
  for (int row = squares.top; row <= squares.bottom; ++row) {
    for (int column = squares.left; column <= squares.right; ++column) {
      if (image.nearest[squares.level][image.place(squares.level, column, row)] <= p.z + reach) {
        return false;
      }
    }
  }
  return true;
}

}  // namespace

void find_nearest(const ClearanceJob& job, ClearanceHit& hit) {
  hit = {};
  hit.value = job.limit;
  const SphereClusters& spheres = *job.spheres;
  for (int group = 0; group < spheres.num_groups(); ++group) {
    const int first = group * SphereClusters::kClustersPerGroup;
    const int num = std::min(SphereClusters::kClustersPerGroup, spheres.num_clusters() - first);
    if (is_far_in_front(job, spheres.groups[static_cast<std::size_t>(group)], hit.value)) continue;
    float ranks[SphereClusters::kClustersPerGroup];
    int order[SphereClusters::kClustersPerGroup];
    for (int k = 0; k < num; ++k) {
      ranks[k] = rank_of(job, spheres.clusters[static_cast<std::size_t>(first + k)]);
      int i = k;
      for (; i > 0 && ranks[order[i - 1]] > ranks[k]; --i) order[i] = order[i - 1];
      order[i] = k;
    }
    for (int k = 0; k < num; ++k) {
      const int cluster = first + order[k];
      const int num_spheres = spheres.num_spheres(cluster);
      if (is_far_in_front(job, spheres.clusters[static_cast<std::size_t>(cluster)], hit.value)) {
        continue;
      }
      for (int i = 0; i < num_spheres; i += kLanes) {
        VectorSearch(job, static_cast<std::size_t>(cluster * SphereClusters::kSize + i), hit).run();
        if (hit.value < job.enough || hit.value <= -job.limit) return;
      }
    }
  }
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
