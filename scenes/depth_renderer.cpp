#include "scenes/depth_renderer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

#include "scenes/body_rays.h"

namespace palpate { inline namespace v0 { namespace scenes {
struct DepthRenderer::Impl {
  Scene scene;
  std::vector<BodyRays> bodies;
  std::vector<float> still;  ///< depth of all that never moves in the camera
  std::vector<float> depth;
  Pose X_CW;

  ImageRays rays() const { return {scene.intrinsics, scene.width, scene.height}; }
  void place_camera(double t);
  void draw_environment(std::vector<float>& image) const {
    if (!scene.environment) return;
    const Environment seen = scene.X_WC ? scene.environment->in_frame(X_CW) : *scene.environment;
    for (int v = 0; v < scene.height; ++v) {
      for (int u = 0; u < scene.width; ++u) {
        image[rays().index(u, v)] = static_cast<float>(first_hit(seen, rays().ray(u, v)));
      }
    }
  }

  void draw_body(std::size_t which, const Pose& X_WB, std::vector<float>& image) const {
    bodies[which].draw(rays(), scene.X_WC ? X_CW * X_WB : X_WB, image);
  }
};

void DepthRenderer::Impl::place_camera(double t) {
  if (scene.X_WC) X_CW = inverse(scene.X_WC(t));
  still.assign(static_cast<std::size_t>(scene.width) * static_cast<std::size_t>(scene.height),
               std::numeric_limits<float>::quiet_NaN());
  draw_environment(still);
  for (std::size_t i = 0; i < scene.bodies.size(); ++i) {
    if (!scene.bodies[i].motion) draw_body(i, scene.bodies[i].X_WB, still);
  }
}

DepthRenderer::DepthRenderer(Scene scene) : impl_(std::make_unique<Impl>()) {
  Impl& self = *impl_;
  self.scene = std::move(scene);
  for (const Body& body : self.scene.bodies) self.bodies.emplace_back(body.mesh);
  self.place_camera(0);
}

DepthRenderer::DepthRenderer(DepthRenderer&&) noexcept = default;
DepthRenderer& DepthRenderer::operator=(DepthRenderer&&) noexcept = default;
DepthRenderer::~DepthRenderer() = default;

const Scene& DepthRenderer::scene() const { return impl_->scene; }

std::span<const float> DepthRenderer::render(double t) {
  Impl& self = *impl_;
  if (self.scene.is_camera_moving) self.place_camera(t);
  self.depth = self.still;
  for (std::size_t i = 0; i < self.scene.bodies.size(); ++i) {
    if (self.scene.bodies[i].motion) self.draw_body(i, self.scene.bodies[i].motion(t), self.depth);
  }
  return self.depth;
}

std::vector<float> render_depth(const Scene& scene, double t) {
  DepthRenderer renderer(scene);
  const std::span<const float> depth = renderer.render(t);
  return {depth.begin(), depth.end()};
}

}}}  // namespace palpate::v0::scenes
