// What contact queries know of a tool, whatever its pose.
#pragma once

#include <cstddef>
#include <memory>

#include "palpate/tool/tool.h"

namespace palpate {

/// Spheres in spatial order, the grid that finds the sphere of a point, the leaf graph in that
/// order, and the elements that ask the depth field: built once for a tool and shared by all its
/// queries and bodies, on any thread. Each part is built when a query first needs it, so that one
/// by `field` pays for the elements alone.
class ToolIndex {
 public:
  /// `tool` must outlive it. O(1).
  static std::shared_ptr<const ToolIndex> create(const Tool& tool);
  static std::shared_ptr<const ToolIndex> create(const Tool&&) = delete;
  ~ToolIndex();

  const Tool& tool() const { return *tool_; }
  /// Memory of the parts that have been built, bytes.
  std::size_t num_bytes() const;

  /// For the contact module: src/contact/index/tool_parts.h.
  struct Parts;
  const Parts& parts() const { return *parts_; }

 private:
  explicit ToolIndex(const Tool& tool);

  const Tool* tool_;
  std::unique_ptr<const Parts> parts_;
};

}  // namespace palpate
