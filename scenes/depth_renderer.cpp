#include "scenes/depth_renderer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

namespace palpate { inline namespace v0 { namespace scenes {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct ReleaseScene {
  void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
};
struct ReleaseDevice {
  void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
};
using SceneHandle = std::unique_ptr<std::remove_pointer_t<RTCScene>, ReleaseScene>;
using DeviceHandle = std::unique_ptr<std::remove_pointer_t<RTCDevice>, ReleaseDevice>;

/// A mesh in its body frame, ready for rays.
SceneHandle build_tree(RTCDevice device, const TriangleMesh& mesh) {
  SceneHandle tree(rtcNewScene(device));
  rtcSetSceneFlags(tree.get(), RTC_SCENE_FLAG_ROBUST);
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0,
                                                               RTC_FORMAT_FLOAT3, 3 * sizeof(float),
                                                               mesh.vertices.size()));
  auto* indices = static_cast<std::uint32_t*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                              3 * sizeof(std::uint32_t), mesh.triangles.size()));
  for (const Vec3d& p : mesh.vertices) {
    for (int axis = 0; axis < 3; ++axis) *vertices++ = static_cast<float>(p[axis]);
  }
  for (const auto& triangle : mesh.triangles)
    indices = std::copy(triangle.begin(), triangle.end(), indices);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(tree.get(), geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(tree.get());
  return tree;
}

/// Rays of neighboring pixels travel together.
constexpr int kPacket = 8;

struct Packet {
  alignas(32) int valid[kPacket] = {};  ///< -1: cast this ray
  RTCRayHit8 query{};

  void set(int lane, const Vec3d& origin, const Vec3d& direction, double limit) {
    valid[lane] = -1;
    query.ray.org_x[lane] = static_cast<float>(origin.x);
    query.ray.org_y[lane] = static_cast<float>(origin.y);
    query.ray.org_z[lane] = static_cast<float>(origin.z);
    query.ray.dir_x[lane] = static_cast<float>(direction.x);
    query.ray.dir_y[lane] = static_cast<float>(direction.y);
    query.ray.dir_z[lane] = static_cast<float>(direction.z);
    query.ray.tfar[lane] = static_cast<float>(limit);
    query.ray.mask[lane] = ~0u;
    query.hit.geomID[lane] = RTC_INVALID_GEOMETRY_ID;
  }

  void cast(RTCScene tree) {
#if RTC_VERSION_MAJOR >= 4
    rtcIntersect8(valid, tree, &query);
#else
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    rtcIntersect8(valid, tree, &context, &query);
#endif
  }

  /// Index of the first triangle that the ray met, or -1.
  std::ptrdiff_t triangle(int lane) const {
    return query.hit.geomID[lane] == RTC_INVALID_GEOMETRY_ID
               ? -1
               : static_cast<std::ptrdiff_t>(query.hit.primID[lane]);
  }
};

/// Pixels [u0, u1) x [v0, v1).
struct Rectangle {
  int u0, u1, v0, v1;
};

/// The pixels a body can cover; all of them if it reaches behind the camera.
Rectangle covered(const Scene& scene, const Body& body, const Pose& X_WB) {
  const Intrinsics& k = scene.intrinsics;
  double u0 = kInfinity, u1 = -kInfinity, v0 = kInfinity, v1 = -kInfinity;
  const Mat3d R_WB = rotation_matrix(X_WB.rotation);
  for (const Vec3d& p_B : body.mesh.vertices) {
    const Vec3d p = R_WB * p_B + X_WB.translation;
    if (p.z < 1e-3) return {0, scene.width, 0, scene.height};
    const double u = k.cx + k.fx * p.x / p.z, v = k.cy + k.fy * p.y / p.z;
    u0 = std::min(u0, u), u1 = std::max(u1, u);
    v0 = std::min(v0, v), v1 = std::max(v1, v);
  }
  const auto pixel = [](double x, int size) {
    return static_cast<int>(std::clamp(x, 0.0, double(size)));
  };
  return {pixel(std::floor(u0), scene.width), pixel(std::ceil(u1) + 1, scene.width),
          pixel(std::floor(v0), scene.height), pixel(std::ceil(v1) + 1, scene.height)};
}

}  // namespace

struct DepthRenderer::Impl {
  Scene scene;
  DeviceHandle device;
  std::vector<SceneHandle> trees;  ///< one per body
  std::vector<float> still;        ///< depth of all that never moves in the camera
  std::vector<float> depth;
  Pose X_CW;

  Vec3d ray(int u, int v) const {
    const Intrinsics& k = scene.intrinsics;
    return {(u - k.cx) / k.fx, (v - k.cy) / k.fy, 1};
  }
  float& at(std::vector<float>& image, int u, int v) const {
    return image[static_cast<std::size_t>(v) * static_cast<std::size_t>(scene.width) +
                 static_cast<std::size_t>(u)];
  }

  void place_camera(double t);
  void draw_environment(std::vector<float>& image) const {
    if (!scene.environment) return;
    const Environment seen = scene.X_WC ? scene.environment->in_frame(X_CW) : *scene.environment;
    for (int v = 0; v < scene.height; ++v) {
      for (int u = 0; u < scene.width; ++u) {
        at(image, u, v) = static_cast<float>(first_hit(seen, ray(u, v)));
      }
    }
  }

  /// Rays are taken to the body frame. Directions have z = 1 in C, so that lengths along them are
  /// depths.
  void draw_body(std::size_t which, const Pose& X_WB, std::vector<float>& image) const {
    const TriangleMesh& mesh = scene.bodies[which].mesh;
    const Pose X_CB = scene.X_WC ? X_CW * X_WB : X_WB;
    const Pose X_BC = inverse(X_CB);
    const Mat3d R_BC = rotation_matrix(X_BC.rotation);
    const Vec3d& origin = X_BC.translation;
    const Rectangle pixels = covered(scene, scene.bodies[which], X_CB);
    for (int v = pixels.v0; v < pixels.v1; ++v) {
      for (int u = pixels.u0; u < pixels.u1; u += kPacket) {
        const int size = std::min(kPacket, pixels.u1 - u);
        std::array<Vec3d, kPacket> directions;
        Packet packet;
        for (int lane = 0; lane < size; ++lane) {
          Vec3d& direction = directions[static_cast<std::size_t>(lane)] = R_BC * ray(u + lane, v);
          const float z = at(image, u + lane, v);
          packet.set(lane, origin, direction, std::isnan(z) ? kInfinity : static_cast<double>(z));
        }
        packet.cast(trees[which].get());
        for (int lane = 0; lane < size; ++lane) {
          const std::ptrdiff_t hit = packet.triangle(lane);
          if (hit < 0) continue;
          // Embree works in single precision; the depth is that of the triangle's plane in double.
          const auto& [i, j, k] = mesh.triangles[static_cast<std::size_t>(hit)];
          const Vec3d& p = mesh.vertices[i];
          const Vec3d normal = cross(mesh.vertices[j] - p, mesh.vertices[k] - p);
          const Vec3d& direction = directions[static_cast<std::size_t>(lane)];
          at(image, u + lane, v) =
              static_cast<float>(dot(normal, p - origin) / dot(normal, direction));
        }
      }
    }
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
  // One thread builds the trees: frames are the same bits everywhere, and nobody else's core is
  // used.
  self.device.reset(rtcNewDevice("threads=1,set_affinity=0"));
  for (const Body& body : self.scene.bodies) {
    self.trees.push_back(build_tree(self.device.get(), body.mesh));
  }
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
