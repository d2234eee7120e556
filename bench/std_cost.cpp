// Cost of standard deviations: queries with and without them, and with and without the
// stiffness, by turns on one thread; the least processor time of each, in us.
//
//   std_cost [ROUNDS]
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/field/sensor.h"
#include "src/math/internal/random.h"

namespace {

using namespace palpate;

constexpr int kWide = 320, kHigh = 240;
constexpr Intrinsics kEye{300, 300, 159.5, 119.5};
constexpr double kNoise = 0.0008;  // m

double microseconds() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return 1e6 * static_cast<double>(time.tv_sec) + 1e-3 * static_cast<double>(time.tv_nsec);
}

/// A slanted plane at 0.6 m with white noise.
std::vector<float> slanted_plane() {
  Random random(3);
  std::vector<float> depth;
  for (int v = 0; v < kHigh; ++v) {
    for (int u = 0; u < kWide; ++u) {
      const double x = (u - kEye.cx) / kEye.fx, y = (v - kEye.cy) / kEye.fy;
      double normal = -6;
      for (int i = 0; i < 12; ++i) normal += random.uniform(0, 1);
      depth.push_back(static_cast<float>(0.6 / (1 + 0.8 * x - 0.5 * y) + kNoise * normal));
    }
  }
  return depth;
}

struct Case {
  const char* name;
  Tool tool;
  Pose X_WT;
};

void measure(const Case& c, const SurfaceView& surface, Isa isa, int num_rounds) {
  const ContactWants wants[] = {
      {}, {.noise = true}, {.stiffness = true}, {.stiffness = true, .noise = true}};
  constexpr int num_calls = 4;
  const auto query =
      make_contact_query(Place::cpu(), c.tool, FieldMethod{}, {isa, nullptr}).value();
  double least[] = {1e9, 1e9, 1e9, 1e9};
  for (int round = 0; round < num_rounds; ++round) {
    for (int k = 0; k < 4; ++k) {
      const double start = microseconds();
      for (int i = 0; i < num_calls; ++i) query->measure(surface, c.X_WT, wants[k]);
      least[k] = std::min(least[k], (microseconds() - start) / num_calls);
    }
  }
  std::printf("%s,%s,%.1f,%.1f,%.1f,%.1f,%.0f %%,%.0f %%\n", isa == Isa::avx2 ? "AVX2" : "AVX-512",
              c.name, least[0], least[1], least[2], least[3], 100 * (least[1] / least[0] - 1),
              100 * (least[3] / least[2] - 1));
}

}  // namespace

int main(int argc, char** argv) {
  SurfaceOptions options;
  options.filter.smoothing = Smoothing::adaptive;
  Sensor sensor =
      Sensor::create({kWide, kHigh, kEye}, Place::cpu(), {.surface = options, .num_threads = 1})
          .value();
  const std::vector<float> depth = slanted_plane();
  const SurfaceView surface = sensor.update(DepthImageView(kWide, kHigh, depth.data()));
  const auto box = [](int num) {
    return Tool::pack(make_box({0.06, 0.04, 0.05}), {.max_spheres = num}).value();
  };
  const auto ball = [](double radius, int num) {
    return Tool::pack(make_icosphere(radius, 4), {.max_spheres = num}).value();
  };
  const Pose tilted{{0.01, 0.02, 0.595}, normalized(Quaternion{0.3, 0.2, 0.1, 0.9})};
  const Case cases[] = {{"box 1500", box(1500), tilted},
                        {"ball 1000", ball(0.03, 1000), {{0.01, 0.02, 0.6}, {}}},
                        {"box 17000", box(17000), tilted},
                        {"deep ball 17000", ball(0.04, 17000), {{0.01, 0.02, 0.64}, {}}}};
  std::printf("isa,case,query_us,with_std_us,with_stiffness_us,with_both_us,std,std_of_both\n");
  for (const Isa isa : {Isa::avx2, Isa::avx512}) {
    if (isa > best_isa()) continue;
    for (const Case& c : cases) measure(c, surface, isa, argc > 1 ? std::atoi(argv[1]) : 400);
  }
}
