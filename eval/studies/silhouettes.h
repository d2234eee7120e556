// Shared parts of the figure `silhouettes`: a tool in the field, and the lengths of its
// forces.
#pragma once

#include <algorithm>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "eval/figure.h"
#include "eval/studies/speed.h"

namespace palpate::eval {

inline constexpr const char* kSilhouetteTool = "box";
inline constexpr double kSilhouetteToolSize = 0.06;  // m
inline constexpr double kBound = 1.05;               // times V: upper bound of |F| by construction
inline constexpr double kRounding = 1e-6;
inline constexpr double kCalm = 1.05, kLong = 1.1;  // times V

/// Also in the quick form: with few spheres the volume of a large one is bent at its center alone,
/// and the stiffness of a tool of 300 is up to twice as large.
inline constexpr int kSilhouetteSpheres = 2000;

/// Ratios |F| / V of contacts.
struct Ratios {
  std::vector<double> values;

  double worst() const { return values.empty() ? 0 : std::ranges::max(values); }
  double share_above(double limit) const {
    const auto num = std::ranges::count_if(values, [&](double x) { return x > limit + kRounding; });
    return values.empty() ? 0 : static_cast<double>(num) / static_cast<double>(values.size());
  }
  void add(const Ratios& other) {
    values.insert(values.end(), other.values.begin(), other.values.end());
  }
};

/// Force and volume of the field method.
class ContactProbe {
 public:
  static constexpr double kMinShare = 0.02;  ///< of the tool: less is no contact

  ContactProbe(std::unique_ptr<MethodQueries> query, const Tool& tool)
      : query_(std::move(query)), whole_(full_volume(tool, options_)), section_(section_of(tool)) {}

  /// Contact at a pose; nullopt: no contact.
  struct Contact {
    Vec3d force;
    double volume;
    double ratio() const { return norm(force) / volume; }
  };
  std::optional<Contact> operator()(const Pose& X_WT) {
    const Penetration at = query_->query(X_WT, options_);
    if (at.volume <= kMinShare * whole_) return std::nullopt;
    return Contact{at.measure_W.force, at.volume};
  }

  /// Returns the largest eigenvalue, by magnitude, of the force's stiffness at the last pose, over
  /// the section of the tool, which is the largest face of its box.
  double stiffness() const {
    const Stiffness k = query_->stiffness();
    // Power iteration: for a symmetric S, (S S)^n turns any vector to the axis of that eigenvalue.
    Vec3d axis{0.6, 0.48, 0.64};
    const auto times = [&](const Vec3d& v) {
      Vec3d out;
      for (int row = 0; row < 3; ++row) {
        for (int i = 0; i < 3; ++i) out[row] += 0.5 * (k.m[row][i] + k.m[i][row]) * v[i];
      }
      return out;
    };
    double largest = 0;
    for (int i = 0; i < 60; ++i) {
      const Vec3d next = times(axis);
      largest = norm(next);
      if (!(largest > 0)) return 0;
      axis = 1 / largest * next;
    }
    return largest / section_;
  }

 private:
  ContactOptions options_{.method = MethodKind::field};
  std::unique_ptr<MethodQueries> query_;
  static double section_of(const Tool& tool) {
    const Bounds box = bounds(tool.mesh());
    const Vec3d size = box.high - box.low;
    return std::max({size.x * size.y, size.y * size.z, size.z * size.x});
  }

  double whole_, section_;
};

inline Result<ContactProbe> probe_on(const FrozenFrame& frame, const Tool& tool) {
  auto query = query_on(frame, tool);
  return ContactProbe(std::move(query), tool);
}

/// Adds tables, numbers and claims of contacts with recorded frames.
Status add_recorded_contacts(FigureResult& result, Context& context);

}  // namespace palpate::eval
