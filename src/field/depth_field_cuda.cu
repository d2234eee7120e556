#include "src/field/depth_field_cuda.h"

#include <utility>
#include <vector>

#include "src/core/internal/assert.h"
#include "src/core/internal/stamp.h"
#include "src/field/silhouette_rules.h"
#include "src/gpu/team.cuh"

namespace palpate::inline v0 {
namespace {

// A block makes all levels of a square of level 0, of which the widest level has one pixel. A
// thread has two by two pixels of level 0.
constexpr int kLevels = DepthFieldView::kMaxLevels;
constexpr int kSquare = 1 << (kLevels - 1), kQuads = kSquare / 2, kThreads = kQuads * kQuads;
constexpr int kTile = DepthFieldView::kTileSize;
static_assert(kSquare == 2 * kTile && kThreads == 256);

/// The pixels of the levels from 1 on that belong to a square.
struct SquareLevels {
  TangentPlane pixels[(kThreads * 4 - 1) / 3];

  __device__ static int first(int level) {
    int at = 0;
    for (int k = 1; k < level; ++k) at += (kSquare >> k) * (kSquare >> k);
    return at;
  }
  __device__ TangentPlane& at(int level, int x, int y) {
    return pixels[first(level) + y * (kSquare >> level) + x];
  }
};

/// A square of an image and this thread's place in it.
struct Place {
  int image;
  int square_u, square_v;  ///< number of the square
  int x, y;                ///< of the thread's pixel of level 1 in the square

  __device__ Place(const FieldJob& job)
      : image(static_cast<int>(blockIdx.x) / job.num_squares()),
        square_u(static_cast<int>(blockIdx.x) % job.num_squares() % job.squares_wide),
        square_v(static_cast<int>(blockIdx.x) % job.num_squares() / job.squares_wide),
        x(static_cast<int>(threadIdx.x) % kQuads),
        y(static_cast<int>(threadIdx.x) / kQuads) {}

  /// First column and row of the thread's four pixels.
  __device__ int u() const { return square_u * kSquare + 2 * x; }
  __device__ int v() const { return square_v * kSquare + 2 * y; }
};

__device__ inline TangentPlane* pixel(const FieldJob& job, TangentPlane* planes, int level, int u,
                                      int v) {
  return planes + job.layout.origin(level) + static_cast<std::ptrdiff_t>(v) * job.layout.stride + u;
}

/// Makes the levels 1..top of a square in `out`, from the four pixels that each thread has of level
/// 0. `quad` outside of the image is not looked at.
__device__ void widen_square(const FieldJob& job, const Place& place, const TangentPlane (&quad)[4],
                             int top, Choice choice, TangentPlane* out, SquareLevels& levels) {
  if (top < 1) return;
  const auto store = [&](int level, int x, int y, const TangentPlane& plane) {
    levels.at(level, x, y) = plane;
    const int size = kSquare >> level;
    *pixel(job, out, level, place.square_u * size + x, place.square_v * size + y) = plane;
  };
  const auto inside = [&](int level, int x, int y) {
    const int size = kSquare >> level;
    return place.square_u * size + x < job.layout.levels[level].width &&
           place.square_v * size + y < job.layout.levels[level].height;
  };
  if (inside(1, place.x, place.y)) store(1, place.x, place.y, widened(quad, 1, choice));
  for (int level = 2; level <= top; ++level) {
    __syncthreads();
    const int size = kSquare >> level;
    const int x = static_cast<int>(threadIdx.x) % size, y = static_cast<int>(threadIdx.x) / size;
    if (y >= size || !inside(level, x, y)) continue;  // to the next barrier
    // At an odd end the last one counts twice.
    const int x1 = 2 * x + inside(level - 1, 2 * x + 1, 2 * y);
    const int y1 = 2 * y + inside(level - 1, 2 * x, 2 * y + 1);
    const TangentPlane four[4] = {levels.at(level - 1, 2 * x, 2 * y),
                                  levels.at(level - 1, x1, 2 * y), levels.at(level - 1, 2 * x, y1),
                                  levels.at(level - 1, x1, y1)};
    store(level, x, y, widened(four, level, choice));
  }
}

/// Calls f(index in the quad, u, v) for those of a thread's four pixels that are in the image.
template <class F>
__device__ void for_quad(const FieldJob& job, const Place& place, const F& f) {
  const PyramidLayout::Level& image = job.layout.levels[0];
  for (int k = 0; k < 4; ++k) {
    const int u = place.u() + k % 2, v = place.v() + k / 2;
    if (u < image.width && v < image.height) f(k, u, v);
  }
}

/// At an odd end the last pixel counts twice.
__device__ void complete_quad(const FieldJob& job, const Place& place, TangentPlane (&quad)[4]) {
  if (place.u() + 1 >= job.layout.levels[0].width) quad[1] = quad[0], quad[3] = quad[2];
  if (place.v() + 1 >= job.layout.levels[0].height) quad[2] = quad[0], quad[3] = quad[1];
}

struct TakeScratch {
  SquareLevels levels;
  int has_hole;
};

/// First kernel: the planes of level 0, and what holes are filled with.
__global__ void __launch_bounds__(kThreads)
    take_planes(const __grid_constant__ FieldJob job,
                const __grid_constant__ PointCloudView cloud) {
  auto& shared = gpu::shared_memory<TakeScratch>();
  if (threadIdx.x == 0) shared.has_hole = 0;
  __syncthreads();
  const Place place(job);
  const FieldArrays arrays = job.arrays_of(place.image);
  TangentPlane quad[4];
  bool has_hole = false;
  for_quad(job, place, [&](int k, int u, int v) {
    const std::ptrdiff_t i =
        place.image * job.points_apart + static_cast<std::ptrdiff_t>(v) * cloud.width + u;
    quad[k] = job.given != nullptr
                  ? job.given[i]
                  : tangent_plane<TangentPlane>(cloud.x[i], cloud.y[i], cloud.z[i], cloud.nx[i],
                                                cloud.ny[i], cloud.nz[i]);
    has_hole = has_hole || !quad[k].is_surface();
    *pixel(job, arrays.planes, 0, u, v) = quad[k];
  });
  if (has_hole) shared.has_hole = 1;
  complete_quad(job, place, quad);
  widen_square(job, place, quad, job.num_filled, Choice::nearest, arrays.nearest, shared.levels);
  __syncthreads();
  if (threadIdx.x == 0) job.has_hole[blockIdx.x] = shared.has_hole;
}

/// What the holes of a square are filled with: of each level the pixels from
/// `start` on, counted from the square's first one: all that the level before reads.
struct Surroundings {
  static constexpr int kNum = 18 * 18 + 12 * 12 + 8 * 8 + 6 * 6 + 5 * 5;

