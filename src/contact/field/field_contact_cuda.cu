#include "src/contact/field/field_contact_cuda.h"

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <utility>
#include <vector>

#include "src/contact/blend.h"
#include "src/contact/cuda/finish_measure.cuh"
#include "src/contact/field/field_element.h"
#include "src/gpu/team.cuh"

namespace palpate {
namespace {

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

// Likewise, of StiffnessSums.
struct StiffnessShare {
  float numbers[StiffnessSums::kNum] = {};
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
  const float x = (m - 1.0f) * (1.0f / (kBlendEnd - 1));
  const Sloped<float> step = smooth_step(x);
  LevelChoice<float> choice;
  choice.level = last_level;
  if (exponent >= last_level) return choice;
  const bool is_next = step.value >= 1.0f;
  choice.level = exponent + is_next;
  if (!is_next) {
    const float x_by_z = m * inverse_depth * (-1.0f / (kBlendEnd - 1));
    choice.blend = {step.value, step.slope * x_by_z};
    const float bend = x > 0.0f && x < 1.0f ? 6.0f - 12.0f * x : 0.0f;
    choice.blend_by_zz = x_by_z * (bend * x_by_z - 2.0f * step.slope * inverse_depth);
  }
  return choice;
}

using Gradient = ImageGradient<float>;
using Curvature = ImageCurvature<float>;

__device__ const Gradient& first_of(const Gradient& g) { return g; }
__device__ const Gradient& first_of(const Curvature& c) { return c.first; }

// What the one or two levels of its size answer a sphere of this radius. `Sample` is a Gradient or
// a Curvature.
template <class Sample>
__device__ Sample ask_field(const FieldLook& field, float u, float v, float depth,
                            float inverse_depth, float radius) {
  const LevelChoice<float> choice =
      choose(kFootprint * radius * field.frame.fx * inverse_depth, field.last_level, inverse_depth);
  Sample answer{};
  LevelChoice<float> part;  // of what is asked next
  part.blend = {1, 0};
#pragma unroll 1
  for (int number = choice.level;; ++number) {
    const DepthFieldLevel level = level_of(field, number);
    const PixelSpot<float> spot = spot_at(level, u, v);
    Curved<float> values[3][3];
    values_around(level, spot.pixel, depth, field.thickness, field.frame.fx, values);
    if constexpr (std::is_same_v<Sample, Curvature>) {
      answer = blended(answer, curvature_of(values, spot.s, spot.t, level.scale), part.blend.value,
                       part.blend.slope, part.blend_by_zz);
    } else {
      answer = mixed(answer, gradient_of(values, spot.s, spot.t, level.scale), part.blend.value,
                     part.blend.slope);
    }
    if (number > choice.level || !(choice.blend.value > 0)) break;
    part = choice;
  }
  return answer;
}

// Where an element is, and what it counts.
struct Element {
  float lever[3], p[3];  // from C and from the camera, in W
  float radius, factor;
  bool is_counted;
};

// Adds what an element is answered by one field. `sums` is null if Sample is a Gradient.
template <class Sample>
__device__ void add_element(const FieldLook& field, const Element& e, FieldShare& sum,
                            StiffnessShare* sums) {
  const float depth = e.p[2];
  if (!(depth > kLeastDepth)) return;
  const float inverse_depth = 1.0f / depth;
  const float from_u = field.frame.fx * e.p[0] * inverse_depth,
              from_v = field.frame.fy * e.p[1] * inverse_depth;
  const float u = from_u + field.frame.cx, v = from_v + field.frame.cy;
  if constexpr (std::is_same_v<Sample, Curvature>) {
    // Few elements touch the surface, and only their second derivatives are asked.
    if (!(ask_field<Gradient>(field, u, v, depth, inverse_depth, e.radius).phi < e.radius)) return;
  }
  Sample answer{};
  float asked = e.radius;
#pragma unroll 1
  for (int step = 0;; ++step) {
    const Sample here = ask_field<Sample>(field, u, v, depth, inverse_depth, asked);
    if (step > 0) {
      const float finer = asked * (1.0f / kDeepGrowth);
      answer = deepened(answer, here, first_of(answer).phi, first_of(here).phi, finer);
    } else {
      answer = here;
    }
    if (step == kMostDeepSteps || !(first_of(answer).phi < -deep_limit(asked))) break;
    asked *= kDeepGrowth;
  }
  const Gradient& g = first_of(answer);
  if (!(g.phi < e.radius)) return;
  const CutBall<float> cut = cut_ball(e.radius, e.factor, g.phi);
  const Gradient3<float> gradient =
      to_space(g, from_u, from_v, inverse_depth, field.frame.fx, field.frame.fy);
  const float length =
      sqrtf(gradient.x * gradient.x + gradient.y * gradient.y + gradient.z * gradient.z);
  const Gradient3<float> n = bounded(gradient, length);
  const float force[3] = {cut.volume * n.x, cut.volume * n.y, cut.volume * n.z};
  sum.volume += cut.volume;
  sum.potential += cut.potential;
  for (int a = 0; a < 3; ++a) {
    const int b = (a + 1) % 3, c = (a + 2) % 3;
    sum.force[a] += force[a];
    sum.torque[a] += e.lever[b] * force[c] - e.lever[c] * force[b];
  }
  if (e.is_counted) ++(g.phi <= -e.radius ? sum.num_inside : sum.num_boundary);
  if constexpr (std::is_same_v<Sample, Curvature>) {
    const Symmetric<float> h =
        hessian_in_space(answer, from_u, from_v, inverse_depth, field.frame.fx, field.frame.fy);
    const float squared = e.radius * e.radius - g.phi * g.phi;
    const float disc = e.factor * static_cast<float>(kPi) * (squared > 0.0f ? squared : 0.0f);
    float terms[StiffnessSums::kNum];
    stiffness_terms<float>({e.lever[0], e.lever[1], e.lever[2]}, cut.volume, disc, n,
                           bounded(h, gradient, length), terms);
#pragma unroll
    for (int k = 0; k < StiffnessSums::kNum; ++k) sums->numbers[k] += terms[k];
  }
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

// What a kernel has for a block.
template <class Sample>
constexpr int kThreadsOf = std::is_same_v<Sample, Curvature> ? 128 : 256;
template <class Sample>
constexpr std::size_t kSharedBytes = std::is_same_v<Sample, Curvature>
                                         ? sizeof(FinishStiffnessScratch)
                                         : sizeof(FinishScratch);

// Three blocks of 256 threads on a multiprocessor leave each thread the registers that it needs.
template <int kNumFields, class Sample>
__global__ void __launch_bounds__(kThreadsOf<Sample>, 3)
    measure_elements(const __grid_constant__ FieldQuery<kNumFields> query,
                     const __grid_constant__ MeasureOutput out) {
  constexpr bool kWithStiffness = std::is_same_v<Sample, Curvature>;
  const ElementsView& elements = query.elements;
  FieldShare share;
  StiffnessShare stiffness;
  const int num_warps = gpu::grid_threads() / gpu::kWarpSize;
  for (int cluster = gpu::grid_thread() / gpu::kWarpSize; cluster < elements.num_clusters;
       cluster += num_warps) {
    if (query.skips_clusters && is_cluster_in_front(query, cluster)) continue;
    const int slot = cluster * SphereClusters::kSize + gpu::lane_id();
    const ElementBall ball = elements.balls[slot];
    const float packed = elements.factors[slot];
    const float factor = fabsf(packed);
    const bool is_counted = __float_as_int(packed) >= 0;
    Element element;
    element.radius = ball.radius;
    const FieldFrame& frame = query.fields[0].frame;  // the pose is the same in all
    for (int row = 0; row < 3; ++row) {
      const float(&r)[3] = frame.R_WT[row];
      element.lever[row] = r[0] * ball.x + r[1] * ball.y + r[2] * ball.z;
      element.p[row] = element.lever[row] + frame.p_WC[row];
    }
#pragma unroll
    for (int k = 0; k < kNumFields; ++k) {
      const FieldLook& field = query.fields[k];
      if (kNumFields > 1 && field.last_level < 0) continue;
      element.factor = kNumFields > 1 ? factor * field.weight : factor;
      element.is_counted = is_counted && k == kNumFields - 1;
      add_element<Sample>(field, element, share, &stiffness);
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
  if constexpr (kWithStiffness) {
    finish_measure(out, mine, stiffness.numbers, gpu::shared_memory<FinishStiffnessScratch>());
  } else {
    finish_measure(out, mine, gpu::shared_memory<FinishScratch>());
  }
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

template <class Sample>
int measure_blocks(int gpu, int num_clusters) {
  constexpr int kThreads = kThreadsOf<Sample>;
  return blocks_for(
      num_clusters * SphereClusters::kSize, kThreads,
      std::min(most_blocks(gpu, measure_elements<1, Sample>, kThreads, kSharedBytes<Sample>),
               most_blocks(gpu, measure_elements<2, Sample>, kThreads, kSharedBytes<Sample>)));
}

}  // namespace

FieldContactCuda::FieldContactCuda(std::shared_ptr<const ToolIndex> index,
                                   const FieldMethod& method, int gpu)
    : ContactQuery(std::move(index), method),
      centre_of_mass_(this->index()->tool().sphere_mass().centre_of_mass),
      num_spheres_(static_cast<int>(this->index()->tool().spheres().size())),
      memory_(gpu),
      felt_tool_(take(method.volumes)),
      stream_(gpu, gpu::Priority::high),
      fields_(gpu),
      answers_(gpu, measure_blocks<Gradient>(gpu, felt_tool_.elements.num_clusters)),
      stiffness_answers_(gpu, measure_blocks<Curvature>(gpu, felt_tool_.elements.num_clusters),
                         AnswerBox::kMostNumbers),
      states_(memory_.take<SphereState>(static_cast<std::size_t>(num_spheres_))),
      planes_(memory_.take<Plane<float>>(static_cast<std::size_t>(num_spheres_))) {}

FeltTool FieldContactCuda::take(SphereVolumes volumes) {
  const Tool& tool = index()->tool();
  const FieldElements& elements = index()->parts().elements(volumes);
  const SphereClusters& c = elements.clusters;
  std::vector<ElementBall> balls(c.x.size());
  std::vector<float> factors(c.x.size());
  for (std::size_t slot = 0; slot < balls.size(); ++slot) {
    balls[slot] = {c.x[slot], c.y[slot], c.z[slot], elements.radius[slot]};
    const float factor = elements.factor[slot];
    factors[slot] = elements.counted[slot] > 0 ? factor : -factor;
  }
  std::vector<Sphere> spheres(tool.spheres().size());
  for (std::size_t id = 0; id < spheres.size(); ++id) spheres[id] = felt_ball(tool, id, volumes);
  return {{memory_.copy_of(balls), memory_.copy_of(factors), memory_.copy_of(c.clusters),
           memory_.copy_of(elements.largest_radius), c.num_clusters()},
          memory_.copy_of(spheres),
          elements.reach};
}

const Status& FieldContactCuda::status() const {
  for (const Status* status :
       {&memory_.status(), &answers_.status(), &stiffness_answers_.status()}) {
    if (!*status) return *status;
  }
  return stream_.status();
}

ContactResult FieldContactCuda::measure(const SurfaceView& from, const SurfaceView& to,
                                        double alpha, const Pose& X_WT,
                                        const ContactWants& wants) const noexcept {
  if (!is_finite(X_WT)) return unmeasured(StepStatus::non_finite_pose, wants, true);
  FieldQuestion question;
  question.X_WT = {X_WT.translation, normalized(X_WT.rotation)};
  if (is_outside_window(from, to, alpha, question.X_WT * centre_of_mass_, felt_tool_.reach)) {
    return unmeasured(StepStatus::outside_window, wants, true);
  }
  ContactResult result;
  if (alpha < 1) {
    question.fields[0] = fields_.on_gpu(from.field, stream_);
    question.fields[1] = fields_.on_gpu(to.field, stream_);
    question.weights[0] = 1 - alpha;
    question.weights[1] = alpha;
    result = wants.stiffness ? ask<2, Curvature>(question, stiffness_answers_)
                             : ask<2, Gradient>(question, answers_);
  } else {
    question.fields[0] = fields_.on_gpu(to.field, stream_);
    question.weights[0] = 1;
    result = wants.stiffness ? ask<1, Curvature>(question, stiffness_answers_)
                             : ask<1, Gradient>(question, answers_);
  }
  describe(question.fields[alpha < 1 ? 1 : 0], question.X_WT, wants);
  return result;
}

template <int kNumFields, class Sample>
ContactResult FieldContactCuda::ask(const FieldQuestion& question,
                                    AnswerBox& answers) const noexcept {
  constexpr bool kWithStiffness = std::is_same_v<Sample, Curvature>;
  const ContactWants wants{.stiffness = kWithStiffness};
  if (!status()) return unmeasured(StepStatus::backend_failed, wants, true);
  FieldQuery<kNumFields> query;
  int num_missing = 0;
  for (int k = 0; k < kNumFields; ++k) {
    const DepthFieldView& field = question.fields[k];
    const FieldFrame frame = frame_of(field.intrinsics, question.X_WT, centre_of_mass_);
    query.fields[k] = look_of(field, frame, question.weights[k]);
    num_missing += field.num_levels == 0;
  }
  if (num_missing == kNumFields) return unmeasured(StepStatus::no_surface, wants, true);
  constexpr int kThreads = kThreadsOf<Sample>;
  query.elements = felt_tool_.elements;
  const int num_warps = answers.num_blocks() * kThreads / gpu::kWarpSize;
  query.skips_clusters = query.elements.num_clusters > num_warps;
  gpu::launch(
      stream_,
      {.blocks = answers.num_blocks(), .threads = kThreads, .shared_bytes = kSharedBytes<Sample>},
      measure_elements<kNumFields, Sample>, query, answers.next());
  if (!answers.await(stream_)) return unmeasured(StepStatus::backend_failed, wants, true);
  ContactResult result{answers.answer().penetration(), {}};
  if (num_missing > 0) result.penetration.status |= StepStatus::no_surface;
  if (kWithStiffness) result.stiffness = answers.stiffness().stiffness();
  return result;
}

void FieldContactCuda::describe(const DepthFieldView& field, const Pose& X_WT,
                                const ContactWants& wants) const noexcept {
  if (wants.states.empty() && wants.planes.empty()) return;
  std::fill(wants.states.begin(), wants.states.end(), SphereState::outside);
  std::fill(wants.planes.begin(), wants.planes.end(), Plane<float>{});
  if (!status() || field.num_levels == 0) return;
  constexpr int kDescribeThreads = 128, kMostBlocks = 1024;
  gpu::launch(stream_,
              {.blocks = blocks_for(num_spheres_, kDescribeThreads, kMostBlocks),
               .threads = kDescribeThreads},
              describe_spheres, field, X_WT, felt_tool_.spheres, num_spheres_, states_, planes_);
  if (!wants.states.empty()) stream_.copy(wants.states.data(), states_, wants.states.size_bytes());
  if (!wants.planes.empty()) stream_.copy(wants.planes.data(), planes_, wants.planes.size_bytes());
  stream_.wait();
}

}  // namespace palpate
