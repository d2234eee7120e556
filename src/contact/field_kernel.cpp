// Elements against the depth field, compiled once per instruction set: the steps of
// palpate/field/field_sample.h for as many elements at once as a vector has lanes.
#include "palpate/field/field_sample.h"
#include "src/contact/field_contact.h"
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
        is_step(view.levels[0].is_step) {
    for (int k = 0; k < view.num_levels; ++k) {
      start[k] = static_cast<std::int32_t>(view.levels[k].is_step - is_step);
      step_limit[k] = view.levels[k].step_limit;
    }
  }

  float fx, fy, cx, cy, width, height, thickness;
  std::int32_t stride, last_level;
  const float* planes;  // of level 0; the other levels follow
  const std::uint8_t* is_step;
  std::int32_t start[DepthFieldView::kMaxLevels] = {};  // pixel (0, 0) of each level
  float step_limit[DepthFieldView::kMaxLevels] = {};
};

// Where in the image elements are seen.
struct Seen {
  VecF u, v, depth;
};

// phi and its derivatives, each element on a level of its own.
[[gnu::always_inline]] inline ImageGradient<VecF> sample(const Field& field, const Seen& at,
                                                         VecI level, VecF radius) {
  const VecF scale = reinterpret_cast<VecF>((127 - level) << 23);  // 2^-level
  const auto place = [&](VecF pixels, float size, VecF& offset) {
    VecF p = (pixels + 0.5f) * scale - 0.5f;
    p = min(max(p, splat(DepthFieldLevel::kFirst)), size * scale + 2.0f);
    const VecI pixel = to_int(p + 4.5f) - 4;  // rounded down: p > -4
    offset = p - to_float(pixel);
    return pixel;
  };
  VecF s, t;
  const VecI column = place(at.u, field.width, s), row = place(at.v, field.height, t);
  const VecI pixel = gather(field.start, level) + row * field.stride + column;

  // Row by row, the middle one first: it tells whether the planes have to be saturated.
  VecF plane[3], slope[3];
  const auto take_row = [&](int q) {
    VecF pairs[6];  // offset, slope, offset, slope, ...
    gather_six(field.planes, 2 * (pixel + ((q - 1) * field.stride - 1)), pairs);
    for (int p = 0; p < 3; ++p) {
      slope[p] = pairs[2 * p + 1];
      plane[p] = pairs[2 * p] - at.depth * slope[p];
    }
  };
  take_row(1);
  const VecF step_limit = gather(field.step_limit, level);
  const VecI must_bend =
      (gather_bytes(field.is_step, pixel) != 0) | (plane[1] < 2.0f * step_limit - field.thickness);
  const bool some_bend = mask_bits(must_bend) != 0;
  VecF value[3], by_u[3], slopes[3];
  const auto sum_row = [&](int q) {
    if (some_bend) [[unlikely]] {
      for (int p = 0; p < 3; ++p) {
        const Sloped<VecF> bent = saturate(plane[p], radius + step_limit, splat(field.thickness));
        plane[p] = select(must_bend, bent.value, plane[p]);
        slope[p] = select(must_bend, slope[p] * bent.slope, slope[p]);
      }
    }
    const Curved<VecF> sum = spline(plane[0], plane[1], plane[2], s);
    value[q] = sum.value;
    by_u[q] = sum.slope;
    slopes[q] = spline(slope[0], slope[1], slope[2], s).value;
  };
  sum_row(1);
  for (const int q : {0, 2}) {
    take_row(q);
    sum_row(q);
  }
  const Curved<VecF> phi = spline(value[0], value[1], value[2], t);
  return {phi.value, spline(by_u[0], by_u[1], by_u[2], t).value * scale, phi.slope * scale,
          -spline(slopes[0], slopes[1], slopes[2], t).value};
}

