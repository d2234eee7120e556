#include "palpate/contact/body_contact.h"

#include "src/contact/bodies/body_pair.h"

namespace palpate { inline namespace v0 {
namespace {

void add_stiffness(const std::optional<Stiffness>& part, std::optional<Stiffness>& sum) {
  if (!part) return;
  if (!sum) sum.emplace();
  *sum += *part;
}

void add_measure(const Penetration& part, Penetration& sum) {
  sum.volume += part.volume;
  sum.measure_W.force += part.measure_W.force;
  sum.measure_W.torque += part.measure_W.torque;
  sum.status |= part.status;
}

}  // namespace

Penetration BodyMeasure::total() const {
  Penetration sum = cloud;
  sum.status |= bodies.status;
  if (bodies.volume > 0) add_measure(bodies, sum);
  return sum;
}

int BodyWorld::add_tool(const Tool& tool, std::unique_ptr<ContactQuery> cloud_query) {
  std::shared_ptr<const ToolIndex> index = cloud_query ? cloud_query->index() : nullptr;
  if (index == nullptr) index = ToolIndex::create(tool);
  return add({std::move(index), std::move(cloud_query), true, {}, {}, {}});
}

int BodyWorld::add_object(const Tool& object, const Pose& X_WB) {
  return add({ToolIndex::create(object), nullptr, false, X_WB, {}, {}});
}

int BodyWorld::add(Body body) {
  const int index = num_bodies();
  for (int other = 0; other < index; ++other) {
    if (at(other).moves || body.moves) {
      pairs_.push_back(
          {other, index,
           make_body_pair_query(Place::cpu(), at(other).index, body.index, {.method = method_})
               .value()});
    }
  }
  bodies_.push_back(std::move(body));
  return index;
}

Status BodyWorld::measure_pairs_by(const MakePairQuery& make) {
  std::vector<std::unique_ptr<BodyPairQuery>> queries;
  for (const Pair& pair : pairs_) {
    auto query = make(at(pair.a).index, at(pair.b).index);
    if (!query) return query.error();
    queries.push_back(std::move(*query));
  }
  for (std::size_t i = 0; i < pairs_.size(); ++i) pairs_[i].query = std::move(queries[i]);
  return Done{};
}

void BodyWorld::measure(std::span<const SurfaceBlend> cameras) noexcept {
  for (Pair& pair : pairs_) {
    const Body &a = at(pair.a), &b = at(pair.b);
    pair.query->start(a.X_WB, b.X_WB, a.wants.stiffness || b.wants.stiffness);
  }
  for (Body& body : bodies_) {
    body.measured = {};
    if (body.cloud_query == nullptr) continue;
    const ContactResult result = body.cloud_query->measure(cameras, body.X_WB, body.wants);
    body.measured.cloud = result.penetration;
    body.measured.stiffness = result.stiffness;
    body.measured.moments = result.moments;
    body.measured.noise = result.noise;
  }
  for (Pair& pair : pairs_) {
    Body &a = at(pair.a), &b = at(pair.b);
    const BodyPenetration shared = pair.query->finish();
    for (const auto& [body, part] : {std::pair{&a, &shared.on_a}, std::pair{&b, &shared.on_b}}) {
      add_measure(*part, body->measured.bodies);
      body->measured.bodies.num_boundary_spheres += part->num_boundary_spheres;
      body->measured.num_pairs += shared.num_pairs;
    }
    add_moments(shared.moments_a, a.measured.bodies_moments);
    add_moments(shared.moments_a, b.measured.bodies_moments);
    if (a.wants.stiffness) add_stiffness(shared.stiffness_a, a.measured.bodies_stiffness);
    if (b.wants.stiffness) add_stiffness(shared.stiffness_b, b.measured.bodies_stiffness);
  }
}

}}  // namespace palpate::v0
