// Clearance of all links of many configurations on a GPU. A thread places the links of a
// configuration by its joints; a thread for each link bounds its clearance by the depths around it,
// and another puts the links in the order of these bounds. Then a warp searches link after link
// until no bound is below the least that it has found, and a thread refines what may be the least.
#pragma once

#include <algorithm>
#include <limits>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "src/contact/clearance/clearance_kernels.cuh"
#include "src/contact/internal/joint_tree.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 { namespace {

constexpr unsigned long long kNoneRefused = ~0ull;

/// A hit of the search, and its link.
struct LinkHit {
  ClearanceHit hit;
  std::int32_t link = -1;
};

/// The argument of the kernels. Arrays by link or frame have a row of all configurations for each.
struct TreeJob {
  Question of;  // scene, tools and limit
  const TreeJoint* joints = nullptr;
  const JointRange* ranges = nullptr;
  const std::int32_t* frame_of_tool = nullptr;
  std::int32_t num_joints = 0, num_positions = 0, num_tools = 0;
  Pose X_WB;
  std::int32_t num = 0;          // configurations
  unsigned long long first = 0;  // number of their first position
  std::int32_t refuses = 0;      // positions beyond ranges
  const double* positions = nullptr;
  Pose* X_WF = nullptr;      // of frames
  float* bounds = nullptr;   // m, of links: no sphere has a lower clearance; then sorted
  float* changes = nullptr;  // m, of links: margin_change; then the greatest of a configuration
  std::int32_t* order = nullptr;  // of links, by their bounds
  LinkHit* hits = nullptr;
  std::int32_t* count = nullptr;  // of links that may be near; then of hits
  Clearance* found = nullptr;
  std::int32_t* link = nullptr;
  unsigned long long* refused = nullptr;
  TreeAnswers out;

  __device__ std::int32_t at(int row, int i) const { return row * num + i; }
  __device__ const Pose& pose(int tool, int i) const { return X_WF[at(frame_of_tool[tool], i)]; }
};

__global__ void place_frames(const __grid_constant__ TreeJob job) {
  const int i = gpu::grid_thread();
  if (i >= job.num) return;
  const int n = job.num_positions;
  const double* const q = job.positions + static_cast<std::ptrdiff_t>(n) * i;
  bool is_held = false, is_refused = false;
  for (int j = 0; j < n; ++j) {
    const JointRange& range = job.ranges[j];
    const bool is_beyond = q[j] < range.lower || q[j] > range.upper;
    is_held = is_held || is_beyond;
    if (std::abs(q[j]) < kMaxJointPosition && !(is_beyond && job.refuses != 0)) continue;
    is_refused = true;
    const auto number = static_cast<unsigned long long>(i) * static_cast<unsigned>(n);
    atomicMin(job.refused, job.first + number + static_cast<unsigned>(j));
  }
  if (job.out.held != nullptr) job.out.held[i] = is_held ? 1 : 0;
  job.X_WF[i] = job.X_WB;
  for (int k = 0; k < job.num_joints; ++k) {
    const TreeJoint& joint = job.joints[k];
    double position = joint.offset;
    if (joint.moved >= 0 && !is_refused) {
      const JointRange& range = job.ranges[joint.moved];
      position += joint.factor * lesser(greater(q[joint.moved], range.lower), range.upper);
    }
    job.X_WF[job.at(k + 1, i)] =
        child_of(job.X_WF[job.at(joint.parent, i)] * joint.X_PJ, joint.kind, joint.axis, position);
  }
}

__global__ void bound_links(const __grid_constant__ TreeJob job) {
  const int at = gpu::grid_thread();
  if (at >= job.num * job.num_tools) return;
  const Question& of = job.of;
  const ToolOnGpu& tool = of.tools[at / job.num];
  const Pose& X = job.pose(at / job.num, at % job.num);
  const double change = margin_change(of.cameras, of.num_cameras, tool.tool, X, of.limit);
  const auto limit = static_cast<float>(of.is_margin != 0 ? of.limit + change : of.limit);
  float bound = limit;
  for (int k = 0; k < of.num_cameras; ++k) {
    if (of.cameras[k].is_joined != 0) {
      bound = -isa_warp::kFarAway;
      break;
    }
    ClearanceCamera camera;
    place_camera(of.cameras[k], X, camera);
    for (int g = 0; g < tool.clusters.num_groups; ++g) {
      bound = lesser(bound, clear_before(camera, tool.clusters.groups[g], limit));
    }
  }
  job.bounds[at] = bound < limit ? bound : isa_warp::kFarAway;
  job.changes[at] = static_cast<float>(change);
}

