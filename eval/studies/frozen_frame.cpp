#include "eval/studies/frozen_frame.h"

#include <utility>

namespace palpate::eval {

Result<FrozenFrame> FrozenFrame::create(const DepthStreamInfo& stream, const DepthFrame& frame,
                                        const SurfaceOptions& options) {
  auto surface = SurfaceEstimator::create(stream.width, stream.height, stream.intrinsics, options);
  if (!surface) return surface.error();
  auto field = DepthField::create(stream.width, stream.height);
  if (!field) return field.error();
  ThreadPool pool(0);
  surface->update(frame, pool);
  field->update(surface->cloud(), pool);
  return FrozenFrame(*std::move(surface), *std::move(field));
}

}  // namespace palpate::eval
