// The parts of a tool's index, each built on first use.
#pragma once

#include <algorithm>
#include <atomic>
#include <mutex>
#include <optional>

#include "palpate/contact/contact.h"
#include "src/contact/index/path_lengths.h"
#include "src/contact/index/sorted_graph.h"
#include "src/contact/index/sphere_clusters.h"
#include "src/contact/index/sphere_grid.h"
#include "src/contact/index/volume_scales.h"
#include "src/contact/internal/field_elements.h"
#include "src/contact/points/donors/donor.h"
#include "src/contact/points/scan/image_window.h"

namespace palpate { inline namespace v0 {

/// A value made by the first thread that needs it; the others wait for it.
template <class Value>
class Lazy {
 public:
  template <class Make>
  const Value& get(Make&& make) const {
    std::call_once(once_, [&] {
      value_.emplace(make());
      is_there_.store(true, std::memory_order_release);
    });
    return *value_;
  }
  std::size_t num_bytes() const {
    return is_there_.load(std::memory_order_acquire) ? value_->num_bytes() : 0;
  }

 private:
  mutable std::once_flag once_;
  mutable std::optional<Value> value_;
  mutable std::atomic<bool> is_there_ = false;
};

struct ToolParts {
  explicit ToolParts(const Tool& of) : tool(of), box_T(bounds_of(of.spheres())) {}

  const SphereClusters& clusters() const {
    return clusters_.get([&] { return SphereClusters(tool.spheres()); });
  }
  const SphereGrid& grid() const {
    return grid_.get([&] { return SphereGrid(tool.spheres()); });
  }
  const SortedGraph& graph() const {
    return graph_.get([&] { return SortedGraph(tool.graph(), clusters().sphere_id); });
  }
  const PathLengths& paths() const {
    return paths_.get([&] { return PathLengths(tool); });
  }
  const VolumeScales& scales(SphereVolumes volumes) const {
    return scales_[static_cast<int>(volumes)].get(
        [&] { return VolumeScales(tool, clusters(), volumes); });
  }
  const FieldElements& elements(SphereVolumes volumes) const {
    return elements_[static_cast<int>(volumes)].get([&] { return FieldElements(tool, volumes); });
  }
  /// Returns the elements that sample the fields of other bodies.
  const FieldElements& solid_elements() const {
    return solid_elements_.get(
        [&] { return FieldElements(tool, SphereVolumes::represented, LargeSpheres::evenly); });
  }

  /// Returns the tool's field, or one made now.
  const SolidField& solid_field() const {
    if (tool.solid_field() != nullptr) return *tool.solid_field();
    return solid_field_.get([&] {
      ThreadPool pool(0);
      return SolidField::of(tool.mesh(), pool);
    });
  }

  std::size_t num_bytes() const {
    return clusters_.num_bytes() + grid_.num_bytes() + graph_.num_bytes() + paths_.num_bytes() +
           scales_[0].num_bytes() + scales_[1].num_bytes() + elements_[0].num_bytes() +
           elements_[1].num_bytes() + solid_elements_.num_bytes() + solid_field_.num_bytes();
  }

  /// `paths`: those of paths(), on the query's device; needed for Priority::path alone.
  PriorityRule priority_rule(Priority by, const float* paths) const {
    const Vec3d size = box_T.high - box_T.low;
    const double s = std::max({size.x, size.y, size.z}) / 12;
    return {by, 1 / (2 * s * s), paths, static_cast<std::int32_t>(tool.spheres().size())};
  }

  const Tool& tool;
  Bounds box_T;  ///< around the spheres

 private:
  Lazy<SphereClusters> clusters_;
  Lazy<SphereGrid> grid_;
  Lazy<SortedGraph> graph_;
  Lazy<PathLengths> paths_;
  Lazy<VolumeScales> scales_[2];     // by SphereVolumes
  Lazy<FieldElements> elements_[2];  // likewise
  Lazy<FieldElements> solid_elements_;
  Lazy<SolidField> solid_field_;  // if the tool brings none
};

/// Returns the parts of an index.
inline const ToolParts& parts_of(const ToolIndex& index) { return *index.parts_; }

}}  // namespace palpate::v0
