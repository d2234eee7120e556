// A frozen depth frame for queries by every method.
#pragma once

#include <utility>

#include "palpate/cloud/depth_source.h"
#include "palpate/cloud/surface_estimator.h"
#include "palpate/contact/contact.h"
#include "palpate/field/depth_field.h"

namespace palpate::eval {

class FrozenFrame {
 public:
  /// Errors: an image that SurfaceEstimator rejects.
  static Result<FrozenFrame> create(const DepthStreamInfo& stream, const DepthFrame& frame,
                                    const SurfaceOptions& options = {});

  PointCloudView cloud() const { return surface_.cloud(); }
  DepthFieldView field() const { return field_.view(); }
  SurfaceView surfaces() const { return {cloud(), field()}; }

 private:
  FrozenFrame(SurfaceEstimator surface, DepthField field)
      : surface_(std::move(surface)), field_(std::move(field)) {}
  SurfaceEstimator surface_;
  DepthField field_;
};

}  // namespace palpate::eval
