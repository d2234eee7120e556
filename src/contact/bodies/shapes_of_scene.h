// Data made for each shape of the bodies of a scene: kept as long as the next scene has the shape,
// too, and dropped with it.
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include "palpate/contact/body_contact.h"

namespace palpate { inline namespace v0 {

template <class Made>
class ShapesOfScene {
 public:
  /// Takes a scene with so many bodies, whose shapes are shape_of(number), and calls make(shape), a
  /// Result<Made>, for each one that the last scene did not have. No allocation if it had them all
  /// and no others. Error: the first one of `make`; then nothing is kept.
  template <class ShapeOf, class Make>
  Status take(std::size_t num_bodies, const ShapeOf& shape_of, const Make& make) {
    has_changed_ = !is_last(num_bodies, shape_of);
    if (!has_changed_) return Done{};
    std::vector<Kept> kept;
    shape_of_body_.clear();
    for (std::size_t b = 0; b < num_bodies; ++b) {
      const std::size_t number = find(kept, shape_of(b));
      shape_of_body_.push_back(number);
      if (number < kept.size()) continue;
      if (const std::size_t last = find(kept_, shape_of(b)); last < kept_.size()) {
        kept.push_back(std::exchange(kept_[last], {}));
        continue;
      }
      Result<Made> made = make(shape_of(b));
      if (!made) {
        *this = {};
        has_changed_ = true;
        return made.error();
      }
      kept.push_back({shape_of(b), *std::move(made)});
    }
    kept_ = std::move(kept);
    return Done{};
  }

  /// True if the last scene that was taken had other shapes than the one before.
  bool has_changed() const { return has_changed_; }
  std::size_t size() const { return kept_.size(); }
  const Made& of_shape(std::size_t shape) const { return kept_[shape].made; }
  std::size_t shape_of_body(std::size_t body) const { return shape_of_body_[body]; }
  const Made& of_body(std::size_t body) const { return of_shape(shape_of_body(body)); }

 private:
  using Shape = std::shared_ptr<const ToolIndex>;
  struct Kept {
    Shape shape;
    Made made{};
  };

  /// Returns the number of a shape, or how many there are.
  static std::size_t find(const std::vector<Kept>& kept, const Shape& shape) {
    std::size_t number = 0;
    while (number < kept.size() && kept[number].shape != shape) ++number;
    return number;
  }
  /// True if a scene has the shapes of the last one, in the order in which they first appear.
  template <class ShapeOf>
  bool is_last(std::size_t num_bodies, const ShapeOf& shape_of) {
    std::size_t num_found = 0;
    shape_of_body_.clear();
    for (std::size_t b = 0; b < num_bodies; ++b) {
      const std::size_t number = find(kept_, shape_of(b));
      if (number > num_found || number == kept_.size()) return false;
      num_found = std::max(num_found, number + 1);
      shape_of_body_.push_back(number);
    }
    return num_found == kept_.size();
  }

  std::vector<Kept> kept_;
  std::vector<std::size_t> shape_of_body_;
  bool has_changed_ = false;
};

}}  // namespace palpate::v0
