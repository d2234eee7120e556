// Several bodies at once: any number of moving tools and of rigid objects around one cloud.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "palpate/contact/body_contact.h"
#include "palpate/contact/contact_query.h"

namespace palpate {

/// What one body feels: the cloud, and all other bodies together.
struct BodyMeasure {
  Penetration cloud;
  std::optional<Stiffness> stiffness;  ///< of `cloud`, if it was wanted
  VolumeMoments moments;               ///< likewise
  Penetration bodies;                  ///< sum over the other bodies, see BodyPenetration
  /// Of `bodies` while they stay, likewise, by BodyMethod::field.
  std::optional<Stiffness> bodies_stiffness;
  std::int64_t num_pairs = 0;  ///< sum of BodyPenetration::num_pairs with other bodies

  /// Volume and wrench of both shares; counts and potential of the cloud alone. What lies both in
  /// the cloud and in another body counts in both. Away from other bodies, the bits of `cloud`.
  Penetration total() const;
};

/// Moving tools feel the cloud, each other and the objects; objects stay where they are put and
/// feel the tools. Bodies are known by the number that adding them returned: 0, 1, ...
class BodyWorld {
 public:
  /// `method`: how bodies are measured against each other.
  explicit BodyWorld(BodyMethod method = BodyMethod::field) : method_(method) {}

  /// A tool that moves. `cloud_query` measures it against the cloud; null: it feels bodies alone.
  /// `tool` must outlive the world.
  int add_tool(const Tool& tool, std::unique_ptr<ContactQuery> cloud_query);
  int add_tool(const Tool&&, std::unique_ptr<ContactQuery>) = delete;
  /// An object that stays where it is. `object` must outlive the world.
  int add_object(const Tool& object, const Pose& X_WB);
  int add_object(const Tool&&, const Pose&) = delete;

  /// How a pair of bodies is measured; see make_body_pair_query.
  using MakePairQuery = std::function<Result<std::unique_ptr<BodyPairQuery>>(
      std::shared_ptr<const ToolIndex> a, std::shared_ptr<const ToolIndex> b)>;
  /// Lets other queries than those on the CPU measure the pairs of the bodies added so far, e.g. on
  /// a GPU: there, pairs are measured all at once, and at the same time as the cloud. Error: the
  /// first one of `make`; nothing has changed then.
  Status measure_pairs_by(const MakePairQuery& make);

  int num_bodies() const { return static_cast<int>(bodies_.size()); }
  const Pose& pose(int body) const { return at(body).X_WB; }
  void set_pose(int body, const Pose& X_WB) noexcept { at(body).X_WB = X_WB; }
  /// What the next measurements give for a tool beside its penetration.
  void set_wants(int body, const ContactWants& wants) noexcept { at(body).wants = wants; }

  /// Measures every tool against the surface and every pair of bodies once, except two objects. No
  /// allocation; the same bits for the same poses and surface.
  void measure(const SurfaceView& surface) noexcept { measure(surface, surface, 1); }
  /// Between two surfaces, as ContactQuery.
  void measure(const SurfaceView& from, const SurfaceView& to, double alpha) noexcept {
    const SurfaceBlend camera{from, to, alpha};
    measure({&camera, 1});
  }
  /// Against cameras, as ContactQuery.
  void measure(std::span<const SurfaceBlend> cameras) noexcept;
  /// Of the last `measure`.
  const BodyMeasure& measured(int body) const { return at(body).measured; }

 private:
  struct Body {
    std::shared_ptr<const ToolIndex> index;
    std::unique_ptr<ContactQuery> cloud_query;  // null: does not feel the cloud
    bool moves;
    Pose X_WB;
    ContactWants wants;
    BodyMeasure measured;
  };
  struct Pair {
    int a, b;
    std::unique_ptr<BodyPairQuery> query;
  };

  int add(Body body);
  Body& at(int body) { return bodies_[static_cast<std::size_t>(body)]; }
  const Body& at(int body) const { return bodies_[static_cast<std::size_t>(body)]; }

  BodyMethod method_;
  std::vector<Body> bodies_;
  std::vector<Pair> pairs_;
};

}  // namespace palpate