/// Sorts the links that may be near by their bounds; of equal ones the last goes first, as a hand
/// is nearer than a base.
__global__ void order_links(const __grid_constant__ TreeJob job) {
  const int i = gpu::grid_thread();
  if (i >= job.num) return;
  std::int32_t num = 0;
  float change = 0;
  for (int link = 0; link < job.num_tools; ++link) {
    const float bound = job.bounds[job.at(link, i)];
    change = greater(change, job.changes[job.at(link, i)]);
    if (!(bound < isa_warp::kFarAway)) continue;
    int k = num++;
    for (; k > 0 && job.bounds[job.at(k - 1, i)] >= bound; --k) {
      job.bounds[job.at(k, i)] = job.bounds[job.at(k - 1, i)];
      job.order[job.at(k, i)] = job.order[job.at(k - 1, i)];
    }
    job.bounds[job.at(k, i)] = bound;
    job.order[job.at(k, i)] = link;
  }
  job.changes[i] = change;
  job.count[i] = num;
}

struct LinkScratch {
  ClearanceCamera cameras[kMaxCameras];
};

/// Searches the links of a configuration by a warp, and leaves what may be the nearest. Some take
/// far longer than others: a block is one warp, so that none waits for another.
__global__ void __launch_bounds__(gpu::kWarpSize)
    search_links(const __grid_constant__ TreeJob job) {
  auto& cameras = gpu::shared_memory<LinkScratch>().cameras;
  const int i = static_cast<int>(blockIdx.x), lane = gpu::lane_id();
  const Question& of = job.of;
  const float change = job.changes[i];
  ClearanceJob search;
  search.cameras = cameras;
  search.num_cameras = of.num_cameras;
  search.limit = search.deepest = static_cast<float>(of.limit);
  if (of.is_margin != 0) set_margin(of.limit, static_cast<double>(change), search);
  const int num = job.count[i];
  int num_hits = 0;
  for (int k = 0; k < num && job.bounds[job.at(k, i)] < search.limit; ++k) {
    const std::int32_t link = job.order[job.at(k, i)];
    __syncwarp();  // all lanes are done with the last link
    if (lane < of.num_cameras) place_camera(of.cameras[lane], job.pose(link, i), cameras[lane]);
    __syncwarp();
    search.spheres = of.tools[link].clusters;
    ClearanceHit hit;
    isa_warp::search_clusters(search, hit);
    if (hit.kind == ClearanceKind::nothing) continue;
    if (lane == 0) job.hits[job.at(num_hits, i)] = {hit, link};
    ++num_hits;
    if (hit.kind == ClearanceKind::deep || hit.value < search.enough) break;
    // Planes may bring either of two links nearer.
    if (of.is_margin == 0) search.limit = lesser(search.limit, hit.value + 2 * change);
  }
  __syncwarp();
  if (lane == 0) job.count[i] = num_hits;
}

/// Finds the least clearance to cameras among the hits.
__global__ void refine_links(const __grid_constant__ TreeJob job) {
  const int i = gpu::grid_thread();
  if (i >= job.num) return;
  const Question& of = job.of;
  const float change = job.changes[i];
  const int num = job.count[i];
  float lowest = isa_warp::kFarAway;
  for (int k = 0; k < num; ++k) lowest = lesser(lowest, job.hits[job.at(k, i)].hit.value);
  ClearanceJob margin;
  set_margin(of.limit, static_cast<double>(change), margin);
  Clearance least{of.limit};
  std::int32_t link = -1;
  for (int k = 0; k < num; ++k) {
    const LinkHit& at = job.hits[job.at(k, i)];
    if (!(at.hit.value <= lowest + 2 * change)) continue;
    const Pose& X = job.pose(at.link, i);
    const ClearanceTool& tool = of.tools[at.link].tool;
    Clearance found{kBelowAll};
    if (of.is_margin == 0) {
      found = clearance_of(of.cameras, tool, at.hit, X, of.limit);
    } else if (!is_hit_within(of.cameras, tool, at.hit, margin, X, of.limit)) {
      continue;
    }
    if (!(found.value < least.value || (found.value == least.value && at.link < link))) continue;
    least = found;
    link = at.link;
  }
  job.found[i] = least;
  job.link[i] = link;
}

