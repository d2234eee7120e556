// Elements against the depth field, compiled once per instruction set: the steps of
// palpate/field/field_sample.h, first for vectors of elements, then for the nine pixels that each
// element sees, then for vectors again.
#include "palpate/field/field_sample.h"
#include "src/contact/field_contact.h"
#include "src/core/simd.h"

namespace palpate::PALPATE_ISA_NAMESPACE {
namespace {

constexpr int kSize = SphereClusters::kSize;

// Offset and slope of three neighbouring pixels of a row, and of one more that has no weight.
typedef float Pixels __attribute__((vector_size(32)));

inline Pixels load_pixels(const float* from) {
  Pixels v;
  std::memcpy(&v, from, sizeof v);
  return v;
}

// An offset and a slope: offset - z slope is a distance, or the derivative of one.
typedef float Pair __attribute__((vector_size(8)));
typedef float Half __attribute__((vector_size(16)));

inline void store_pair(float* to, Pair pair) { std::memcpy(to, &pair, sizeof pair); }

// Where elements look on one level: the nearest pixel and where between the pixels.
struct Spot {
  std::int32_t level[kSize], pixel[kSize];
  float s[kSize], t[kSize];  // right of and below its middle
};

// The elements of one cluster on their way.
struct alignas(64) Lookup {
  float lever_x[kSize], lever_y[kSize], lever_z[kSize];  // c_s - C in W
  float from_u[kSize], from_v[kSize];                    // pixels from the image centre
  float z[kSize], inverse_z[kSize];
  Spot spot, next;  // `next` if there is something to blend
  float blend[kSize], blend_by_z[kSize];
  float phi[2 * kSize], by_u[2 * kSize], by_v[2 * kSize];  // pairs
  float more_by_z[kSize];                                  // of the blend
};

// Every level has the same stride, and a size that is that of the image times its scale.
[[gnu::always_inline]] inline void locate(const DepthFieldView& field, VecF u, VecF v, VecI level,
                                          int i, Spot& spot) {
  const DepthFieldLevel& finest = field.levels[0];
  const VecF scale = reinterpret_cast<VecF>((127 - level) << 23);  // 2^-level
  const auto place = [&](VecF at, int size, VecF& offset) {
    VecF p = (at + 0.5f) * scale - 0.5f;
    p = min(max(p, splat(DepthFieldLevel::kFirst)), static_cast<float>(size) * scale + 2.0f);
    const VecI pixel = to_int(p + 4.5f) - 4;  // rounded down: p > -4
    offset = p - to_float(pixel);
    return pixel;
  };
  VecF s, t;
  const VecI column = place(u, finest.width, s), row = place(v, finest.height, t);
  store(spot.s + i, s);
  store(spot.t + i, t);
  const VecI pixel = row * finest.stride + column;
  std::memcpy(spot.pixel + i, &pixel, sizeof pixel);
  std::memcpy(spot.level + i, &level, sizeof level);
}

// Where the elements are, and which level they ask.
void look(const FieldJob& job, std::size_t begin, Lookup& at) {
  const SphereClusters& c = *job.clusters;
  const float fx = static_cast<float>(job.field.intrinsics.fx);
  const float fy = static_cast<float>(job.field.intrinsics.fy);
  const float cx = static_cast<float>(job.field.intrinsics.cx);
  const float cy = static_cast<float>(job.field.intrinsics.cy);
  const VecI last = splat(static_cast<std::int32_t>(job.field.num_levels - 1));
  for (int i = 0; i < kSize; i += kLanes) {
    const std::size_t place = begin + static_cast<std::size_t>(i);
    const VecF x = load(&c.x[place]), y = load(&c.y[place]), z = load(&c.z[place]);
    const auto rotated = [&](const float(&row)[3]) { return row[0] * x + row[1] * y + row[2] * z; };
    const VecF lx = rotated(job.R_WT[0]), ly = rotated(job.R_WT[1]), lz = rotated(job.R_WT[2]);
    store(at.lever_x + i, lx);
    store(at.lever_y + i, ly);
    store(at.lever_z + i, lz);
    const VecF depth = max(lz + job.p_WC[2], splat(kLeastDepth));
    const VecF inverse = 1.0f / depth;
    store(at.z + i, depth);
    store(at.inverse_z + i, inverse);
    const VecF from_u = fx * (lx + job.p_WC[0]) * inverse;
    const VecF from_v = fy * (ly + job.p_WC[1]) * inverse;
    store(at.from_u + i, from_u);
    store(at.from_v + i, from_v);

    // Footprint = m 2^e with m in [1, 2): between levels e and e + 1.
    const VecF footprint = max(kFootprint * load(job.radius + place) * fx * inverse, splat(1.0f));
    const VecI bits = reinterpret_cast<VecI>(footprint);
    const VecI exponent = (bits >> 23) - 127;
    const VecF m = reinterpret_cast<VecF>((bits & 0x7fffff) | 0x3f800000);
    const Sloped<VecF> step = smooth_step((m - 1.0f) * (1.0f / (kBlendEnd - 1)));
    const VecI is_next = (step.value >= splat(1.0f)) & (exponent < last);
    const VecI is_single = is_next | (exponent >= last);
    const VecI level = exponent < last ? exponent - is_next : last;
    const VecF u = from_u + cx, v = from_v + cy;
    locate(job.field, u, v, level, i, at.spot);
    const VecF blend = select(is_single, VecF{}, step.value);
    if (mask_bits(blend > VecF{}) != 0) {
      locate(job.field, u, v, level < last ? level + 1 : last, i, at.next);
    }
    store(at.blend + i, blend);
    store(at.blend_by_z + i,
          select(is_single, VecF{}, step.slope * m * inverse * (-1.0f / (kBlendEnd - 1))));
  }
}

// phi and its derivatives in the image, on one level.
struct Sample {
  Pair phi, by_u, by_v;
};

// Pixels with the same distance and slope at z as the saturated ones.
[[gnu::noinline]] Pixels saturate_row(Pixels p, float z, float limit, float thickness) {
  for (int k = 0; k < 6; k += 2) {
    const Sloped<float> plane = saturate(p[k] - z * p[k + 1], limit, thickness);
    const float slope = p[k + 1] * plane.slope;
    p[k] = plane.value + z * slope;
    p[k + 1] = slope;
  }
  return p;
}

[[gnu::always_inline]] inline Sample sample(const DepthFieldView& field, const Spot& spot, int i,
                                            float z, float radius) {
  const DepthFieldLevel& level = field.levels[spot.level[i]];
  const std::ptrdiff_t stride = level.stride, pixel = spot.pixel[i];
  const float* corner = level.planes + 2 * (pixel - stride - 1);
  Pixels p0 = load_pixels(corner), p1 = load_pixels(corner + 2 * stride),
         p2 = load_pixels(corner + 4 * stride);
  if (must_saturate(level, pixel, z, field.thickness)) [[unlikely]] {
    const float limit = radius + level.step_limit;
    p0 = saturate_row(p0, z, limit, field.thickness);
    p1 = saturate_row(p1, z, limit, field.thickness);
    p2 = saturate_row(p2, z, limit, field.thickness);
  }
  const Sloped<Pixels> row = spline(p0, p1, p2, spot.t[i]);
  // Per pixel of the row: the pair of its value, and the pair of its slope by v.
  const Half left = __builtin_shufflevector(row.value, row.slope, 0, 1, 8, 9);
  const Half middle = __builtin_shufflevector(row.value, row.slope, 2, 3, 10, 11);
  const Half right = __builtin_shufflevector(row.value, row.slope, 4, 5, 12, 13);
  const Sloped<Half> both = spline(left, middle, right, spot.s[i]);
  return {__builtin_shufflevector(both.value, both.value, 0, 1),
          level.scale * __builtin_shufflevector(both.slope, both.slope, 0, 1),
          level.scale * __builtin_shufflevector(both.value, both.value, 2, 3)};
}

// What the field says to each element.
void ask(const FieldJob& job, std::size_t begin, Lookup& at) {
  for (int i = 0; i < kSize; ++i) {
    const float z = at.z[i], radius = job.radius[begin + static_cast<std::size_t>(i)];
    Sample result = sample(job.field, at.spot, i, z, radius);
    at.more_by_z[i] = 0;
    const float blend = at.blend[i];
    if (blend > 0) [[unlikely]] {
      const Sample next = sample(job.field, at.next, i, z, radius);
      const Pair change = next.phi - result.phi;
      at.more_by_z[i] = (change[0] - z * change[1]) * at.blend_by_z[i];
      result.phi += blend * change;
      result.by_u += blend * (next.by_u - result.by_u);
      result.by_v += blend * (next.by_v - result.by_v);
    }
    store_pair(at.phi + 2 * i, result.phi);
    store_pair(at.by_u + 2 * i, result.by_u);
    store_pair(at.by_v + 2 * i, result.by_v);
  }
}

// Sums of one group.
struct Totals {
  RowSums volume, potential, fx, fy, fz, tx, ty, tz, boundary, inside;
};

// Volumes, energies and forces of the elements.
void push(const FieldJob& job, std::size_t begin, const Lookup& at, Totals& totals) {
  const float fx = static_cast<float>(job.field.intrinsics.fx);
  const float fy = static_cast<float>(job.field.intrinsics.fy);
  for (int i = 0; i < kSize; i += kLanes) {
    const std::size_t place = begin + static_cast<std::size_t>(i);
    const int part = i / kLanes % RowSums::kParts;
    const VecF radius = load(job.radius + place), factor = load(job.factor + place);
    const VecF lz = load(at.lever_z + i);
    const VecI in_front = lz + job.p_WC[2] > splat(kLeastDepth);
    const VecF depth = load(at.z + i);
    VecF slope;
    const auto distance = [&](const float* pairs) {
      VecF offset;
      load_pairs(pairs + 2 * i, offset, slope);
      return offset - depth * slope;
    };
    const VecF by_u = distance(at.by_u), by_v = distance(at.by_v), at_centre = distance(at.phi);
    const VecF phi = select(in_front, at_centre, radius);
    const VecF h = min(max(radius - phi, VecF{}), radius + radius);
    const VecF volume = factor * (static_cast<float>(kPi / 3) * h * h * (3.0f * radius - h));
    const VecF whole = factor * (static_cast<float>(4 * kPi / 3) * radius * radius * radius);
    const VecF potential =
        factor * (static_cast<float>(kPi / 12) * h * h * h * (4.0f * radius - h)) +
        whole * max(-phi - radius, VecF{});
    const Gradient3<VecF> n =
        to_space(ImageGradient<VecF>{phi, by_u, by_v, load(at.more_by_z + i) - slope},
                 load(at.from_u + i), load(at.from_v + i), load(at.inverse_z + i), fx, fy);
    const VecF x = volume * n.x, y = volume * n.y, z = volume * n.z;
    const VecF lx = load(at.lever_x + i), ly = load(at.lever_y + i);
    const VecF counted = load(job.counted + place);
    totals.volume.add(part, volume * fade(phi, splat(job.field.thickness)));
    totals.potential.add(part, potential);
    totals.fx.add(part, x);
    totals.fy.add(part, y);
    totals.fz.add(part, z);
    totals.tx.add(part, ly * z - lz * y);
    totals.ty.add(part, lz * x - lx * z);
    totals.tz.add(part, lx * y - ly * x);
    const VecI is_inside = phi <= -radius;
    totals.inside.add(part, select(is_inside, counted, VecF{}));
    totals.boundary.add(part, select((phi < radius) & ~is_inside, counted, VecF{}));
  }
}

// True if the tiles that a cluster can ask about are all well behind it: every plane is at least
// the largest radius away from every element.
bool is_in_front(const FieldJob& job, int cluster) {
  const Cluster& ball = job.clusters->clusters[static_cast<std::size_t>(cluster)];
  const Vec3f& c = ball.centre;
  const auto coordinate = [&](int row) {
    const float(&r)[3] = job.R_WT[row];
    return r[0] * c.x + r[1] * c.y + r[2] * c.z + job.p_WC[row];
  };
  const float reach = ball.reach * 1.0001f, depth = coordinate(2);
  const float nearest = depth - reach, farthest = depth + reach;
  if (!(nearest > kLeastDepth)) return farthest < kLeastDepth;
  const float radius = job.largest_radius[cluster];
  // Tiles of the cluster's image, and of the three footprints around that a wide pixel and its
  // neighbours take in.
  const DepthFieldView& field = job.field;
  const auto tiles = [&](float x, double focal, double centre, int num, int& first, int& last) {
    const float f = static_cast<float>(focal);
    const float margin = 2 + 4 * kFootprint * radius * f / nearest;
    const float low = f * (x - reach) / (x < reach ? nearest : farthest) - margin;
    const float high = f * (x + reach) / (x > -reach ? nearest : farthest) + margin;
    const auto tile = [&](float pixel) {
      const float at = (pixel + static_cast<float>(centre)) * (1.0f / DepthFieldView::kTileSize);
      const float most = static_cast<float>(num - 1);
      return static_cast<int>(at > 0 ? (at < most ? at : most) : 0.0f);
    };
    first = tile(low);
    last = tile(high);
  };
  int left, right, top, bottom;
  tiles(coordinate(0), field.intrinsics.fx, field.intrinsics.cx, field.tiles_wide, left, right);
  tiles(coordinate(1), field.intrinsics.fy, field.intrinsics.cy, field.tiles_high, top, bottom);
  for (int v = top; v <= bottom; ++v) {
    for (int u = left; u <= right; ++u) {
      const DepthTile& tile = field.tiles[v * field.tiles_wide + u];
      if (!(tile.least_slope * (tile.nearest - farthest) > radius)) return false;
    }
  }
  return true;
}

}  // namespace

FieldSums measure_group(const FieldJob& job, int group) {
  if (job.field.num_levels == 0) return {};
  const SphereClusters& clusters = *job.clusters;
  const int first = group * SphereClusters::kClustersPerGroup;
  const int last = std::min(first + SphereClusters::kClustersPerGroup, clusters.num_clusters());
  Totals totals;
  Lookup at;
  for (int cluster = first; cluster < last; ++cluster) {
    if (is_in_front(job, cluster)) continue;
    const std::size_t begin = static_cast<std::size_t>(cluster) * kSize;
    look(job, begin, at);
    ask(job, begin, at);
    push(job, begin, at, totals);
  }
  FieldSums sums;
  sums.volume = totals.volume.total();
  sums.potential = totals.potential.total();
  sums.force = {totals.fx.total(), totals.fy.total(), totals.fz.total()};
  sums.torque = {totals.tx.total(), totals.ty.total(), totals.tz.total()};
  sums.num_boundary = totals.boundary.total();
  sums.num_inside = totals.inside.total();
  return sums;
}

}  // namespace palpate::PALPATE_ISA_NAMESPACE
