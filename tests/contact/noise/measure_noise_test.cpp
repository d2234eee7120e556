#include <cstdio>

#include <gtest/gtest.h>

#include "src/contact/noise/noise_model.h"
#include "tests/contact/noise/noise_study.h"
#include "tests/test_util/contact_scenes.h"

namespace palpate {
namespace {
using namespace test;

struct Way { const char* name; SurfaceOptions options; };

TEST(MeasureNoise, Study) {
  const Tool ball = Tool::pack(make_icosphere(0.03, 4), {.max_spheres = 1000}).value();
  const Tool box = Tool::pack(make_box({0.06, 0.04, 0.05}), {.max_spheres = 2000}).value();
  const Tool big = Tool::pack(make_icosphere(0.08, 4), {.max_spheres = 3000}).value();
  const Tool small = Tool::pack(make_icosphere(0.008, 4), {.max_spheres = 200}).value();
  struct Case { const char* name; const Tool* tool; Pose pose; };
  const Quaternion turned = normalized(Quaternion{0.3, 0.2, 0.1, 0.9});
  const Case cases[] = {{"ball 5mm in", &ball, {{0.01, 0.02, 0.575}, {}}},
                        {"ball half", &ball, {{0.01, 0.02, 0.6}, {}}},
                        {"ball deep", &ball, {{0.01, 0.02, 0.66}, {}}},
                        {"box", &box, {{-0.05, 0.02, 0.595}, turned}},
                        {"big", &big, {{0.0, 0.0, 0.55}, {}}},
                        {"small", &small, {{0.02, 0.0, 0.597}, {}}}};
  struct S { const char* name; Scene depth; };
  const S scenes[] = {{"plane", [](double, double) { return 0.6; }},
                      {"slant", [](double x, double y) { return 0.6 / (1 + 0.8 * x - 0.5 * y); }},
                      {"waves", [](double x, double y) { return 0.6 + 0.006 * std::sin(60 * x) * std::cos(50 * y); }}};
  for (int side : {1, 3}) {
    const double sd = 0.0008;
    const double length = side == 1 ? 0 : 3 / std::sqrt(2 * 3.14159265);
    DepthNoise known{sd, 0, length};
    SurfaceOptions off; off.filter.enabled = false; off.noise = known;
    SurfaceOptions bilateral; bilateral.noise = known;
    SurfaceOptions adaptive; adaptive.filter.smoothing = Smoothing::adaptive; adaptive.noise = known;
    SurfaceOptions learned; learned.filter.smoothing = Smoothing::adaptive;
    const Way ways[] = {{"off", off}, {"bilateral", bilateral}, {"adaptive", adaptive}, {"learned", learned}};
    for (const S& scene : scenes) {
      std::vector<float> clean(static_cast<std::size_t>(kWide * kHigh));
      for (int v = 0; v < kHigh; ++v) for (int u = 0; u < kWide; ++u)
        clean[static_cast<std::size_t>(v * kWide + u)] = static_cast<float>(scene.depth((u - kEye.cx) / kEye.fx, (v - kEye.cy) / kEye.fy));
      std::vector<std::vector<float>> frames;
      Random random(7);
      for (int i = 0; i < 24; ++i) {
        frames.push_back(unit_noise(random, side));
        for (std::size_t p = 0; p < clean.size(); ++p) frames.back()[p] = clean[p] + static_cast<float>(sd) * frames.back()[p];
      }
      for (const Way& way : ways) {
        Sensor sensor = Sensor::create({kWide, kHigh, kEye}, Place::cpu(), {.surface = way.options, .num_threads = 1}).value();
        constexpr int kPlaces = 9;
        std::vector<NoiseStudy> studies(kPlaces * std::size(cases));
        std::vector<Contact> contacts;
        for (const Case& c : cases) contacts.push_back(Contact::create(*c.tool).value());
        SurfaceView s;
        for (const auto& frame : frames) {
          s = sensor.update(DepthImageView(kWide, kHigh, frame.data()));
          for (std::size_t i = 0; i < std::size(cases); ++i)
          for (int p = 0; p < kPlaces; ++p) {
            Pose X = cases[i].pose;
            X.translation.x += 0.09 * (p % 3 - 1);
            X.translation.y += 0.07 * (p / 3 - 1);
            const double x = X.translation.x / X.translation.z, y = X.translation.y / X.translation.z;
            X.translation.z += scene.name[0] == 's' ? scene.depth(x, y) - 0.6 : 0;
            studies[i * kPlaces + static_cast<std::size_t>(p)].add(contacts[i].measure(s, X, {.noise = true}));
          }
        }
        if (way.name[0] == 'l') {
          const NoiseScales n = noise_scales(*s.field.noise, 0.6f);
          for (int k = 0; k < 5; ++k) std::printf("%.3f/%.3f ", 1e3f * (s.field.noise->base[k] + 0.36f * s.field.noise->growth[k]), 1e3f * std::sqrt(n.variance[k]));
          std::printf("\n");
        }
        for (std::size_t i = 0; i < std::size(cases); ++i) {
          std::printf("%d %-6s %-10s %-12s", side, scene.name, way.name, cases[i].name);
          std::vector<double> all[3];
          for (int k = 0; k < 7; ++k) {
            std::vector<double> e;
            for (int p = 0; p < kPlaces; ++p) for (double x : studies[i * kPlaces + static_cast<std::size_t>(p)].errors(k)) if (std::isfinite(x)) e.push_back(x), all[k == 0 ? 0 : k < 4 ? 1 : 2].push_back(x);
            std::printf(" %.2f", rms(e));
          }
          for (const auto& e : all) std::printf(" | %.0f %.0f", 100 * share_within(e, 1), 100 * share_within(e, 2));
          std::printf("\n");
        }
      }
    }
  }
}

}  // namespace
}  // namespace palpate
