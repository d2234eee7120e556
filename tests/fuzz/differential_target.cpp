// The same measurement by every implementation: on the CPU the vector instruction sets agree to the
// bit, the GPU (here its emulator) in counts and states, and in numbers but for the order of sums,
// and brute force in double within the rounding of single precision. The input chooses tool, scene,
// options and poses.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "palpate/cloud/surface_estimator.h"
#include "palpate/contact/contact.h"
#include "src/contact/backends.h"
#include "tests/fuzz/target.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/contact_truth.h"
#include "tests/test_util/field_truth.h"

namespace palpate::fuzz {
namespace {

constexpr int kWidth = 64, kHeight = 48;
const Intrinsics kCamera{56, 56, 31.5, 23.5};

/// Choices by the bytes of the input; when they are used up, by what they began with.
class Choices {
 public:
  explicit Choices(std::string_view bytes) : bytes_(bytes), random_(hash(bytes)) {}
  std::size_t below(std::size_t n) {
    const auto byte = at_ < bytes_.size() ? static_cast<unsigned char>(bytes_[at_++])
                                          : static_cast<unsigned char>(random_.bits());
    return byte % n;
  }
  template <class Enum>
  Enum any() {
    return static_cast<Enum>(below(names_of(Enum{}).size()));
  }
  test::Random& random() { return random_; }

 private:
  static std::uint64_t hash(std::string_view bytes) {
    std::uint64_t value = 0xcbf29ce484222325;
    for (const char c : bytes) value = (value ^ static_cast<unsigned char>(c)) * 0x100000001b3;
    return value;
  }
  std::string_view bytes_;
  std::size_t at_ = 0;
  test::Random random_;
};

DepthFrame any_frame(Choices& choices) {
  DepthFrame frame{kWidth, kHeight, 0.001, {}, 0};
  const int near = 500 + static_cast<int>(choices.below(100)),
            step = static_cast<int>(choices.below(200));
  const int bump = 1 + static_cast<int>(choices.below(30)),
            edge = static_cast<int>(choices.below(kWidth));
  const std::size_t holes = 2 + choices.below(200);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const int depth = near + (u * u / 7 + v * v / 5 + u * v / 9) % bump + (u > edge ? step : 0);
      const bool is_hole = choices.random().bits() % holes == 0;
      frame.pixels.push_back(static_cast<std::uint16_t>(is_hole ? 0 : depth));
    }
  }
  return frame;
}

SurfaceOptions any_surface(Choices& choices) {
  SurfaceOptions options;
  options.depth_change.enabled = choices.below(2) == 0;
  return options;
}

ContactOptions any_options(Choices& choices) {
  ContactOptions options{choices.any<MethodKind>(),   choices.any<Priority>(),
                         choices.any<InsideVolume>(), choices.any<SphereVolumes>(),
                         choices.any<Edges>(),        choices.any<Continuity>()};
  if (options.method != MethodKind::graph) options.inside = InsideVolume::full;
  if (options.method == MethodKind::graph) options.priority = Priority::distance;
  if (options.method == MethodKind::field) options = {.volumes = options.volumes};
  return options;
}

/// Surfaces as one instruction set estimates them.
struct Seen {
  SurfaceEstimator estimator;
  DepthField field;
  ThreadPool pool{1};

  Seen(const DepthFrame& frame, const SurfaceOptions& options, Isa isa)
      : estimator(SurfaceEstimator::create(kWidth, kHeight, kCamera, options, isa).value()),
        field(DepthField::create(kWidth, kHeight, {}, isa).value()) {
    estimator.update(frame, pool);
    field.update(estimator.cloud(), pool);
  }
  SurfaceView surfaces() const { return {estimator.cloud(), field.view()}; }
};

struct Answer {
  ContactResult result;
  std::vector<SphereState> states;
};

using MadeQuery = Result<std::unique_ptr<ContactQuery>>;

MadeQuery cpu_query(const Tool& tool, const ContactMethod& method, Isa isa) {
  ExecutionOptions execution;
  execution.isa = isa;
  return make_contact_query(Place::cpu(), tool, method, execution);
}

Answer evaluate(const MadeQuery& query, const SurfaceView& from, const SurfaceView& to,
                double alpha, const Pose& X_WT) {
  require(query.has_value(), "there is a query of every backend");
  Answer answer{{}, std::vector<SphereState>((*query)->index()->tool().spheres().size())};
  answer.result =
      (*query)->measure(from, to, alpha, X_WT, {.stiffness = true, .states = answer.states});
  return answer;
}

bool same_bits(const Answer& a, const Answer& b) {
  const Penetration &p = a.result.penetration, &q = b.result.penetration;
  const auto same = [](double x, double y) { return std::memcmp(&x, &y, sizeof x) == 0; };
  bool is_same = same(p.volume, q.volume) && same(p.potential, q.potential) &&
                 p.num_boundary_spheres == q.num_boundary_spheres &&
                 p.num_inside_spheres == q.num_inside_spheres && p.num_points == q.num_points &&
                 p.status == q.status && a.states == b.states &&
                 a.result.stiffness.has_value() == b.result.stiffness.has_value();
  for (int axis = 0; axis < 3; ++axis) {
    is_same = is_same && same(p.measure_W.force[axis], q.measure_W.force[axis]) &&
              same(p.measure_W.torque[axis], q.measure_W.torque[axis]);
  }
  if (is_same && a.result.stiffness) {
    is_same = std::memcmp(a.result.stiffness->m, b.result.stiffness->m, sizeof(Stiffness::m)) == 0;
  }
  return is_same;
}