/// Asks bodies, of which a lane each passes over links.
__global__ void __launch_bounds__(gpu::kWarpSize)
    search_bodies_of_links(const __grid_constant__ TreeJob job) {
  const int i = static_cast<int>(blockIdx.x);
  const Question& of = job.of;
  double least = job.found[i].value;
  for (int b = 0; b < of.num_bodies; ++b) {
    for (int begin = 0; begin < job.num_tools; begin += gpu::kWarpSize) {
      const int mine = begin + gpu::lane_id();
      bool is_near = false;
      if (mine < job.num_tools) {
        const ClusterView& clusters = of.tools[mine].clusters;
        const PlacedTool placed(of.bodies[b], job.pose(mine, i));
        for (int g = 0; g < clusters.num_groups && !is_near; ++g) {
          is_near = placed.may_be_below(clusters.groups[g], least);
        }
      }
      unsigned near = __ballot_sync(gpu::kWholeWarp, is_near);
      for (; near != 0; near &= near - 1) {
        if (of.is_margin != 0 && least < of.limit) return;
        const int link = begin + __ffs(static_cast<int>(near)) - 1;
        const double before = least;
        ask_body(of.bodies[b], of.num_surfaces + b, of.tools[link], job.pose(link, i), least,
                 job.found[i]);
        if (least < before && gpu::lane_id() == 0) job.link[i] = link;
      }
    }
  }
}

__global__ void put_answers(const __grid_constant__ TreeJob job) {
  const int i = gpu::grid_thread();
  if (i >= job.num) return;
  const TreeAnswers& out = job.out;
  const double limit = job.of.limit;
  const Clearance& least = job.found[i];
  if (out.hits != nullptr) out.hits[i] = least.value < limit ? 1 : 0;
  const bool is_known = least.sphere >= 0 && least.value > -limit;
  const std::int32_t link = job.link[i];
  if (out.clearance != nullptr) out.clearance[i] = greater(least.value, -limit);
  if (out.link != nullptr) out.link[i] = least.value < limit ? link : -1;
  if (out.clearance_by_joint == nullptr) return;
  const int n = job.num_positions;
  double* const by_joint = out.clearance_by_joint + static_cast<std::ptrdiff_t>(n) * i;
  for (int j = 0; j < n; ++j) by_joint[j] = 0;
  if (!is_known) return;
  const double(&g)[6] = least.gradient;
  const Vec3d C_W = job.pose(link, i) * job.of.tools[link].tool.p_TC;
  for (int frame = job.frame_of_tool[link]; frame != 0; frame = job.joints[frame - 1].parent) {
    const TreeJoint& joint = job.joints[frame - 1];
    if (joint.moved < 0 || joint.kind == JointKind::fixed) continue;
    by_joint[joint.moved] +=
        joint.factor * effort_of(job.X_WF[job.at(frame, i)], joint.kind, joint.axis, C_W,
                                 {g[0], g[1], g[2]}, {g[3], g[4], g[5]});
  }
}

/// A tree on a GPU, with memory for some of its configurations at a time.
class TreeOnGpu {
 public:
  TreeOnGpu(std::shared_ptr<const JointTree> tree, int gpu, std::size_t at_once)
      : tree_(std::move(tree)), memory_(gpu) {
    job_.joints = memory_.copy_of(tree_->joints);
    job_.ranges = memory_.copy_of(tree_->ranges);
    job_.frame_of_tool = memory_.copy_of(tree_->frame_of_tool);
    job_.num_joints = static_cast<std::int32_t>(tree_->joints.size());
    job_.num_positions = static_cast<std::int32_t>(tree_->ranges.size());
    job_.num_tools = static_cast<std::int32_t>(tree_->frame_of_tool.size());
    const std::size_t n = tree_->ranges.size(), frames = tree_->joints.size() + 1,
                      tools = tree_->frame_of_tool.size();
    constexpr std::size_t kByLink = 2 * sizeof(float) + sizeof(std::int32_t) + sizeof(LinkHit);
    const std::size_t each = frames * sizeof(Pose) + tools * kByLink + 2 * n * sizeof(double) + 128;
    at_once_ = std::clamp<std::size_t>(kMaxBytes / each, 1, at_once);
    positions_ = memory_.take<double>(at_once_ * n);
    job_.X_WF = memory_.take<Pose>(at_once_ * frames);
    job_.bounds = memory_.take<float>(at_once_ * tools);
    job_.changes = memory_.take<float>(at_once_ * tools);
    job_.order = memory_.take<std::int32_t>(at_once_ * tools);
    job_.hits = memory_.take<LinkHit>(at_once_ * tools);
    job_.count = memory_.take<std::int32_t>(at_once_);
    job_.found = memory_.take<Clearance>(at_once_);
    job_.link = memory_.take<std::int32_t>(at_once_);
    job_.refused = memory_.take<unsigned long long>(1);
    staged_ = {memory_.take<double>(at_once_), memory_.take<std::int32_t>(at_once_),
               memory_.take<double>(at_once_ * n), memory_.take<std::uint8_t>(at_once_),
               memory_.take<std::uint8_t>(at_once_)};
  }

