// The kernel of a batch in a scene: a block measures a pose, first against the hull of all cameras,
// then against body after body. It adds up in a fixed order, so that a pose has the same bits in
// any batch.
#pragma once

#include <cstdint>
#include <type_traits>

#include "src/contact/batch/batch_pose.h"
#include "src/contact/bodies/solid_elements.cuh"
#include "src/contact/cuda/finish_measure.cuh"
#include "src/contact/field/unseen_by_one.cuh"
#include "src/contact/hull/hull_elements.cuh"

namespace palpate { inline namespace v0 {

// A tool, a tool and a shape, and a body of a batch, on the GPU.
struct SceneTool {
  ElementsView elements;
  Vec3d p_TC;
  double volume = 0;  // m3, of all elements
};
struct ScenePair {
  SolidWay of_tool, of_shape;       // elements of either in the field of the other
  PairWeights weights;              // a: the tool
  Vec3d tool_corner, shape_corner;  // of the boxes of fields
};
struct SceneBody {
  std::int32_t shape = 0;
  bool is_finite = true;
  Pose X_WB;
};

// The argument of the kernel.
template <int kMaxViews>
struct SceneJob {
  HullQuery<kMaxViews> query;  // without a camera that sees: bodies alone
  Pose X_WC[kMaxViews];
  const SceneTool* tools = nullptr;
  const ScenePair* pairs = nullptr;  // of each shape, of each tool
  const SceneBody* bodies = nullptr;
  std::int32_t num_tools = 0, num_bodies = 0;
  const Pose* X_WT = nullptr;
  const std::int32_t *tool_of_pose = nullptr, *body_of_pose = nullptr;
  bool has_one_body_each = false;
  std::int32_t first_pose = 0;
  BatchAnswers out;
  double* unseen = nullptr;  // share of the tool's volume
};

// The argument of the kernel of what one camera by itself has not seen.
struct UnseenJob {
  OneCamera camera;
  FieldFrame frame;  // without a tool
  Pose X_WC;
  const SceneTool* tools = nullptr;
  const Pose* X_WT = nullptr;
  const std::int32_t* tool_of_pose = nullptr;
  std::int32_t num = 0;
  double* unseen = nullptr;  // share of the tool's volume
};

namespace {

constexpr int kUnseenWarps = 4;  // of a block

// Measures a pose by a warp.
__global__ void __launch_bounds__(kUnseenWarps* gpu::kWarpSize)
    measure_unseen(const __grid_constant__ UnseenJob job) {
  const int pose = static_cast<int>(blockIdx.x) * kUnseenWarps + gpu::warp_id();
  if (pose >= job.num) return;
  const SceneTool& tool = job.tools[job.tool_of_pose != nullptr ? job.tool_of_pose[pose] : 0];
  const BatchPose at = pose_in_camera(job.X_WT[pose], &job.X_WC);
  double share = 0;
  if (at.is_finite) {
    FieldFrame frame = job.frame;
    place_tool(at.X_CT, tool.p_TC, frame);
    share = gpu::warp_sum(unseen_volume(job.camera, tool.elements, frame, 0, 1)) / tool.volume;
  }
  if (gpu::lane_id() == 0) job.unseen[pose] = share < 1 ? share : 1.0;
}

// Sums of MeasureTerms, and of a stiffness behind them.
template <class Sample>
constexpr int kSceneSums = MeasureTerms::kNum +
                           (std::is_same_v<Sample, Curvature> ? MeasureTerms::kNumStiffness : 0);

template <int kMaxViews, class Sample>
struct SceneScratch {
  PosedTool<kMaxViews> tool;
  ViewScratch<kMaxViews, Sample> views;
  double terms[kHullWarps * kSceneSums<Sample>];
  double sums[2][kSceneSums<Sample>];
  SolidFrame frame;
  Pose X_WT;
  std::int32_t tool_number;
  std::uint32_t status;
  // Sums of the pose so far.
  double volume, potential, unseen;
  VolumeWrench wrench;
  Stiffness stiffness;
};

// Places the tool in the world and in all cameras. The whole block calls.
template <int kMaxViews, class Scratch>
__device__ void place_pose(const SceneJob<kMaxViews>& job, int pose, Scratch& shared) {
  const int thread = static_cast<int>(threadIdx.x);
  const int number = job.tool_of_pose != nullptr ? job.tool_of_pose[pose] : 0;
  const SceneTool& tool = job.tools[number];
  if (thread < job.query.num_cameras) {
    FieldFrame& frame = shared.tool.in_eyes[thread][0] = job.query.eyes[thread].field[0].frame;
    place_tool(pose_in_camera(job.X_WT[pose], job.X_WC + thread).X_CT, tool.p_TC, frame);
  }
  if (thread == 0) {
    const BatchPose at = pose_in_camera(job.X_WT[pose], nullptr);
    shared.X_WT = at.X_CT;
    shared.tool_number = number;
    shared.status =
        static_cast<std::uint32_t>(at.is_finite ? StepStatus::ok : StepStatus::non_finite_pose);
    shared.tool.elements = tool.elements;
    shared.tool.in_world = {};
    place_tool(at.X_CT, tool.p_TC, shared.tool.in_world);
    shared.volume = shared.potential = shared.unseen = 0;
    shared.wrench = {};
    shared.stiffness = {};
  }
  __syncthreads();
}

// Adds the sums of all threads up to `sums`. The whole block calls.
template <int kNum, class Scratch>
__device__ void sum_over_block(const FieldShare& share, const StiffnessShare& stiffness,
                               Scratch& shared, double (&sums)[kNum]) {
  MeasureTerms mine;
  add_share(share, mine);
  double* const terms = shared.terms + gpu::warp_id() * kNum;
  put_terms(mine, terms);
  if constexpr (kNum > MeasureTerms::kNum) put_terms(stiffness.numbers, terms);
  __syncthreads();
  const int thread = static_cast<int>(threadIdx.x);
  if (thread < kNum) {
    double sum = 0;
    for (int warp = 0; warp < kHullWarps; ++warp) sum += shared.terms[warp * kNum + thread];
    sums[thread] = sum;
  }
  __syncthreads();
}

template <int kNum>
__device__ Stiffness stiffness_of(const double (&sums)[kNum]) {
  StiffnessSums of;
  for (int k = 0; k < StiffnessSums::kNum; ++k) of.numbers[k] = sums[MeasureTerms::kNum + k];
  return of.stiffness();
}
__device__ inline SolidSums solid_sums(const double* sums) {
  return {sums[0], sums[1], {{sums[2], sums[3], sums[4]}, {sums[5], sums[6], sums[7]}}};
}
__device__ inline void add_scaled(const Stiffness& k, double scale, Stiffness& to) {
  for (int i = 0; i < 36; ++i) to.m[i / 6][i % 6] += scale * k.m[i / 6][i % 6];
}

// Adds the hull of all cameras. The whole block calls.
template <class Sample, int kMaxViews, class Scratch>
__device__ void add_cameras(const SceneJob<kMaxViews>& job, Scratch& shared) {
  FieldShare share;
  StiffnessShare stiffness;
  NoNoise noise;
  add_hull_elements(job.query, shared.tool, 0, 1, true, shared.views, share, stiffness, noise);
  sum_over_block(share, stiffness, shared, shared.sums[0]);
  if (threadIdx.x != 0) return;
  const auto& sums = shared.sums[0];
  const SolidSums of = solid_sums(sums);
  // As keep_bounds.
  const double scale = force_scale(of.volume, norm(of.wrench.force));
  shared.volume = of.volume > 0 ? of.volume : 0.0;
  shared.potential = of.potential > 0 ? of.potential : 0.0;
  shared.wrench = {scale * of.wrench.force, scale * of.wrench.torque};
  shared.unseen = sums[offsetof(MeasureTerms, unseen) / sizeof(double)];
  if constexpr (std::is_same_v<Sample, Curvature>) {
    add_scaled(stiffness_of(sums), scale, shared.stiffness);
  }
}

// Samples one direction of a pair. The whole block calls.
template <class Sample, class Scratch>
__device__ void sum_way(const SolidWay& way, double weight, const SolidFrame& frame,
                        Scratch& shared, int number) {
  using Solid = std::conditional_t<std::is_same_v<Sample, Curvature>, SolidBend, SolidSlope>;
  if (threadIdx.x == 0) shared.frame = frame;
  __syncthreads();
  FieldShare share;
  StiffnessShare stiffness;
  if (weight > 0) {
    add_solid_elements<Solid>(way, shared.frame, gpu::warp_id(), kHullWarps, share, stiffness);
  }
  sum_over_block(share, stiffness, shared, shared.sums[number]);
}

// Adds a body. The whole block calls.
template <class Sample, int kMaxViews, class Scratch>
__device__ void add_body(const SceneJob<kMaxViews>& job, const SceneBody& body, Scratch& shared) {
  const ScenePair& pair = job.pairs[body.shape * job.num_tools + shared.tool_number];
  const PairWeights& w = pair.weights;
  const Pose &X_WT = shared.X_WT, &X_WB = body.X_WB;
  sum_way<Sample>(pair.of_tool, w.a, solid_frame(X_WT, w.p_AC, X_WB, pair.shape_corner), shared, 0);
  sum_way<Sample>(pair.of_shape, w.b, solid_frame(X_WB, w.p_BC, X_WT, pair.tool_corner), shared, 1);
  if (threadIdx.x != 0) return;
  const SolidSums of_tool = solid_sums(shared.sums[0]), of_shape = solid_sums(shared.sums[1]);
  if (of_tool.volume == 0 && of_shape.volume == 0) return;  // they do not touch
  const SolidPairSums both(w, of_tool, of_shape, X_WT, X_WB);
  const VolumeWrench on_tool = both.on_a();
  shared.volume += both.volume;
  shared.potential += both.potential.value();
  shared.wrench = {shared.wrench.force + on_tool.force, shared.wrench.torque + on_tool.torque};
  if constexpr (std::is_same_v<Sample, Curvature>) {
    add_scaled(both.stiffness_a(stiffness_of(shared.sums[0]), stiffness_of(shared.sums[1])), 1,
               shared.stiffness);
  }
}

// Writes the answers of a pose; zeros if it has no measure. The whole block calls.
template <class Sample, int kMaxViews, class Scratch>
__device__ void put_pose(const SceneJob<kMaxViews>& job, int pose, const Scratch& shared) {
  const BatchAnswers& out = job.out;
  const bool is_measured = shared.status == 0;
  const auto put = [is_measured](double* to, double value) {
    if (to != nullptr) *to = is_measured ? value : 0.0;
  };
  const auto place = [pose](double* to, int each, int i) {
    return to == nullptr ? nullptr : to + std::ptrdiff_t{each} * pose + i;
  };
  const int thread = static_cast<int>(threadIdx.x);
  if (thread == 0) {
    put(place(out.volume, 1, 0), shared.volume);
    put(place(out.potential, 1, 0), shared.potential);
    const double share = shared.unseen / job.tools[shared.tool_number].volume;
    put(place(job.unseen, 1, 0), share < 1 ? share : 1.0);
    if (out.status != nullptr) out.status[pose] = shared.status;
  }
  if (thread < 3) {
    put(place(out.force, 3, thread), shared.wrench.force[thread]);
    put(place(out.torque, 3, thread), shared.wrench.torque[thread]);
  }
  if (std::is_same_v<Sample, Curvature> && thread < 36) {
    put(place(out.stiffness, 36, thread), shared.stiffness.m[thread / 6][thread % 6]);
  }
}

template <int kMaxViews, class Sample>
__global__ void __launch_bounds__(kHullThreads, 2)
    measure_scene(const __grid_constant__ SceneJob<kMaxViews> job) {
  auto& shared = gpu::shared_memory<SceneScratch<kMaxViews, Sample>>();
  const int pose = static_cast<int>(blockIdx.x);
  place_pose(job, pose, shared);
  int first = 0, end = job.num_bodies;
  StepStatus status = StepStatus::ok;
  if (job.has_one_body_each) {
    first = surface_of(job.body_of_pose, job.num_bodies, job.first_pose + pose);
    end = first + 1;
    if (first < 0) {
      status = StepStatus::no_surface;
    } else if (!job.bodies[first].is_finite) {
      status = StepStatus::non_finite_pose;
    }
  }
  if (threadIdx.x == 0) shared.status |= static_cast<std::uint32_t>(status);
  __syncthreads();
  if (shared.status == 0) {
    if (job.query.num_seeing > 0) add_cameras<Sample>(job, shared);
    for (int b = first; b < end; ++b) {
      if (job.bodies[b].is_finite) add_body<Sample>(job, job.bodies[b], shared);
    }
  }
  __syncthreads();
  put_pose<Sample>(job, pose, shared);
}

}  // namespace
}}  // namespace palpate::v0