bool agrees(const Answer& a, const Answer& b) {
  const Penetration &p = a.result.penetration, &q = b.result.penetration;
  const double scale = 1e-5 * std::max(p.volume, 1e-12), reach = 0.1;
  return p.num_boundary_spheres == q.num_boundary_spheres &&
         p.num_inside_spheres == q.num_inside_spheres && p.num_points == q.num_points &&
         p.status == q.status && a.states == b.states && std::abs(p.volume - q.volume) <= scale &&
         std::abs(p.potential - q.potential) <= scale * reach &&
         norm(p.measure_W.force - q.measure_W.force) <= scale &&
         norm(p.measure_W.torque - q.measure_W.torque) <= scale * reach;
}

/// Every sphere and every point by itself, in double.
void require_truth(const Tool& tool, const ContactOptions& options, const SurfaceView& seen,
                   const Pose& X_WT, const Answer& got) {
  const Penetration& p = got.result.penetration;
  const double scale = full_volume(tool, options), reach = 0.1;
  if (options.method == MethodKind::field) {
    const Penetration want = test::field_truth(tool, seen.field, X_WT, options.counted());
    require(std::abs(p.volume - want.volume) <= 1e-4 * scale &&
                std::abs(p.potential - want.potential) <= 1e-4 * scale * reach &&
                norm(p.measure_W.force - want.measure_W.force) <= 3e-4 * scale &&
                norm(p.measure_W.torque - want.measure_W.torque) <= 3e-4 * scale * reach,
            "the field method is its definition");
    return;
  }
  if (options.edges != Edges::none) return;  // of edges equally near either may be taken
  const test::ToolTruth whole(tool);
  const test::Truth want = test::contact_truth(
      whole, test::boundary_truth(whole.spheres, seen.cloud, X_WT, options.continuity), X_WT,
      options);
  require(p.num_points == want.penetration.num_points &&
              p.num_boundary_spheres == want.penetration.num_boundary_spheres &&
              got.states == want.states,
          "points are in the spheres that brute force says");
  require(std::abs(p.volume - want.penetration.volume) <= 2e-5 * scale &&
              norm(p.measure_W.force - want.penetration.measure_W.force) <= 2e-5 * scale &&
              norm(p.measure_W.torque - want.penetration.measure_W.torque) <= 2e-5 * scale * reach,
          "the methods of the thesis are their definitions");
}

}  // namespace

std::vector<std::string> seeds() {
  std::vector<std::string> all;
  test::Random random(3);
  for (int i = 0; i < 20; ++i) {
    std::string bytes(24, '\0');
    for (char& c : bytes) c = static_cast<char>(random.bits());
    all.push_back(bytes);
  }
  return all;
}

}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  using namespace palpate::fuzz;
  Choices choices(text_of(data, size));
  const Tool tool =
      test::random_tool(1 + static_cast<int>(choices.below(120)), 0.03, choices.below(16));
  const ContactOptions contact = any_options(choices);
  const auto made = contact_method(contact);
  require(made.has_value(), "options that belong to a method are taken");
  const ContactMethod& method = *made;
  const SurfaceOptions options = any_surface(choices);
  const DepthFrame first = any_frame(choices), second = any_frame(choices);
  const bool is_between = choices.below(3) == 0;
  const double alpha = is_between ? 0.3 : 1;
  const double z = 0.45 + 0.002 * static_cast<double>(choices.below(100));
  test::Random& random = choices.random();
  const Pose X_WT{{random.uniform(-0.1, 0.1), random.uniform(-0.1, 0.1), z}, random.rotation(3)};

  const Seen from(first, options, Isa::baseline), to(second, options, Isa::baseline);
  const Answer want =
      evaluate(cpu_query(tool, method, Isa::baseline), from.surfaces(), to.surfaces(), alpha, X_WT);
  const Penetration& p = want.result.penetration;
  require(std::isfinite(p.volume) && p.volume >= 0, "a volume is finite and not negative");
  require(norm(p.measure_W.force) <= 1.0500001 * p.volume, "no force is longer than its bound");
  if (!is_between) require_truth(tool, contact, to.surfaces(), X_WT, want);
  for (const Isa isa : {Isa::avx2, Isa::avx512}) {
    const Seen from_wide(first, options, isa), to_wide(second, options, isa);
    const Answer got = evaluate(cpu_query(tool, method, isa), from_wide.surfaces(),
                                to_wide.surfaces(), alpha, X_WT);
    require(same_bits(want, got), "all instruction sets give the same bits");
  }
#if defined(PALPATE_EMULATE_CUDA)
  const Answer gpu = evaluate(make_contact_query_cuda(ToolIndex::create(tool), method, 0),
                              from.surfaces(), to.surfaces(), alpha, X_WT);
  require(agrees(want, gpu), "the GPU agrees with the CPU");
#endif
  return 0;
}