  const std::shared_ptr<const JointTree>& tree() const { return tree_; }
  const Status& status() const { return memory_.status(); }

  /// Failures go to the stream.
  std::optional<RefusedPosition> measure(const Question& of, const JointPoses& poses,
                                         const TreeAnswers& answers, gpu::Stream& stream) {
    const std::size_t n = tree_->ranges.size(), total = poses.positions.size() / n;
    const bool is_staged = poses.gpu == kHostMemory;
    TreeJob job = job_;
    job.of = of;
    job.of.limit = answers.limit;
    job.of.is_margin = answers.hits != nullptr ? 1 : 0;
    job.X_WB = {poses.X_WB.translation, normalized(poses.X_WB.rotation)};
    job.refuses = poses.refuses_beyond_ranges ? 1 : 0;
    stream.copy(job.refused, &kNoneRefused, sizeof kNoneRefused);
    for (std::size_t first = 0; first < total; first += at_once_) {
      const std::size_t num = std::min(at_once_, total - first);
      job.num = static_cast<std::int32_t>(num);
      job.first = first * n;
      job.positions = poses.positions.data() + first * n;
      if (is_staged) {
        stream.copy(positions_, job.positions, num * n * sizeof(double));
        job.positions = positions_;
      }
      for_answers(answers, job.out, [&](auto* desired, auto* staged, std::size_t each, auto*& to) {
        to = desired == nullptr ? nullptr : is_staged ? staged : desired + each * first;
      });
      launch(job, stream);
      if (is_staged) {
        for_answers(answers, job.out, [&](auto* to, auto* from, std::size_t each, auto*&) {
          if (to != nullptr) stream.copy(to + each * first, from, each * num * sizeof *to);
        });
      }
      if (!stream.wait(60)) return {};
    }
    unsigned long long refused = kNoneRefused;
    stream.copy(&refused, job.refused, sizeof refused);
    if (!stream.wait(60) || refused == kNoneRefused) return {};
    RefusedPosition position{static_cast<std::size_t>(refused), 0};
    stream.copy(&position.value, poses.positions.data() + position.number, sizeof(double));
    stream.wait();
    return position;
  }

 private:
  static constexpr std::size_t kMaxBytes = 256u << 20;

  /// Calls f(array of the caller, staged one, numbers of a configuration, array of the job).
  template <class F>
  void for_answers(const TreeAnswers& answers, TreeAnswers& out, const F& f) const {
    f(answers.clearance, staged_.clearance, std::size_t{1}, out.clearance);
    f(answers.link, staged_.link, std::size_t{1}, out.link);
    f(answers.clearance_by_joint, staged_.clearance_by_joint, tree_->ranges.size(),
      out.clearance_by_joint);
    f(answers.held, staged_.held, std::size_t{1}, out.held);
    f(answers.hits, staged_.hits, std::size_t{1}, out.hits);
  }

  static void launch(const TreeJob& job, gpu::Stream& stream) {
    const auto num = static_cast<std::size_t>(job.num);
    const gpu::LaunchShape threads{.blocks = blocks_for(num, kThreads)},
        warps{.blocks = job.num, .threads = gpu::kWarpSize, .shared_bytes = sizeof(LinkScratch)},
        links{.blocks = blocks_for(num * static_cast<std::size_t>(job.num_tools), kThreads)};
    gpu::launch(stream, threads, place_frames, job);
    gpu::launch(stream, links, bound_links, job);
    gpu::launch(stream, threads, order_links, job);
    if (job.of.num_cameras > 0) gpu::launch(stream, warps, search_links, job);
    gpu::launch(stream, threads, refine_links, job);
    if (job.of.num_bodies > 0) gpu::launch(stream, warps, search_bodies_of_links, job);
    gpu::launch(stream, threads, put_answers, job);
  }

  std::shared_ptr<const JointTree> tree_;
  gpu::Memory memory_;
  TreeJob job_;
  std::size_t at_once_ = 0;  // configurations
  double* positions_ = nullptr;
  TreeAnswers staged_;
};

}}}  // namespace palpate::v0
