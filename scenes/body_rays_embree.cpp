// Rays through a mesh by Embree, which searches in single precision; eight neighboring pixels at a
// time.
#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <type_traits>

#include "scenes/body_rays.h"

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

/// One thread builds the trees: frames are the same bits everywhere, and nobody else's core is
/// used.
DeviceHandle make_device() { return DeviceHandle(rtcNewDevice("threads=1,set_affinity=0")); }

}  // namespace

struct BodyRays::Impl {
  const TriangleMesh& mesh;
  DeviceHandle device = make_device();
  SceneHandle tree = build_tree(device.get(), mesh);
};

BodyRays::BodyRays(const TriangleMesh& mesh) : impl_(new Impl{mesh}) {}
BodyRays::BodyRays(BodyRays&&) noexcept = default;
BodyRays::~BodyRays() = default;

void BodyRays::draw(const ImageRays& rays, const Pose& X_CB, std::span<float> image) const {
  const TriangleMesh& mesh = impl_->mesh;
  const Pose X_BC = inverse(X_CB);
  const Mat3d R_BC = rotation_matrix(X_BC.rotation);
  const Vec3d& origin = X_BC.translation;
  const PixelBox pixels = rays.box_around(mesh.vertices, X_CB);
  for (int v = pixels.v0; v < pixels.v1; ++v) {
    for (int u = pixels.u0; u < pixels.u1; u += kPacket) {
      const int size = std::min(kPacket, pixels.u1 - u);
      std::array<Vec3d, kPacket> directions;
      Packet packet;
      for (int lane = 0; lane < size; ++lane) {
        Vec3d& direction = directions[static_cast<std::size_t>(lane)] =
            R_BC * rays.ray(u + lane, v);
        const float z = image[rays.index(u + lane, v)];
        packet.set(lane, origin, direction, std::isnan(z) ? kInfinity : static_cast<double>(z));
      }
      packet.cast(impl_->tree.get());
      for (int lane = 0; lane < size; ++lane) {
        const std::ptrdiff_t hit = packet.triangle(lane);
        if (hit < 0) continue;
        image[rays.index(u + lane, v)] =
            static_cast<float>(plane_depth(mesh, static_cast<std::size_t>(hit), origin,
                                           directions[static_cast<std::size_t>(lane)]));
      }
    }
  }
}

}}}  // namespace palpate::v0::scenes
