// A depth field of one cloud that does not change.
#pragma once

#include <utility>

#include "palpate/field/depth_field.h"
#include "palpate/field/sensor.h"

namespace palpate::test {

/// A field with the cloud it comes from.
struct FrozenField {
  PointCloud cloud;
  DepthField field;

  explicit FrozenField(PointCloud from, const DepthFieldOptions& options = {})
      : cloud(std::move(from)),
        field(std::move(DepthField::create(cloud.width(), cloud.height(), options)).value()) {
    ThreadPool pool(1);
    field.update(cloud.view(), pool);
  }

  SurfaceView surface() const { return {{}, field.view()}; }
};

}  // namespace palpate::test
