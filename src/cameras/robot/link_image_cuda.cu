#include "src/cameras/robot/link_image_cuda.h"

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "src/cameras/internal/link_image.h"
#include "src/cloud/internal/raw_frame_cuda.h"
#include "src/gpu/internal/runtime.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {
namespace {

// A GPU also answers queries: this leaves room for them.
constexpr int kThreads = 256, kMaxBlocks = 64;
constexpr int kBandRows = 32;  // of a canvas, which a warp draws at once

struct LinkPose {
  Mat3d R_CL;
  Vec3d p_CL;
};

struct LinkFace {
  std::uint32_t ids[3];
};

/// The triangles of a shell: inverse depth, and the pixels that they touch.
struct ShellBounds {
  float nearest;
  LinkWindow box;
};

struct LinkAnswer {
  int frame;  // number of the frame that was done; another one: the GPU did nothing
  int does_not_fit;
};

/// Input, output and buffers of the kernel.
struct LinkJob {
  LinkCamera camera;
  int width = 0, height = 0;
  int num_vertices = 0, num_faces = 0;
  const LinkPose* poses = nullptr;      // of each link
  const Vec3d* p_L = nullptr;           // of each vertex
  const int* link_of_vertex = nullptr;  // likewise
  LinkVertex* vertices = nullptr;
  const LinkFace* faces = nullptr;
  ShellBounds* shells = nullptr;  // kNumLinkShells
  float* canvas = nullptr;        // of the shell that is drawn; empty between two of them
  float* rows = nullptr;          // its rows, widened
  std::ptrdiff_t canvas_size = 0, rows_size = 0;
  float* front = nullptr;  // of the image
  RawFrameView raw;
  std::uint16_t* pixels = nullptr;  // the image without the links
  LinkAnswer* answer = nullptr;
  int frame = 0;
  unsigned long long* barrier = nullptr;
};

/// Positive numbers are in the order of their bits.
__device__ inline void raise(float* to, float value) {
  if (*to < value) atomicMax(reinterpret_cast<int*>(to), __float_as_int(value));
}

__device__ inline void widen(ShellBounds& to, float nearest, const LinkWindow& box) {
  raise(&to.nearest, nearest);
  if (box.left < to.box.left) atomicMin(&to.box.left, box.left);
  if (box.top < to.box.top) atomicMin(&to.box.top, box.top);
  if (box.right > to.box.right) atomicMax(&to.box.right, box.right);
  if (box.bottom > to.box.bottom) atomicMax(&to.box.bottom, box.bottom);
}

__device__ inline ShellBounds no_bounds() {
  constexpr int kFar = 1 << 30;
  return {0, {kFar, kFar, -kFar, -kFar}};
}

/// Corners of a face that is not too near.
__device__ inline int corners_of(const LinkJob& job, int face, LinkCorner (&corners)[4]) {
  const std::uint32_t(&ids)[3] = job.faces[face].ids;
  const LinkVertex* const vertices[3] = {job.vertices + ids[0], job.vertices + ids[1],
                                         job.vertices + ids[2]};
  return cut_at_nearest(job.camera, vertices, corners);
}

/// Finds the nearest depth and the box of the triangles of each shell.
__device__ void bound_shells(const LinkJob& job, ShellBounds* mine) {
  const int thread = static_cast<int>(threadIdx.x);
  if (thread < kNumLinkShells) mine[thread] = no_bounds();
  __syncthreads();
  for (int face = gpu::grid_thread(); face < job.num_faces; face += gpu::grid_threads()) {
    LinkCorner corners[4];
    const int num = corners_of(job, face, corners);
    for (int i = 2; i < num; ++i) {
      LinkPieces pieces(LinkTriangle{{corners[0], corners[i - 1], corners[i]}});
      for (LinkTriangle piece; pieces.take(piece);) {
        if (job.camera.is_padded_too_wide(piece) && pieces.cut(piece)) continue;
        widen(mine[shell_of(piece.nearest())], piece.nearest(), LinkRaster::box_of(piece));
      }
    }
  }
  __syncthreads();
  if (thread < kNumLinkShells && mine[thread].nearest > 0) {
    widen(job.shells[thread], mine[thread].nearest, mine[thread].box);
  }
}

/// May a part of the face be in this shell and in these rows?
__device__ inline bool may_be_in(const LinkJob& job, int face, int shell, const LinkWindow& band) {
  const std::uint32_t(&ids)[3] = job.faces[face].ids;
  const LinkTriangle triangle{
      {job.vertices[ids[0]].corner, job.vertices[ids[1]].corner, job.vertices[ids[2]].corner}};
  if (!(triangle.nearest() > 0)) return false;  // all of it is too near
  if (!(triangle.farthest() > 0)) return true;  // some is: it is cut
  if (shell_of(triangle.nearest()) > shell || shell_of(triangle.farthest()) < shell) return false;
  return !LinkRaster::box_of(triangle).common(band).is_empty();
}

/// A piece, by all lanes of a warp.
__device__ inline void draw_piece(const LinkJob& job, const LinkTriangle& piece,
                                  const LinkWindow& drawn, const LinkWindow& band) {
  draw_rows(piece, band, [&](int v, const LinkRaster::Row& row, const LinkRaster& raster) {
    float* const to =
        job.canvas + static_cast<std::ptrdiff_t>(v - drawn.top) * drawn.width() - drawn.left;
    for (int u = row.first + gpu::lane_id(); u < row.end; u += gpu::kWarpSize) {
      raise(to + u, raster.at(row, u));
    }
  });
}

/// Each warp takes 32 faces and a band of rows; all of its lanes draw what is found there.
__device__ void draw_shell(const LinkJob& job, int shell, const LinkWindow& drawn) {
  const int num_bands = (drawn.height() + kBandRows - 1) / kBandRows;
  const int num_tasks = num_bands * ((job.num_faces + gpu::kWarpSize - 1) / gpu::kWarpSize);
  const int num_warps = gpu::grid_threads() / gpu::kWarpSize;
  for (int task = gpu::grid_thread() / gpu::kWarpSize; task < num_tasks; task += num_warps) {
    const int top = drawn.top + task % num_bands * kBandRows;
    const LinkWindow band = LinkWindow{drawn.left, top, drawn.right, top + kBandRows}.common(drawn);
    const int first = task / num_bands * gpu::kWarpSize, mine = first + gpu::lane_id();
    unsigned found =
        __ballot_sync(gpu::kWholeWarp, mine < job.num_faces && may_be_in(job, mine, shell, band));
    for (; found != 0; found &= found - 1) {
      LinkCorner corners[4];
      const int num = corners_of(job, first + __ffs(static_cast<int>(found)) - 1, corners);
      for (int i = 2; i < num; ++i) {
        LinkPieces pieces(LinkTriangle{{corners[0], corners[i - 1], corners[i]}});
        for (LinkTriangle piece; pieces.take(piece);) {
          if (job.camera.is_padded_too_wide(piece) && pieces.cut(piece)) continue;
          if (shell_of(piece.nearest()) == shell) draw_piece(job, piece, drawn, band);
        }
      }
    }
  }
}

/// Raises to[i * apart], i before num_to, to the largest of the `span` numbers of `from` from i -
/// shift on; those outside of the num_from that there are do not count. Of a segment as long as the
/// span each window has an end of one block of numbers and the beginning of the next one.
__device__ inline void raise_to_widest(const float* from, int num_from, std::ptrdiff_t from_apart,
                                       int shift, int span, float* to, int num_to,
                                       std::ptrdiff_t to_apart, int segment) {
  const int begin = segment * span, end = smaller(begin + span, num_to);
  const auto get = [&](int i) {
    const int k = i - shift;
    return k >= 0 && k < num_from ? from[k * from_apart] : 0.0f;
  };
  float most = 0;
  for (int i = begin + span - 1; i >= begin; --i) {
    most = larger(most, get(i));
    if (i < end) to[i * to_apart] = larger(to[i * to_apart], most);
  }
  most = 0;
  for (int i = begin + 1; i < end; ++i) {
    most = larger(most, get(i + span - 1));
    to[i * to_apart] = larger(to[i * to_apart], most);
  }
}

/// Adds the shell that was drawn, wider by `radius`, to `front`. All blocks call.
__device__ void pad_shell(const LinkJob& job, const LinkWindow& drawn, int radius) {
  const int span = 2 * radius + 1;
  const LinkWindow reached = LinkWindow{drawn.left - radius, drawn.top - radius,
                                        drawn.right + radius, drawn.bottom + radius}
                                 .common({0, 0, job.width, job.height});
  const int wide = reached.width(), high = drawn.height();
  // A number of the image is the largest of those from `radius` before it on.
  const int num_wide = (wide + span - 1) / span, num_high = (reached.height() + span - 1) / span;
  for (int i = gpu::grid_thread(); i < high * num_wide; i += gpu::grid_threads()) {
    const int v = i % high;
    float* const to = job.rows + static_cast<std::ptrdiff_t>(v) * wide;
    raise_to_widest(job.canvas + static_cast<std::ptrdiff_t>(v) * drawn.width(), drawn.width(), 1,
                    drawn.left - (reached.left - radius), span, to, wide, 1, i / high);
  }
  gpu::grid_barrier(job.barrier);
  for (int i = gpu::grid_thread(); i < wide * num_high; i += gpu::grid_threads()) {
    const int u = i % wide;
    float* const to =
        job.front + static_cast<std::ptrdiff_t>(reached.top) * job.width + reached.left + u;
    raise_to_widest(job.rows + u, high, wide, drawn.top - (reached.top - radius), span, to,
                    reached.height(), job.width, i / wide);
  }
  for (int i = gpu::grid_thread(); i < drawn.width() * high; i += gpu::grid_threads()) {
    job.canvas[i] = 0;
  }
  gpu::grid_barrier(job.barrier);
  for (int i = gpu::grid_thread(); i < wide * high; i += gpu::grid_threads()) job.rows[i] = 0;
}

__global__ void __launch_bounds__(kThreads) remove_links(const __grid_constant__ LinkJob job) {
  auto& bounds = gpu::shared_memory<ShellBounds[kNumLinkShells]>();
  const int num_pixels = job.width * job.height, first = gpu::grid_thread(),
            step = gpu::grid_threads();
  for (int i = first; i < job.num_vertices; i += step) {
    const LinkPose& at = job.poses[job.link_of_vertex[i]];
    job.vertices[i] = job.camera.vertex_at(at.R_CL * job.p_L[i] + at.p_CL);
  }
  for (int i = first; i < num_pixels; i += step) job.front[i] = 0;
  if (first < kNumLinkShells) job.shells[first] = no_bounds();
  if (first == 0) *job.answer = {job.frame, 0};
  gpu::grid_barrier(job.barrier);
  bound_shells(job, bounds);
  gpu::grid_barrier(job.barrier);

  for (int shell = 0; shell < kNumLinkShells; ++shell) {
    const ShellBounds has = job.shells[shell];
    if (!(has.nearest > 0)) continue;
    const int radius = job.camera.radius_of(has.nearest);
    const LinkWindow drawn =
        has.box.common({-radius, -radius, job.width + radius, job.height + radius});
    if (drawn.is_empty()) continue;
    const std::ptrdiff_t high = drawn.height();
    if (drawn.width() * high > job.canvas_size || job.width * high > job.rows_size) {
      if (first == 0) job.answer->does_not_fit = 1;
      return;  // all threads do
    }
    draw_shell(job, shell, drawn);
    gpu::grid_barrier(job.barrier);
    pad_shell(job, drawn, radius);
  }

  const auto unit = static_cast<float>(*job.raw.unit),
             padding = static_cast<float>(job.camera.padding);
  for (int i = first; i < num_pixels; i += step) {
    const std::uint16_t count = job.raw.pixels[i];
    job.pixels[i] = shows_link(count, unit, padding, job.front[i]) ? std::uint16_t(0) : count;
  }
}

constexpr std::size_t kSharedBytes = sizeof(ShellBounds) * kNumLinkShells;

class LinksOnGpuCuda final : public LinksOnGpu {
 public:
  LinksOnGpuCuda(std::span<const RobotLink> links, const Intrinsics& intrinsics, int width,
                 int height, double padding, int gpu)
      : memory_(gpu), stream_(gpu, gpu::Priority::low), raw_(memory_, width, height) {
    std::vector<Vec3d> p_L;
    std::vector<int> link_of_vertex;
    std::vector<LinkFace> faces;
    for (const RobotLink& link : links) {
      const auto base = static_cast<std::uint32_t>(p_L.size());
      for (const auto& ids : link.mesh.triangles) {
        faces.push_back({{base + ids[0], base + ids[1], base + ids[2]}});
      }
      p_L.insert(p_L.end(), link.mesh.vertices.begin(), link.mesh.vertices.end());
      link_of_vertex.resize(p_L.size(), static_cast<int>(num_links_++));
    }
    const auto wide = static_cast<std::size_t>(width), high = static_cast<std::size_t>(height);
    // The image with a margin of half its longer side all around.
    const std::size_t longer = std::max(wide, high);
    job_.canvas_size = static_cast<std::ptrdiff_t>((wide + longer) * (high + longer));
    job_.rows_size = static_cast<std::ptrdiff_t>(wide * (high + longer));
    job_.camera = link_camera(intrinsics, width, height, padding);
    job_.width = width;
    job_.height = height;
    job_.num_vertices = static_cast<int>(p_L.size());
    job_.num_faces = static_cast<int>(faces.size());
    job_.poses = poses_on_gpu_ = memory_.take<LinkPose>(num_links_);
    job_.p_L = memory_.copy_of(p_L);
    job_.link_of_vertex = memory_.copy_of(link_of_vertex);
    job_.vertices = memory_.take<LinkVertex>(p_L.size());
    job_.faces = memory_.copy_of(faces);
    job_.shells = memory_.take<ShellBounds>(kNumLinkShells);
    job_.canvas = memory_.take<float>(static_cast<std::size_t>(job_.canvas_size));
    job_.rows = memory_.take<float>(static_cast<std::size_t>(job_.rows_size));
    job_.front = memory_.take<float>(wide * high);
    job_.raw = raw_.view();
    job_.pixels = memory_.take<std::uint16_t>(wide * high);
    job_.answer = memory_.take<LinkAnswer>(1);
    job_.barrier = memory_.take<unsigned long long>(1);
    poses_ = memory_.take_pinned<LinkPose>(num_links_);
    pixels_ = memory_.take_pinned<std::uint16_t>(wide * high);
    answer_ = memory_.take_pinned<LinkAnswer>(1);
    num_blocks_ =
        std::min(kMaxBlocks, gpu::resident_blocks(gpu, reinterpret_cast<const void*>(remove_links),
                                                  kThreads, kSharedBytes));
  }

