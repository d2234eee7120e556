// The field method as tests query it: one field and pose after the other, on the CPU or a GPU.
#pragma once

#include <algorithm>
#include <utility>

#include "eval/studies/method_queries.h"
#include "src/contact/backends.h"

namespace palpate::test {

class FieldProbe {
 public:
  explicit FieldProbe(eval::MethodQueries queries) : queries_(std::move(queries)) {}

  void set_field(const DepthFieldView& field) { queries_.set_field(field); }
  Penetration measure(const Pose& X_WT, SphereVolumes volumes) {
    return queries_.query(X_WT, {.method = MethodKind::field, .volumes = volumes});
  }
  Penetration measure(const Pose& X_WT, SphereVolumes volumes, const DepthFieldView& from,
                      const DepthFieldView& to, double t) {
    queries_.set_blend({{{}, from}, {{}, to}, t});
    return measure(X_WT, volumes);
  }
  Stiffness stiffness() { return queries_.stiffness(); }
  VolumeMoments moments() { return queries_.moments(); }
  void describe(std::span<SphereState> states, std::span<Plane<float>> planes) {
    std::ranges::copy(queries_.states(), states.begin());
    std::ranges::copy(queries_.planes(), planes.begin());
  }

 private:
  eval::MethodQueries queries_;
};

/// `tool` and `pool` must outlive it.
inline FieldProbe cpu_probe(const Tool& tool, ThreadPool& pool, Isa isa) {
  return FieldProbe(eval::MethodQueries(Backend::cpu, tool, ExecutionOptions{isa, &pool}));
}

inline eval::MethodQueries cuda_queries(const Tool& tool) {
  return {ToolIndex::create(tool),
          [](std::shared_ptr<const ToolIndex> index, const ContactMethod& method) {
            return make_contact_query_cuda(std::move(index), method, {});
          }};
}
inline FieldProbe cuda_probe(const Tool& tool) { return FieldProbe(cuda_queries(tool)); }

}  // namespace palpate::test
