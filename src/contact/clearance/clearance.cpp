#include "src/contact/clearance/clearance.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "src/contact/hull/camera_seats.h"
#include "src/contact/index/tool_parts.h"
#include "src/core/internal/select_isa.h"

namespace palpate { inline namespace v0 {
PALPATE_DECLARE_KERNELS(void find_nearest(const ClearanceJob&, ClearanceHit&);
                        void screen_poses(PoseScreen&);
                        constexpr ClearanceKernels kClearance{find_nearest, screen_poses};)

namespace {

constexpr ClearanceKernels kKernels[] = PALPATE_BY_ISA(kClearance);

Error refused(std::size_t surface, const std::string& why) {
  return {Errc::invalid_argument,
          "surface " + std::to_string(surface) + " of a scene asked for clearance " + why};
}

}  // namespace

ClearanceKernels clearance_kernels(Isa isa) { return select_isa(kKernels, isa); }

Status check_searched(std::span<const SurfaceView> surfaces, int gpu) {
  const bool is_alone = surfaces.size() == 1;
  for (std::size_t k = 0; k < surfaces.size(); ++k) {
    const SurfaceView& surface = surfaces[k];
    const DepthFieldView& field = surface.field;
    if (field.num_levels == 0) return refused(k, "has no depth field: its image was refused");
    if (field.gpu != kHostMemory && field.gpu != gpu) {
      return refused(k, "lies in the memory of GPU " + std::to_string(field.gpu) +
                            ", where it is not searched; make it where the contact is");
    }
    if (!field.requested.has_all(field.levels[0].width, field.levels[0].height)) {
      return refused(k, "is known in a window of its image only; make it whole");
    }
    if (is_remembered(surface) || (has_in_front(surface) && !is_alone)) {
      return refused(k,
                     "is joined with others and has a memory, which is not searched; make it "
                     "without, or give it alone");
    }
    if (!is_alone && surface.seen_free.num_levels == 0) {
      return refused(k,
                     "is joined with others without SurfaceView::seen_free; make it with "
                     "DepthFieldOptions::one_of_several");
    }
  }
  return Done{};
}

std::vector<SeenByCamera> seen_by(std::span<const SurfaceView> surfaces,
                                  std::span<const ClearanceImage* const> images) {
  const bool is_alone = surfaces.size() == 1;
  std::vector<SeenByCamera> cameras;
  for (std::size_t k = 0; k < surfaces.size(); ++k) {
    SeenByCamera& camera = cameras.emplace_back();
    camera.X_WC = {surfaces[k].X_WC.translation, normalized(surfaces[k].X_WC.rotation)};
    camera.X_CW = inverse(camera.X_WC);
    camera.number = static_cast<std::int32_t>(k);
    camera.is_joined = is_alone ? 0 : 1;
    camera.field = *images[2 * k];
    if (images[2 * k + 1] == nullptr) continue;
    if (!is_alone) {
      camera.seen_free = *images[2 * k + 1];
    } else {  // what is in front of what is remembered, as by another camera
      SeenByCamera in_front = camera;
      in_front.field = *images[2 * k + 1];
      cameras.push_back(in_front);
    }
  }
  return cameras;
}

Status ClearanceScene::update(std::span<const SurfaceView> surfaces,
                              std::span<const SearchedBody> bodies, ThreadPool& pool) {
  if (const Status status = check_searched(surfaces, kHostMemory); !status) return status;
  const std::size_t num = 2 * surfaces.size();
  frames_.resize(num);
  thickness_.resize(num);
  std::vector<const ClearanceImage*> images(num);
  pool.parallel_for(static_cast<int>(num), [&](int task) {
    const auto at = static_cast<std::size_t>(task);
    const auto [view, is_blocked] = images_of(surfaces[at / 2], surfaces.size() == 1)[at % 2];
    if (view == nullptr) return;
    ClearanceFrame& frame = frames_[at];
    images[at] = &frame.image();
    if (view->stamp != 0 && frame.stamp() == view->stamp && thickness_[at] == view->thickness) {
      return;
    }
    thickness_[at] = view->thickness;
    frame.update(*view, is_blocked);
  });
  cameras_ = seen_by(surfaces, images);
  bodies_.assign(bodies.begin(), bodies.end());
  num_surfaces_ = static_cast<int>(surfaces.size());
  return Done{};
}

void ClearanceScene::place(PoseScreen& screen, const ClearanceKernels& kernels) const noexcept {
  screen.cameras = cameras_.data();
  screen.num_cameras = static_cast<int>(cameras_.size());
  if (!cameras_.empty()) return kernels.screen_poses(screen);
  std::fill_n(screen.least, screen.num, screen.limit);
  std::fill_n(screen.change, screen.num, 0.0f);
}

ClearanceQuery::ClearanceQuery(const ToolIndex& index, Isa isa)
    : tool_(clearance_tool(index.tool())), kernels_(clearance_kernels(isa)) {
  job_.spheres = view_of(parts_of(index).clusters());
}

ClearanceTool clearance_tool(const Tool& tool) {
  ClearanceTool made{tool.spheres().data(), tool.sphere_mass().center_of_mass, 0, {}};
  Vec3f low{1e30f, 1e30f, 1e30f}, high = -low;
  for (const Sphere& sphere : tool.spheres()) {
    made.reach =
        std::max(made.reach, norm(to_double(sphere.center)) + static_cast<double>(sphere.radius));
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], sphere.center[axis] - sphere.radius);
      high[axis] = std::max(high[axis], sphere.center[axis] + sphere.radius);
    }
  }
  made.ball.center = (low + high) * 0.5f;
  for (const Sphere& sphere : tool.spheres()) {
    const float distance = norm(sphere.center - made.ball.center);
    made.ball.reach = std::max(made.ball.reach, (distance + sphere.radius) * 1.00001f);
  }
  return made;
}