  Status status() const {
    if (!memory_.status() || num_blocks_ > 0) return memory_.status();
    return Error{Errc::unavailable, "GPU " + std::to_string(memory_.gpu()) +
                                        " cannot run all threads of the self filter at once"};
  }

  Result<bool> remove_from(DepthFrame& frame, std::span<const Pose> X_CL) override {
    if (frame.width != job_.width || frame.height != job_.height) return false;
    std::copy_n(frame.pixels.begin(), raw_.pixels().size(), raw_.pixels().begin());
    raw_.set_unit(frame.unit);
    std::transform(X_CL.begin(), X_CL.end(), poses_, [](const Pose& at) {
      return LinkPose{rotation_matrix(at.rotation), at.translation};
    });
    ++job_.frame;
    raw_.enqueue_copy(stream_, 0, job_.height);
    stream_.copy(poses_on_gpu_, poses_, sizeof(LinkPose) * num_links_);
    gpu::launch(stream_,
                {.blocks = num_blocks_,
                 .threads = kThreads,
                 .shared_bytes = kSharedBytes,
                 .cooperative = true},
                remove_links, job_);
    stream_.copy(pixels_, job_.pixels, raw_.pixels().size_bytes());
    stream_.copy(answer_, job_.answer, sizeof(LinkAnswer));
    if (const Status& done = stream_.wait(); !done) return done.error();
    if (answer_->frame != job_.frame) {
      return Error{Errc::unavailable, "GPU " + std::to_string(stream_.gpu()) + " does not answer"};
    }
    if (answer_->does_not_fit != 0) return false;
    std::copy_n(pixels_, raw_.pixels().size(), frame.pixels.begin());
    return true;
  }

 private:
  gpu::Memory memory_;
  gpu::Stream stream_;
  RawFrameCuda raw_;
  LinkJob job_;
  std::size_t num_links_ = 0;
  int num_blocks_ = 0;
  LinkPose *poses_ = nullptr, *poses_on_gpu_ = nullptr;
  std::uint16_t* pixels_ = nullptr;
  LinkAnswer* answer_ = nullptr;
};

}  // namespace

Result<std::unique_ptr<LinksOnGpu>> make_links_on_gpu(std::span<const RobotLink> links,
                                                      const Intrinsics& intrinsics, int width,
                                                      int height, double padding, int gpu) {
  if (const Status status = gpu::check_gpu(gpu); !status) return status.error();
  auto made = std::make_unique<LinksOnGpuCuda>(links, intrinsics, width, height, padding, gpu);
  if (const Status status = made->status(); !status) return status.error();
  return std::unique_ptr<LinksOnGpu>(std::move(made));
}

}}  // namespace palpate::v0
