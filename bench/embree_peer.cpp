// Embree: a tree of boxes over the points of a frame, one point query per sphere.
#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include "bench/peers.h"

namespace palpate::bench {
namespace {

/// Context of a query's callback.
struct Visit {
  const PointCloud& cloud;
  float squared_radius;
  SphereAnswer& answer;
};

bool holds(const Visit& visit, const RTCPointQuery& query, std::size_t i) {
  const Vec3f p = visit.cloud.point(i);
  const float dx = p.x - query.x, dy = p.y - query.y, dz = p.z - query.z;
  return dx * dx + dy * dy + dz * dz <= visit.squared_radius;
}

// Embree's callbacks for every point whose box meets the query's sphere; true: the radius of the
// query has changed.
bool add_point(RTCPointQueryFunctionArguments* arguments) {
  Visit& visit = *static_cast<Visit*>(arguments->userPtr);
  if (holds(visit, *arguments->query, arguments->primID)) {
    visit.answer.add(visit.cloud, arguments->primID);
  }
  return false;
}
bool stop_at_first(RTCPointQueryFunctionArguments* arguments) {
  Visit& visit = *static_cast<Visit*>(arguments->userPtr);
  if (visit.answer.num_points > 0 || !holds(visit, *arguments->query, arguments->primID)) {
    return false;
  }
  visit.answer.num_points = 1;
  arguments->query->radius = 0;
  return true;
}

void point_bounds(const RTCBoundsFunctionArguments* arguments) {
  const Vec3f p =
      static_cast<const PointCloud*>(arguments->geometryUserPtr)->point(arguments->primID);
  RTCBounds& bounds = *arguments->bounds_o;
  bounds.lower_x = bounds.upper_x = p.x;
  bounds.lower_y = bounds.upper_y = p.y;
  bounds.lower_z = bounds.upper_z = p.z;
}

class Embree : public BoundaryPeer {
 public:
  Embree(const PointCloud& cloud, EmbreeTree kind)
      : cloud_(cloud), kind_(kind), device_(rtcNewDevice("threads=1,set_affinity=0")) {
    if (device_ == nullptr) fail("Embree does not start");
  }
  ~Embree() override {
    if (scene_ != nullptr) rtcReleaseScene(scene_);
    rtcReleaseDevice(device_);
  }
  Embree(const Embree&) = delete;
  Embree& operator=(const Embree&) = delete;

  std::string name() const override {
    return kind_ == EmbreeTree::fast_to_query ? "Embree best tree" : "Embree quick tree";
  }

  void build() override {
    if (scene_ != nullptr) rtcReleaseScene(scene_);
    scene_ = rtcNewScene(device_);
    const RTCBuildQuality quality =
        kind_ == EmbreeTree::fast_to_query ? RTC_BUILD_QUALITY_MEDIUM : RTC_BUILD_QUALITY_LOW;
    rtcSetSceneBuildQuality(scene_, quality);
    RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_USER);
    rtcSetGeometryBuildQuality(geometry, quality);
    rtcSetGeometryUserPrimitiveCount(geometry, static_cast<unsigned>(cloud_.size()));
    // Embree passes it on unchanged; nothing writes to it.
    rtcSetGeometryUserData(geometry, const_cast<PointCloud*>(&cloud_));
    rtcSetGeometryBoundsFunction(geometry, point_bounds, nullptr);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene_, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene_);
    if (rtcGetDeviceError(device_) != RTC_ERROR_NONE) fail("Embree builds no tree of points");
  }

  void evaluate(Question question, std::span<const Sphere> spheres, const Pose& X_WT,
                std::span<SphereAnswer> answers) override {
    const RTCPointQueryFunction visit_point =
        question == Question::which ? stop_at_first : add_point;
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    query_all(spheres, X_WT, answers, [&](const Vec3f& c, float radius, SphereAnswer& answer) {
      Visit visit{cloud_, radius * radius, answer};
      RTCPointQuery query{c.x, c.y, c.z, 0, radius};
      rtcPointQuery(scene_, &query, &context, visit_point, &visit);
    });
  }

 private:
  const PointCloud& cloud_;
  EmbreeTree kind_;
  RTCDevice device_;
  RTCScene scene_ = nullptr;
};

}  // namespace

std::unique_ptr<BoundaryPeer> embree_tree(const PointCloud& cloud, EmbreeTree kind) {
  return std::make_unique<Embree>(cloud, kind);
}

}  // namespace palpate::bench
