#include "src/contact/field/field_contact_cuda.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "src/contact/cuda/finish_measure.cuh"
#include "src/contact/field/field_element.h"
#include "src/gpu/team.cuh"

namespace palpate {
namespace {

constexpr int kThreads = 256;
constexpr int kStiffnessThreads = 128, kStiffnessTerms = StiffnessSums::kNum;
static_assert(SphereClusters::kSize == gpu::kWarpSize);

// A field as the kernel looks at it: what all its levels share, and what differs.
struct FieldLook {
  const float* planes = nullptr;  // of level 0; the other levels follow
  const Silhouette* silhouettes = nullptr;
  const std::uint8_t* near_silhouette = nullptr;
  std::int32_t start[DepthFieldView::kMaxLevels] = {};  // pixel (0, 0) of each level
  std::int32_t stride = 0, last_level = -1;
  float width = 0, height = 0, thickness = 0;
  const DepthTile* tiles = nullptr;
  std::int32_t tiles_wide = 0, tiles_high = 0;
  FieldFrame frame;
  float weight = 0;
};

FieldLook look_of(const DepthFieldView& view, const FieldFrame& frame, double weight) {
  FieldLook look;
  look.frame = frame;
  if (view.num_levels == 0) return look;
  const DepthFieldLevel& finest = view.levels[0];
  look.planes = finest.planes;
  look.silhouettes = finest.silhouettes;
  look.near_silhouette = finest.near_silhouette;
  for (int k = 0; k < view.num_levels; ++k) {
    look.start[k] =
        static_cast<std::int32_t>(view.levels[k].near_silhouette - finest.near_silhouette);
  }
  look.stride = finest.stride;
  look.last_level = view.num_levels - 1;
  look.width = static_cast<float>(finest.width);
  look.height = static_cast<float>(finest.height);
  look.thickness = view.thickness;
  look.tiles = view.tiles;
  look.tiles_wide = view.tiles_wide;
  look.tiles_high = view.tiles_high;
  look.weight = static_cast<float>(weight);
  return look;
}

// The argument of the kernel.
template <int kNumFields>
struct FieldQuery {
  ElementsView elements;
  bool skips_clusters;  // those in front: pays if warps have several
  FieldLook fields[kNumFields];
};

// Sums of one thread, which has few elements.
struct FieldShare {
  float volume = 0, potential = 0;
  float force[3] = {}, torque[3] = {};
  int num_boundary = 0, num_inside = 0;
};

__device__ float scale_of(int level) { return __int_as_float((127 - level) << 23); }  // 2^-level

__device__ DepthFieldLevel level_of(const FieldLook& field, int number) {
  const int start = field.start[number];
  DepthFieldLevel level;
  level.planes = field.planes + 2 * std::ptrdiff_t{start};
  level.silhouettes = field.silhouettes + 2 * std::ptrdiff_t{start};
  level.near_silhouette = field.near_silhouette + start;
  level.stride = field.stride;
  level.scale = scale_of(number);
  level.last_u = field.width * level.scale + 5.0f;
  level.last_v = field.height * level.scale + 5.0f;
  return level;
}

// Level and blend for a footprint = m 2^e with m in [1, 2), as the vector kernel chooses them:
// between levels e and e + 1.
__device__ LevelChoice<float> choose(float footprint, int last_level, float inverse_depth) {
  const int bits = __float_as_int(footprint < 1.0f ? 1.0f : footprint);
  const int exponent = (bits >> 23) - 127;
  const float m = __int_as_float((bits & 0x7fffff) | 0x3f800000);
  const Sloped<float> step = smooth_step((m - 1.0f) * (1.0f / (kBlendEnd - 1)));
  LevelChoice<float> choice;
  choice.level = last_level;
  if (exponent >= last_level) return choice;
  const bool is_next = step.value >= 1.0f;
  choice.level = exponent + is_next;
  if (!is_next) {
    choice.blend = {step.value, step.slope * m * inverse_depth * (-1.0f / (kBlendEnd - 1))};
  }
  return choice;
}

// What a sphere of this radius is told by the one or two levels of its size.
__device__ ImageGradient<float> ask_field(const FieldLook& field, float u, float v, float depth,
                                          float inverse_depth, float radius) {
  const LevelChoice<float> choice =
      choose(kFootprint * radius * field.frame.fx * inverse_depth, field.last_level, inverse_depth);
  ImageGradient<float> g{};
  Sloped<float> blend{1, 0};
#pragma unroll 1
  for (int number = choice.level;; ++number) {
    const DepthFieldLevel level = level_of(field, number);
    const PixelSpot<float> spot = spot_at(level, u, v);
    Curved<float> values[3][3];
    values_around(level, spot.pixel, depth, field.thickness, field.frame.fx, values);
    g = mixed(g, gradient_of(values, spot.s, spot.t, level.scale), blend.value, blend.slope);
    if (number > choice.level || !(choice.blend.value > 0)) break;
    blend = choice.blend;
  }
  return g;
}

// What an element at `lever` from C is told by one field.
__device__ void add_element(const FieldLook& field, float radius, float factor, bool is_counted,
                            const float (&lever)[3], const float (&p)[3], FieldShare& sum) {
  const float depth = p[2];
  if (!(depth > kLeastDepth)) return;
  const float inverse_depth = 1.0f / depth;
  const float from_u = field.frame.fx * p[0] * inverse_depth,
              from_v = field.frame.fy * p[1] * inverse_depth;
  const float u = from_u + field.frame.cx, v = from_v + field.frame.cy;
  ImageGradient<float> g{};
  float asked = radius;
#pragma unroll 1
  for (int step = 0;; ++step) {
    const ImageGradient<float> told = ask_field(field, u, v, depth, inverse_depth, asked);
    if (step > 0) {
      const float finer = asked * (1.0f / kDeepGrowth);
      g = deepened(g, told, g.phi, told.phi, finer);
    } else {
      g = told;
    }
    if (step == kMostDeepSteps || !(g.phi < -deep_limit(asked))) break;
    asked *= kDeepGrowth;
  }
  if (!(g.phi < radius)) return;
  const CutBall<float> cut = cut_ball(radius, factor, g.phi);
  const Gradient3<float> gradient =
      to_space(g, from_u, from_v, inverse_depth, field.frame.fx, field.frame.fy);
  const Gradient3<float> n = bounded(
      gradient, sqrtf(gradient.x * gradient.x + gradient.y * gradient.y + gradient.z * gradient.z));
  const float force[3] = {cut.volume * n.x, cut.volume * n.y, cut.volume * n.z};
  sum.volume += cut.volume;
  sum.potential += cut.potential;
  for (int a = 0; a < 3; ++a) {
    const int b = (a + 1) % 3, c = (a + 2) % 3;
    sum.force[a] += force[a];
    sum.torque[a] += lever[b] * force[c] - lever[c] * force[b];
  }
  if (!is_counted) return;
  ++(g.phi <= -radius ? sum.num_inside : sum.num_boundary);
}

// Is no element of a cluster near any surface? Every lane looks at some of the tiles.
template <int kNumFields>
__device__ bool is_cluster_in_front(const FieldQuery<kNumFields>& query, int cluster) {
  const float radius = query.elements.largest_radius[cluster];
  for (const FieldLook& field : query.fields) {
    if (field.last_level < 0) continue;
    const BallWindow window = window_of(field.frame, query.elements.clusters[cluster], radius,
                                        field.tiles_wide, field.tiles_high);
    if (!window.is_before_camera()) {
      if (window.farthest < kLeastDepth) continue;
      return false;
    }
    const int wide = window.right - window.left + 1;
    const int num = wide * (window.bottom - window.top + 1);
    bool in_front = true;
    for (int i = gpu::lane_id(); i < num && in_front; i += gpu::kWarpSize) {
      const DepthTile tile =
          field.tiles[(window.top + i / wide) * field.tiles_wide + window.left + i % wide];
      in_front = is_behind(tile, window.farthest, radius);
    }
    if (!__all_sync(gpu::kWholeWarp, in_front)) return false;
  }
  return true;
}

// Three blocks on a multiprocessor leave each thread the registers that it needs.
template <int kNumFields>
__global__ void __launch_bounds__(kThreads, 3)
    measure_elements(const __grid_constant__ FieldQuery<kNumFields> query,
                     const __grid_constant__ MeasureOutput out) {
  const ElementsView& elements = query.elements;
  FieldShare share;
  const int num_warps = gpu::grid_threads() / gpu::kWarpSize;
  for (int cluster = gpu::grid_thread() / gpu::kWarpSize; cluster < elements.num_clusters;
       cluster += num_warps) {
    if (query.skips_clusters && is_cluster_in_front(query, cluster)) continue;
    const int place = cluster * SphereClusters::kSize + gpu::lane_id();
    const ElementBall ball = elements.balls[place];
    const float packed = elements.factors[place];
    const float factor = fabsf(packed);
    const bool is_counted = __float_as_int(packed) >= 0;
    float lever[3], p[3];
    const FieldFrame& frame = query.fields[0].frame;  // the pose is the same in all
    for (int row = 0; row < 3; ++row) {
      const float(&r)[3] = frame.R_WT[row];
      lever[row] = r[0] * ball.x + r[1] * ball.y + r[2] * ball.z;
      p[row] = lever[row] + frame.p_WC[row];
    }
#pragma unroll
    for (int k = 0; k < kNumFields; ++k) {
      const FieldLook& field = query.fields[k];
      if (kNumFields > 1 && field.last_level < 0) continue;
      const float weighted = kNumFields > 1 ? factor * field.weight : factor;
      add_element(field, ball.radius, weighted, is_counted && k == kNumFields - 1, lever, p, share);
    }
  }
  MeasureTerms mine;
  mine.volume = share.volume;
  mine.potential = share.potential;
  for (int axis = 0; axis < 3; ++axis) {
    mine.force[axis] = share.force[axis];
    mine.torque[axis] = share.torque[axis];
  }
  mine.num_boundary = share.num_boundary;
  mine.num_inside = share.num_inside;
  finish_measure(out, mine, gpu::shared_memory<FinishScratch>());
}

// Shared memory of the kernel below.
struct StiffnessScratch {
  double terms[kStiffnessThreads / gpu::kWarpSize * kStiffnessTerms];
  int is_last;
};

__global__ void __launch_bounds__(kStiffnessThreads)
    add_stiffnesses(const __grid_constant__ FieldQuestion question, const Mat3d R_WT,
                    const Vec3d p_WC, const ElementsView elements, double* partials,
                    unsigned long long* count, double* sums) {
  auto& shared = gpu::shared_memory<StiffnessScratch>();
  StiffnessSums sum;
  const int num_places = elements.num_clusters * SphereClusters::kSize;
  for (int place = gpu::grid_thread(); place < num_places; place += gpu::grid_threads()) {
    const ElementBall ball = elements.balls[place];
    const double factor = fabsf(elements.factors[place]);
    const Vec3d lever = R_WT * to_double(Vec3f{ball.x, ball.y, ball.z});
    for (int k = 0; k < question.num_fields; ++k) {
      if (question.fields[k].num_levels == 0) continue;
      sum.add(
          stiffness_of(question.fields[k], p_WC, lever, ball.radius, question.weights[k] * factor));
    }
  }
  double* const terms = sum.numbers;
  gpu::block_sum(terms, kStiffnessTerms, shared.terms);
  if (threadIdx.x == 0) {
    for (int i = 0; i < kStiffnessTerms; ++i) partials[blockIdx.x * kStiffnessTerms + i] = terms[i];
  }
  if (!gpu::is_last_block(count, &shared.is_last) || threadIdx.x >= kStiffnessTerms) return;
  double total = 0;
  for (unsigned block = 0; block < gridDim.x; ++block) {
    total += partials[block * kStiffnessTerms + threadIdx.x];
  }
  sums[threadIdx.x] = total;
}

/// State of a sphere and the plane that it is cut by, in T.
struct SphereCut {
  SphereState state = SphereState::outside;
  Plane<float> plane;
};
__device__ SphereCut cut_of(const DepthFieldView& field, const Pose& X_WT, const Sphere& sphere) {
  const double radius = sphere.radius;
  const Vec3d c_T = to_double(sphere.centre);
  const FieldSample<double> at = sample_field(field, X_WT * c_T, radius);
  if (at.phi >= radius) return {};
  const Vec3d n_T = normalized(rotate(conjugate(X_WT.rotation), at.gradient));
  return {at.phi > -radius ? SphereState::boundary : SphereState::inside,
          {to_float(n_T), static_cast<float>(dot(n_T, c_T) - at.phi)}};
}

__global__ void describe_spheres(const __grid_constant__ DepthFieldView field, const Pose X_WT,
                                 const Sphere* spheres, int num, SphereState* states,
                                 Plane<float>* planes) {
  for (int id = gpu::grid_thread(); id < num; id += gpu::grid_threads()) {
    const SphereCut cut = cut_of(field, X_WT, spheres[id]);
    states[id] = cut.state;
    planes[id] = cut.plane;
  }
}

// Blocks for so many threads, but not more than run at once.
int blocks_for(int num_threads, int threads, int most) {
  return std::max(1, std::min((num_threads + threads - 1) / threads, most));
}

template <class Kernel>
int most_blocks(int gpu, Kernel* kernel, int threads, std::size_t shared_bytes) {
  return gpu::resident_blocks(gpu, reinterpret_cast<const void*>(kernel), threads, shared_bytes);
}

int measure_blocks(int gpu, int num_clusters) {
  return blocks_for(
      num_clusters * SphereClusters::kSize, kThreads,
      std::min(most_blocks(gpu, measure_elements<1>, kThreads, sizeof(FinishScratch)),
               most_blocks(gpu, measure_elements<2>, kThreads, sizeof(FinishScratch))));
}

Penetration failed() {
  Penetration result;
  result.status = StepStatus::backend_failed;
  return result;
}

}  // namespace

FieldContactCuda::FieldContactCuda(const Tool& tool, int gpu)
    : centre_of_mass_(tool.sphere_mass().centre_of_mass),
      num_spheres_(static_cast<int>(tool.spheres().size())),
      memory_(gpu),
      stream_(gpu, gpu::Priority::high),
      fields_(gpu),
      own_(take(tool, SphereVolumes::own)),
      represented_(take(tool, SphereVolumes::represented)),
      answers_(gpu, measure_blocks(gpu, std::max(own_.elements.num_clusters,
                                                 represented_.elements.num_clusters))),
      stiffness_blocks_(blocks_for(
          own_.elements.num_clusters * SphereClusters::kSize, kStiffnessThreads,
          most_blocks(gpu, add_stiffnesses, kStiffnessThreads, sizeof(StiffnessScratch)))),
      stiffness_partials_(
          memory_.take<double>(static_cast<std::size_t>(kStiffnessTerms * stiffness_blocks_))),
      stiffness_sums_(memory_.take_pinned<double>(kStiffnessTerms)),
      stiffness_count_(memory_.take<unsigned long long>(1)),
      states_(memory_.take<SphereState>(tool.spheres().size())),
      planes_(memory_.take<Plane<float>>(tool.spheres().size())) {}

FeltTool FieldContactCuda::take(const Tool& tool, SphereVolumes volumes) {
  const FieldElements elements(tool, volumes);
  const SphereClusters& c = elements.clusters;
  std::vector<ElementBall> balls(c.x.size());
  std::vector<float> factors(c.x.size());
  for (std::size_t place = 0; place < balls.size(); ++place) {
    balls[place] = {c.x[place], c.y[place], c.z[place], elements.radius[place]};
    const float factor = elements.factor[place];
    factors[place] = elements.counted[place] > 0 ? factor : -factor;
  }
  std::vector<Sphere> spheres(tool.spheres().size());
  for (std::size_t id = 0; id < spheres.size(); ++id) spheres[id] = felt_ball(tool, id, volumes);
  return {{memory_.copy_of(balls), memory_.copy_of(factors), memory_.copy_of(c.clusters),
           memory_.copy_of(elements.largest_radius), c.num_clusters()},
          memory_.copy_of(spheres)};
}

const Status& FieldContactCuda::status() const {
  for (const Status* status : {&memory_.status(), &answers_.status()}) {
    if (!*status) return *status;
  }
  return stream_.status();
}

Penetration FieldContactCuda::measure(const Pose& X_WT, SphereVolumes volumes) noexcept {
  last_.fields[0] = fields_.on_gpu(field_, stream_);
  last_.weights[0] = 1;
  last_.num_fields = 1;
  last_.X_WT = X_WT;
  last_.volumes = volumes;
  return ask<1>();
}

Penetration FieldContactCuda::measure(const Pose& X_WT, SphereVolumes volumes,
                                      const DepthFieldView& from, const DepthFieldView& to,
                                      double t) noexcept {
  last_.fields[0] = fields_.on_gpu(from, stream_);
  last_.fields[1] = fields_.on_gpu(to, stream_);
  last_.weights[0] = 1 - t;
  last_.weights[1] = t;
  last_.num_fields = 2;
  last_.X_WT = X_WT;
  last_.volumes = volumes;
  return ask<2>();
}

template <int kNumFields>
Penetration FieldContactCuda::ask() noexcept {
  if (!status()) return failed();
  FieldQuery<kNumFields> query;
  int num_missing = 0;
  for (int k = 0; k < kNumFields; ++k) {
    const DepthFieldView& field = last_.fields[k];
    const FieldFrame frame = frame_of(field.intrinsics, last_.X_WT, centre_of_mass_);
    query.fields[k] = look_of(field, frame, last_.weights[k]);
    num_missing += field.num_levels == 0;
  }
  Penetration result;
  if (num_missing > 0) result.status = StepStatus::no_surface;
  if (num_missing == kNumFields) return result;
  query.elements = felt_tool().elements;
  const int num_warps = answers_.num_blocks() * kThreads / gpu::kWarpSize;
  query.skips_clusters = query.elements.num_clusters > num_warps;
  gpu::launch(
      stream_,
      {.blocks = answers_.num_blocks(), .threads = kThreads, .shared_bytes = sizeof(FinishScratch)},
      measure_elements<kNumFields>, query, answers_.next());
  if (!answers_.await(stream_)) return failed();
  const ContactStatus status = result.status;
  result = answers_.answer().penetration();
  result.status |= status;
  return result;
}

Stiffness FieldContactCuda::stiffness() noexcept {
  if (!status() || last_.num_fields == 0) return {};
  gpu::launch(stream_,
              {.blocks = stiffness_blocks_,
               .threads = kStiffnessThreads,
               .shared_bytes = sizeof(StiffnessScratch)},
              add_stiffnesses, last_, rotation_matrix(last_.X_WT.rotation),
              last_.X_WT * centre_of_mass_, felt_tool().elements, stiffness_partials_,
              stiffness_count_, stiffness_sums_);
  if (!stream_.wait()) return {};
  StiffnessSums sum;
  std::copy_n(stiffness_sums_, kStiffnessTerms, sum.numbers);
  return sum.stiffness();
}

void FieldContactCuda::describe(std::span<SphereState> states,
                                std::span<Plane<float>> planes) noexcept {
  std::fill(states.begin(), states.end(), SphereState::outside);
  std::fill(planes.begin(), planes.end(), Plane<float>{});
  if (!status() || last_.num_fields == 0) return;
  const DepthFieldView& field = last_.fields[last_.num_fields - 1];
  if (field.num_levels == 0) return;
  constexpr int kDescribeThreads = 128, kMostBlocks = 1024;
  gpu::launch(stream_,
              {.blocks = blocks_for(num_spheres_, kDescribeThreads, kMostBlocks),
               .threads = kDescribeThreads},
              describe_spheres, field, last_.X_WT, felt_tool().spheres, num_spheres_, states_,
              planes_);
  stream_.copy(states.data(), states_, states.size_bytes());
  stream_.copy(planes.data(), planes_, planes.size_bytes());
  stream_.wait();
}

}  // namespace palpate