namespace {

Pose unit(const Pose& X_WT) { return {X_WT.translation, normalized(X_WT.rotation)}; }

}  // namespace

ClearanceHit ClearanceQuery::search(ClearanceJob job, const PoseScreen& screen,
                                    int i) const noexcept {
  ClearanceHit hit;
  if (screen.least[i] >= job.limit) return hit;
  ClearanceCamera cameras[kMaxCameras];
  screen.put_cameras(i, cameras);
  job.cameras = cameras;
  job.num_cameras = screen.num_cameras;
  kernels_.find_nearest(job, hit);
  return hit;
}

void ClearanceQuery::add_bodies(const ClearanceScene& scene, const Pose& X_WT,
                                Clearance& least) const noexcept {
  std::int32_t decider = scene.num_surfaces();
  for (const SearchedBody& body : scene.bodies()) {
    for_spheres_near(body, job_.spheres, tool_, X_WT, least.value,
                     [&](std::int32_t sphere, const PointDistance& at) {
                       const auto radius = static_cast<double>(tool_.spheres[sphere].radius);
                       if (!(at.phi - radius < least.value)) return;
                       least = clearance_to_body(body, decider, at, tool_, sphere, X_WT);
                     });
    ++decider;
  }
}

Clearance ClearanceQuery::measure(const ClearanceScene& scene, const PoseScreen& screen, int i,
                                  double limit, double below) const noexcept {
  ClearanceJob job = job_;
  job.deepest = static_cast<float>(limit);
  job.limit = below < limit ? screen.pixel_limit(i, below) : job.deepest;
  const ClearanceHit hit = search(job, screen, i);
  if (hit.kind == ClearanceKind::nothing && scene.bodies().empty()) return {limit};
  const Pose X = unit(screen.X_WT[i]);
  Clearance least = clearance_of(scene.cameras().data(), tool_, hit, X, limit);
  add_bodies(scene, X, least);
  if (least.value <= -limit) least = {-limit};
  return least;
}

Clearance ClearanceQuery::measure_softly(const ClearanceScene& scene, const PoseScreen& screen,
                                         int i, double limit, double smoothing,
                                         std::vector<ClearanceHit>& each) const {
  Clearance least = measure(scene, screen, i, limit, limit);
  if (least.sphere < 0) return least;
  const Pose X = unit(screen.X_WT[i]);
  SoftMinimum soft(least.value, limit, smoothing);
  const std::span<const SeenByCamera> seen = scene.cameras();
  ClearanceJob job =
      margin_job(job_, seen.data(), static_cast<int>(seen.size()), tool_, X, soft.reach);
  job.enough = -1e9f;
  job.deepest = static_cast<float>(limit);
  each.assign(static_cast<std::size_t>(job_.spheres.num_spheres), {job.limit});
  job.each = each.data();
  (void)search(job, screen, i);
  for (const ClearanceHit& hit : each) soft.add(clearance_of(seen.data(), tool_, hit, X, limit));
  for (const SearchedBody& body : scene.bodies()) {
    for_spheres_near(body, job_.spheres, tool_, X, soft.reach,
                     [&](std::int32_t sphere, const PointDistance& at) {
                       soft.add(clearance_to_body(body, 0, at, tool_, sphere, X));
                     });
  }
  soft.put(least);
  return least;
}

bool ClearanceQuery::is_within(const ClearanceScene& scene, const PoseScreen& screen, int i,
                               double margin) const noexcept {
  ClearanceJob job = job_;
  const auto middle = static_cast<float>(margin);
  job.limit = middle + screen.change[i];
  job.enough = middle - screen.change[i];
  job.deepest = std::abs(middle) + screen.change[i];
  const ClearanceHit hit = search(job, screen, i);
  if (hit.kind == ClearanceKind::nothing && scene.bodies().empty()) return false;
  const Pose X = unit(screen.X_WT[i]);
  if (is_hit_within(scene.cameras().data(), tool_, hit, job, X, margin)) return true;
  Clearance least{margin};
  add_bodies(scene, X, least);
  return least.value < margin;
}

}}  // namespace palpate::v0
