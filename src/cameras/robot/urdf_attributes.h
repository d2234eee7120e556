// Attributes of the elements of a URDF file: names, numbers and poses, with errors that name the
// line. The readers of links, joints and shapes inherit from it.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include <tinyxml2.h>

#include "palpate/core/core.h"
#include "palpate/math/geometry.h"
#include "src/core/internal/message_text.h"
#include "src/io/internal/text_scanner.h"

namespace palpate { inline namespace v0 {

class UrdfAttributes {
 protected:
  using Element = tinyxml2::XMLElement;

  /// `name`: of the file, for errors. It must outlive this.
  explicit UrdfAttributes(const std::string& name) : name_(name) {}

  /// Returns an error with the line of the element.
  Error bad(const Element& where, const std::string& what) const {
    return {Errc::bad_input, name_ + " line " + std::to_string(where.GetLineNum()) + ": " + what};
  }

  /// Returns an attribute that must be there. Error: it is missing, empty or too long.
  Result<std::string> name_of(const Element& element, const char* attribute = "name") const {
    const char* const given = element.Attribute(attribute);
    if (given == nullptr || *given == '\0') {
      return bad(element, "<" + shown(element.Name()) + "> needs " + attribute + "=\"...\"");
    }
    std::string name(given);
    if (name.size() <= kLongestName) return name;
    return bad(element, "<" + shown(element.Name()) + "> has a longer " + attribute + " than " +
                            std::to_string(kLongestName) + " letters; give it a shorter one");
  }

  /// Reads the numbers of an attribute; returns `preset` if there is none of that name.
  template <std::size_t num>
  Result<std::array<double, num>> numbers(const Element& element, const char* attribute,
                                          std::optional<std::array<double, num>> preset) const {
    const char* const given = element.Attribute(attribute);
    if (given == nullptr && preset) return *preset;
    std::array<double, num> values{};
    std::string_view rest = given == nullptr ? "" : given;
    bool is_good = true;
    for (double& value : values) {
      const auto number = parse_number<double>(take_word(rest));
      is_good = is_good && number && std::abs(*number) <= kLargest;
      value = number.value_or(0);
    }
    if (is_good && take_word(rest).empty()) return values;
    return bad(element, "<" + shown(element.Name()) + "> needs " + attribute + " as " +
                            std::to_string(num) + " number" + (num > 1 ? "s" : "") +
                            " of at most 1000");
  }

  /// Returns the pose that <origin xyz rpy>, or in newer files <origin xyz quat_xyzw>, gives to the
  /// geometry of a link or to a joint.
  Result<Pose> origin_of(const Element& element) const {
    constexpr std::array<double, 3> kZero{};
    const Element* const origin = element.FirstChildElement("origin");
    if (origin == nullptr) return Pose{};
    const auto xyz = numbers<3>(*origin, "xyz", kZero), rpy = numbers<3>(*origin, "rpy", kZero);
    if (!xyz) return xyz.error();
    if (!rpy) return rpy.error();
    const Vec3d p{(*xyz)[0], (*xyz)[1], (*xyz)[2]};
    if (origin->Attribute("quat_xyzw") != nullptr) {
      const auto q = numbers<4>(*origin, "quat_xyzw", std::nullopt);
      if (!q) return q.error();
      const double length = std::hypot(std::hypot((*q)[0], (*q)[1]), std::hypot((*q)[2], (*q)[3]));
      if (std::abs(length - 1) > 0.01 || origin->Attribute("rpy") != nullptr) {
        return bad(*origin, "<origin> needs either rpy or quat_xyzw with a quaternion 1 long");
      }
      return Pose{p, normalized(Quaternion{(*q)[0], (*q)[1], (*q)[2], (*q)[3]})};
    }
    const Quaternion turned = axis_angle({0, 0, 1}, (*rpy)[2]) * axis_angle({0, 1, 0}, (*rpy)[1]) *
                              axis_angle({1, 0, 0}, (*rpy)[0]);
    return Pose{p, normalized(turned)};
  }

  const std::string& name_;

 private:
  static constexpr std::size_t kLongestName = 4096;  // as a path may be
  static constexpr double kLargest = 1e3;            // m, and times as large
};

}}  // namespace palpate::v0