// phi for spheres of these radii: footprint = m 2^e with m in [1, 2) lies between levels e and e
// + 1.
[[gnu::always_inline]] inline ImageGradient<VecF> ask(const Field& field, const Seen& at,
                                                      VecF inverse_depth, VecF radius) {
  const VecI last = splat(field.last_level);
  const VecF footprint = max(kFootprint * radius * field.fx * inverse_depth, splat(1.0f));
  const VecI bits = reinterpret_cast<VecI>(footprint);
  const VecI exponent = (bits >> 23) - 127;
  const VecF m = reinterpret_cast<VecF>((bits & 0x7fffff) | 0x3f800000);
  const Sloped<VecF> step = smooth_step((m - 1.0f) * (1.0f / (kBlendEnd - 1)));
  const VecI is_next = (step.value >= splat(1.0f)) & (exponent < last);
  const VecI is_single = is_next | (exponent >= last);
  const VecI level = exponent < last ? exponent - is_next : last;
  ImageGradient<VecF> g = sample(field, at, level, radius);
  const VecF blend = select(is_single, VecF{}, step.value);
  if (mask_bits(blend > VecF{}) != 0) {
    const ImageGradient<VecF> next = sample(field, at, level < last ? level + 1 : last, radius);
    const VecF blend_by_z = step.slope * m * inverse_depth * (-1.0f / (kBlendEnd - 1));
    const VecF change = next.phi - g.phi;
    g.by_u += blend * (next.by_u - g.by_u);
    g.by_v += blend * (next.by_v - g.by_v);
    g.by_z += blend * (next.by_z - g.by_z) + select(is_single, VecF{}, change * blend_by_z);
    g.phi += blend * change;
  }
  return g;
}

// Sums of one group.
struct Totals {
  RowSums volume, potential, fx, fy, fz, tx, ty, tz, boundary, inside;
};

// Volumes, energies and forces of one cluster.
void measure_cluster(const FieldJob& job, const Field& field, std::size_t begin, Totals& totals) {
  const SphereClusters& c = *job.clusters;
  for (int i = 0; i < kSize; i += kLanes) {
    const std::size_t place = begin + static_cast<std::size_t>(i);
    const VecF x_T = load(&c.x[place]), y_T = load(&c.y[place]), z_T = load(&c.z[place]);
    const auto rotated = [&](const float(&row)[3]) {
      return row[0] * x_T + row[1] * y_T + row[2] * z_T;
    };
    const VecF lx = rotated(job.R_WT[0]), ly = rotated(job.R_WT[1]), lz = rotated(job.R_WT[2]);
    const VecF depth = max(lz + job.p_WC[2], splat(kLeastDepth)), inverse_depth = 1.0f / depth;
    const VecF from_u = field.fx * (lx + job.p_WC[0]) * inverse_depth;
    const VecF from_v = field.fy * (ly + job.p_WC[1]) * inverse_depth;
    const VecF radius = load(job.radius + place), factor = load(job.factor + place);
    ImageGradient<VecF> g =
        ask(field, {from_u + field.cx, from_v + field.cy, depth}, inverse_depth, radius);
    const VecI in_front = lz + job.p_WC[2] > splat(kLeastDepth);
    const VecF phi = select(in_front, g.phi, radius);

    const VecF h = min(max(radius - phi, VecF{}), radius + radius);
    const VecF volume = factor * (static_cast<float>(kPi / 3) * h * h * (3.0f * radius - h));
    const VecF whole = factor * (static_cast<float>(4 * kPi / 3) * radius * radius * radius);
    const VecF potential =
        factor * (static_cast<float>(kPi / 12) * h * h * h * (4.0f * radius - h)) +
        whole * max(-phi - radius, VecF{});
    const Gradient3<VecF> n = to_space(g, from_u, from_v, inverse_depth, field.fx, field.fy);
    const VecF x = volume * n.x, y = volume * n.y, z = volume * n.z;
    const int part = i / kLanes % RowSums::kParts;
    totals.volume.add(part, volume * fade(phi, splat(field.thickness)));
    totals.potential.add(part, potential);
    totals.fx.add(part, x);
    totals.fy.add(part, y);
    totals.fz.add(part, z);
    totals.tx.add(part, ly * z - lz * y);
    totals.ty.add(part, lz * x - lx * z);
    totals.tz.add(part, lx * y - ly * x);
    const VecF counted = load(job.counted + place);
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
  const Field field(job.field);
  Totals totals;
  for (int cluster = first; cluster < last; ++cluster) {
    if (is_in_front(job, cluster)) continue;
    measure_cluster(job, field, static_cast<std::size_t>(cluster) * kSize, totals);
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