  TangentPlane pixels[kNum];

  __device__ static int size(int level) {
    return level == 1 ? 18 : (level == 2 ? 12 : (level == 3 ? 8 : (level == 4 ? 6 : 5)));
  }
  __device__ static int start(int level) { return level == 1 ? -1 : -2; }
  __device__ static int first(int level) {
    int at = 0;
    for (int k = 1; k < level; ++k) at += size(k) * size(k);
    return at;
  }
  __device__ static int first_u(int level, int square) {
    return square * (kSquare >> level) + start(level);
  }
};

__device__ void fill_quad(const FieldJob& job, const FieldArrays& arrays, const Place& place,
                          TangentPlane (&quad)[4], Surroundings& around) {
  // Calls f(u, v, pixel) for this thread's pixels of a level.
  const auto for_pixels = [&](int level, const auto& f) {
    const int size = Surroundings::size(level);
    const PyramidLayout::Level& image = job.layout.levels[level];
    for (int i = static_cast<int>(threadIdx.x); i < size * size; i += kThreads) {
      const int u = Surroundings::first_u(level, place.square_u) + i % size;
      const int v = Surroundings::first_u(level, place.square_v) + i / size;
      if (u < 0 || v < 0 || u >= image.width || v >= image.height) continue;
      f(u, v, around.pixels[Surroundings::first(level) + i]);
    }
  };
  // What `level` knows about pixel (u, v) of the level before.
  const auto look_up = [&](int level, int u, int v) {
    const PyramidLayout::Level& image = job.layout.levels[level];
    const int u1 = second_nearest(u, image.width), v1 = second_nearest(v, image.height);
    const auto at = [&](int wide_u, int wide_v) {
      return around.pixels[Surroundings::first(level) +
                           (wide_v - Surroundings::first_u(level, place.square_v)) *
                               Surroundings::size(level) +
                           wide_u - Surroundings::first_u(level, place.square_u)];
    };
    const TangentPlane four[4] = {at(u / 2, v / 2), at(u1, v / 2), at(u / 2, v1), at(u1, v1)};
    return interpolated(four, level);
  };
  for (int level = 1; level <= job.num_filled; ++level) {
    for_pixels(level, [&](int u, int v, TangentPlane& plane) {
      plane = *pixel(job, arrays.nearest, level, u, v);
    });
  }
  __syncthreads();
  for (int level = job.num_filled - 1; level >= 1; --level) {
    for_pixels(level, [&](int u, int v, TangentPlane& plane) {
      if (!plane.is_surface()) plane = look_up(level + 1, u, v);
    });
    __syncthreads();
  }
  for_quad(job, place, [&](int k, int u, int v) {
    if (quad[k].is_surface()) return;
    quad[k] = look_up(1, u, v);
    *pixel(job, arrays.planes, 0, u, v) = quad[k];
  });
}

constexpr int kWarps = kThreads / gpu::kWarpSize;

struct WidenScratch {
  SquareLevels levels;
  Surroundings around;
  DepthTile tiles[kWarps][2];  // of each warp's pixels in the left and the right tile
};

/// Second kernel: fills holes, makes tiles and wider levels.
__global__ void __launch_bounds__(kThreads) widen_planes(const __grid_constant__ FieldJob job) {
  auto& shared = gpu::shared_memory<WidenScratch>();
  const Place place(job);
  const FieldArrays arrays = job.arrays_of(place.image);
  TangentPlane quad[4];
  for_quad(job, place, [&](int k, int u, int v) { quad[k] = *pixel(job, arrays.planes, 0, u, v); });
  if (job.num_filled > 0 && job.has_hole[blockIdx.x]) {
    fill_quad(job, arrays, place, quad, shared.around);
  }
  if (job.unknown == UnknownSpace::blocked && job.has_hole[blockIdx.x]) {
    for_quad(job, place, [&](int k, int u, int v) {
      quad[k] = completed(quad[k], job.unknown);
      *pixel(job, arrays.planes, 0, u, v) = quad[k];
    });
  }

  // A warp has two rows of 16 threads: the left half of each is in one tile.
  DepthTile tile = empty_tile<DepthTile>();
  for_quad(job, place, [&](int k, int, int) { tile = join(tile, tile_of<DepthTile>(quad[k])); });
  for (int step = 1; step < gpu::kWarpSize; step *= 2) {
    if (step == kTile / 2) continue;
    tile = join(tile, {__shfl_xor_sync(gpu::kWholeWarp, tile.nearest, step),
                       __shfl_xor_sync(gpu::kWholeWarp, tile.min_slope, step)});
  }
  const int lane = gpu::lane_id();
  if (lane % 8 == 0 && lane < 16) shared.tiles[gpu::warp_id()][lane / 8] = tile;

  complete_quad(job, place, quad);
  widen_square(job, place, quad, job.layout.num_levels - 1, Choice::majority, arrays.planes,
               shared.levels);
  __syncthreads();
  if (threadIdx.x < 4) {
    const int side = static_cast<int>(threadIdx.x) % 2, row = static_cast<int>(threadIdx.x) / 2;
    DepthTile all = empty_tile<DepthTile>();
    for (int k = 0; k < kWarps / 2; ++k) all = join(all, shared.tiles[row * kWarps / 2 + k][side]);
    const int u = 2 * place.square_u + side, v = 2 * place.square_v + row;
    const int tiles_wide = (job.layout.levels[0].width + kTile - 1) / kTile;
    const int tiles_high = (job.layout.levels[0].height + kTile - 1) / kTile;
    if (u < tiles_wide && v < tiles_high) arrays.tiles[v * tiles_wide + u] = all;
  }
}

// A block looks for the silhouettes of a tile of pixels and of those just around it.
constexpr int kRimWide = 32, kRimHigh = 16;
constexpr int kReach = DepthFieldLevel::kSilhouetteReach, kHalo = kReach + 1;

struct RimScratch {
  static constexpr int kWide = kRimWide + 2 * kHalo, kHigh = kRimHigh + 2 * kHalo;

