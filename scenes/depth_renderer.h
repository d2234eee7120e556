// Ray casting of a scene, many frames.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "scenes/scene.h"

namespace palpate { inline namespace v0 { namespace scenes {

/// Keeps the search trees of all bodies and the image of everything that never moves.
class DepthRenderer {
 public:
  explicit DepthRenderer(Scene scene);
  DepthRenderer(DepthRenderer&&) noexcept;
  DepthRenderer& operator=(DepthRenderer&&) noexcept;
  ~DepthRenderer();

  const Scene& scene() const;
  /// Exact depth of every pixel at time t; valid until the next call.
  std::span<const float> render(double t);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}}}  // namespace palpate::v0::scenes