  one_lane::RulePlane planes[kHigh][kWide];
  /// The nearest silhouettes of each pixel's own row: as SilhouetteScratch::found.
  float found[kHigh][kRimWide + 2][6];
  std::uint8_t has_any[kRimHigh + 2][kRimWide + 2];
  int has_edge;
};

/// What all levels are measured with.
struct RimLevels {
  one_lane::RuleLevel levels[kLevels];
};

__device__ one_lane::PixelSilhouettes load_found(const float (&found)[6]) {
  one_lane::PixelSilhouettes both;
  one_lane::NearestSilhouette* const of[2] = {&both.exit, &both.occluder};
  for (int k = 0; k < 2; ++k) {
    of[k]->du = found[3 * k];
    if (of[k]->du != 0.0f) of[k]->squared = of[k]->du * of[k]->du;
    of[k]->other = {found[3 * k + 1], found[3 * k + 2]};
  }
  return both;
}

/// Third kernel: borders and silhouettes.
__global__ void __launch_bounds__(kThreads)
    find_silhouettes(const __grid_constant__ FieldJob job, const __grid_constant__ RimLevels rims) {
  auto& shared = gpu::shared_memory<RimScratch>();
  const int block = static_cast<int>(blockIdx.x) % job.num_rim_blocks();
  const int thread = static_cast<int>(threadIdx.x);
  const FieldArrays arrays = job.arrays_of(static_cast<int>(blockIdx.x) / job.num_rim_blocks());
  int level = 0;
  while (block >= job.first_rim_block[level + 1]) ++level;
  constexpr int kBorder = DepthFieldLevel::kBorder;
  const int width = job.layout.levels[level].width, height = job.layout.levels[level].height;
  const int blocks_wide = (width + 2 * kBorder + kRimWide - 1) / kRimWide;
  const int number = block - job.first_rim_block[level];
  const int first_u = number % blocks_wide * kRimWide - kBorder;
  const int first_v = number / blocks_wide * kRimHigh - kBorder;
  const one_lane::RuleLevel& rules = rims.levels[level];

  // Outside of the image: nothing, what blocks the view, or the surface of the outermost pixels
  // going on. The border in memory is not read here.
  const auto plane_at = [&](int u, int v) {
    const int inner_u = u < 0 ? 0 : (u >= width ? width - 1 : u);
    const int inner_v = v < 0 ? 0 : (v >= height ? height - 1 : v);
    if (job.unknown != UnknownSpace::solid && (inner_u != u || inner_v != v)) {
      return completed({}, job.unknown);
    }
    return *pixel(job, arrays.planes, level, inner_u, inner_v);
  };
  if (thread == 0) shared.has_edge = 0;
  for (int i = thread; i < RimScratch::kWide * RimScratch::kHigh; i += kThreads) {
    const int x = i % RimScratch::kWide, y = i / RimScratch::kWide;
    const int u = first_u + x - kHalo, v = first_v + y - kHalo;
    const TangentPlane plane = plane_at(u, v);
    shared.planes[y][x] = {plane.offset, plane.slope};
    const bool is_mine = x >= kHalo && x < kHalo + kRimWide && y >= kHalo && y < kHalo + kRimHigh &&
                         u < width + kBorder && v < height + kBorder;
    if (is_mine && (u < 0 || u >= width || v < 0 || v >= height)) {
      *pixel(job, arrays.planes, level, u, v) = plane;
    }
  }
  __syncthreads();
  const auto own_at = [&](int x, int y) -> const one_lane::RulePlane& {
    return shared.planes[y + kHalo][x + kHalo];
  };
  const auto is_edge = [&](const one_lane::RulePlane& a, const one_lane::RulePlane& b, float size) {
    const bool a_is_near = one_lane::is_nearer(a, b);
    return one_lane::ends_between(a_is_near ? a : b, a_is_near ? b : a, size);
  };
  bool has_edge = false;
  for (int i = thread; i < RimScratch::kWide * RimScratch::kHigh; i += kThreads) {
    const int x = i % RimScratch::kWide, y = i / RimScratch::kWide;
    const one_lane::RulePlane& own = shared.planes[y][x];
    if (x + 1 < RimScratch::kWide) {
      has_edge |= is_edge(own, shared.planes[y][x + 1], rules.width_u);
    }
    if (y + 1 < RimScratch::kHigh) {
      has_edge |= is_edge(own, shared.planes[y + 1][x], rules.width_v);
    }
  }
  if (has_edge) shared.has_edge = 1;
  __syncthreads();
  const bool is_active = shared.has_edge != 0;
  if (is_active) {
    for (int i = thread; i < RimScratch::kHigh * (kRimWide + 2); i += kThreads) {
      const int x = i % (kRimWide + 2) - 1, y = i / (kRimWide + 2) - kHalo;
      const one_lane::RulePlane& own = own_at(x, y);
      one_lane::PixelSilhouettes found;
      for (int n = 1; n <= kReach; ++n) {
        const float away = static_cast<float>(n) - 0.5f;
        one_lane::take_edge(own, own_at(x + n - 1, y), own_at(x + n, y), away, 0.0f, rules.width_u,
                            found);
        one_lane::take_edge(own, own_at(x - n, y), own_at(x - n + 1, y), -away, 0.0f, rules.width_u,
                            found);
      }
      float(&to)[6] = shared.found[y + kHalo][x + 1];
      to[0] = found.exit.du, to[1] = found.exit.other.offset, to[2] = found.exit.other.slope;
      to[3] = found.occluder.du, to[4] = found.occluder.other.offset;
      to[5] = found.occluder.other.slope;
    }
    __syncthreads();
    for (int i = thread; i < (kRimHigh + 2) * (kRimWide + 2); i += kThreads) {
      const int x = i % (kRimWide + 2) - 1, y = i / (kRimWide + 2) - 1;
      const int u = first_u + x, v = first_v + y;
      const one_lane::RulePlane& own = own_at(x, y);
      one_lane::PixelSilhouettes found = load_found(shared.found[y + kHalo][x + 1]);
      for (int n = 1; n <= kReach; ++n) {
        const float away = static_cast<float>(n);
        one_lane::take_edge(own, own_at(x, y + n - 1), own_at(x, y + n), 0.0f, away - 0.5f,
                            rules.width_v, found);
        one_lane::take_edge(own, own_at(x, y - n), own_at(x, y - n + 1), 0.0f, 0.5f - away,
                            rules.width_v, found);
        for (const int row : {n, -n}) {
          one_lane::take_found(own, load_found(shared.found[y + row + kHalo][x + 1]),
                               static_cast<float>(row), rules.width_u, found);
        }
      }
      const float at_x = rules.first_u + static_cast<float>(u) * rules.width_u;
      const float at_y = rules.first_v + static_cast<float>(v) * rules.width_v;
      const bool has_exit = one_lane::is_any(found.exit);
      const bool has_occluder = one_lane::is_any(found.occluder);
      const bool is_requested = u >= -kSilhouetteBorder && u <= width + kSilhouetteBorder &&
                                v >= -kSilhouetteBorder && v <= height + kSilhouetteBorder;
      shared.has_any[y + 1][x + 1] = is_requested && (has_exit || has_occluder);
      if (!is_requested) continue;
      // Those just around the tile are written by two blocks, the same by both.
      Silhouette* const to =
          arrays.silhouettes +
          2 * (job.layout.origin(level) + static_cast<std::ptrdiff_t>(v) * job.layout.stride + u);
      to[0] = {has_exit ? -one_lane::side_of(found.exit, at_x, at_y, rules) : 0.0f,
               found.exit.other.offset, found.exit.other.slope, 0};
      to[1] = {has_occluder ? one_lane::side_of(found.occluder, at_x, at_y, rules) : 0.0f,
               found.occluder.other.offset, found.occluder.other.slope, 0};
    }
    __syncthreads();
  }
  for (int i = thread; i < kRimWide * kRimHigh; i += kThreads) {
    const int x = i % kRimWide, y = i / kRimWide, u = first_u + x, v = first_v + y;
    if (u >= width + kBorder || v >= height + kBorder) continue;
    bool any = false;
    if (is_active && u > -kSilhouetteBorder && u < width + kSilhouetteBorder &&
        v > -kSilhouetteBorder && v < height + kSilhouetteBorder) {
      for (int k = 0; k < 9; ++k) any |= shared.has_any[y + k / 3][x + k % 3] != 0;
    }
    arrays.near_silhouette[job.layout.origin(level) +
                           static_cast<std::ptrdiff_t>(v) * job.layout.stride + u] = any;
  }
}

}  // namespace

Result<DepthFieldCuda> DepthFieldCuda::create(int width, int height,
                                              const DepthFieldOptions& options, int gpu,
                                              int num_fields, int num_at_once) {
  const auto layout = pyramid_layout(width, height, options);
  if (!layout) return layout.error();
  FieldJob job;
  job.layout = *layout;
  job.num_filled = layout->num_filled(options);
  job.unknown = options.unknown;
  const auto blocks_over = [](int size, int part) { return (size + part - 1) / part; };
  job.squares_wide = blocks_over(width, kSquare);
  job.squares_high = blocks_over(height, kSquare);
  constexpr int kBorders = 2 * DepthFieldLevel::kBorder;
  for (int level = 0; level < layout->num_levels; ++level) {
    const auto& image = layout->levels[level];
    job.first_rim_block[level + 1] =
        job.first_rim_block[level] + blocks_over(image.width + kBorders, kRimWide) *
                                         blocks_over(image.height + kBorders, kRimHigh);
  }
  // Any field's arrays are as well aligned as the first one's.
  constexpr std::size_t kAligned = 64;
  const std::size_t apart = (layout->num_pixels() + kAligned - 1) / kAligned * kAligned;
  job.pixels_apart = static_cast<std::ptrdiff_t>(apart);
  job.tiles_apart = static_cast<std::ptrdiff_t>(layout->num_tiles());
  const auto more = apart * static_cast<std::size_t>(num_fields - 1);
  const auto more_at_once = apart * static_cast<std::size_t>(num_at_once - 1);
  gpu::Memory memory(gpu);
  job.arrays = {memory.take<TangentPlane>(more + layout->num_planes()),
                memory.take<TangentPlane>(more_at_once + layout->num_planes()),
                memory.take<Silhouette>(2 * (more + layout->num_pixels())),
                memory.take<std::uint8_t>(more + layout->num_bytes()),
                memory.take<DepthTile>(static_cast<std::size_t>(num_fields) * layout->num_tiles())};
  job.has_hole = memory.take<int>(static_cast<std::size_t>(num_at_once) *
                                  static_cast<std::size_t>(job.num_squares()));
  if (!memory.status()) return memory.status().error();
  return DepthFieldCuda(std::move(memory), job, options);
}

std::size_t DepthFieldCuda::num_bytes(const PyramidLayout& layout) {
  return layout.num_pixels() * (sizeof(TangentPlane) + 2 * sizeof(Silhouette) + 1) +
         layout.num_tiles() * sizeof(DepthTile);
}

void DepthFieldCuda::enqueue(const PointCloudView& cloud, gpu::Stream& stream) {
  enqueue(cloud, 0, 0, 1, stream);
}

void DepthFieldCuda::enqueue(const TangentPlane* planes, const PointCloudView& camera,
                             gpu::Stream& stream) {
  FieldJob job = job_;
  job.given = planes;
  enqueue(job, camera, 1, stream);
}

void DepthFieldCuda::enqueue(const PointCloudView& cloud, std::ptrdiff_t points_apart, int first,
                             int num, gpu::Stream& stream) {
  FieldJob job = job_;
  job.points_apart = points_apart;
  job.arrays = job_.arrays_of(first);
  job.arrays.nearest = job_.arrays.nearest;
  enqueue(job, cloud, num, stream);
}

void DepthFieldCuda::enqueue(FieldJob job, const PointCloudView& cloud, int num,
                             gpu::Stream& stream) {
  PALPATE_ASSERT(cloud.pinhole && cloud.gpu == memory_.gpu() &&
                 cloud.width == job_.layout.levels[0].width &&
                 cloud.height == job_.layout.levels[0].height);
  const int squares = num * job.num_squares();
  gpu::launch(stream, {.blocks = squares, .threads = kThreads, .shared_bytes = sizeof(TakeScratch)},
              take_planes, job, cloud);
  gpu::launch(stream,
              {.blocks = squares, .threads = kThreads, .shared_bytes = sizeof(WidenScratch)},
              widen_planes, job);
  RimLevels rims{};
  for (int level = 0; level < job.layout.num_levels; ++level) {
    rims.levels[level] = one_lane::rule_level(cloud.intrinsics, level);
  }
  gpu::launch(stream,
              {.blocks = num * job.num_rim_blocks(),
               .threads = kThreads,
               .shared_bytes = sizeof(RimScratch)},
              find_silhouettes, job, rims);
  const FieldArrays& arrays = job_.arrays;
  view_ = job.layout.view(arrays.planes, arrays.silhouettes, arrays.near_silhouette, arrays.tiles,
                          options_);
  view_.intrinsics = cloud.intrinsics;
  view_.gpu = memory_.gpu();
  view_.stamp = next_stamp();
}

}  // namespace palpate::inline v0
