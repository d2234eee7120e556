// Friction against its goals, on a simulated clock: the same numbers on every machine, except the
// cost of a tick.
//   friction [CSV]
// 1. Creep of sticking contact at 95 % of mu N, over 60 s, without and with the noise of a camera.
// 2. The force of sliding against mu N, and the torque of turning against closed forms.
// 3. Energy given to a hand along closed paths.
// 4. The stiffest stable coupling with friction over that without (Z-width).
// 5. Cost of friction per tick.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/devices/devices.h"
#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"
#include "src/math/internal/rotation_vector.h"
#include "src/run/internal/pipeline.h"
#include "tests/test_util/random.h"

namespace palpate::bench {
namespace {

constexpr double kTick = 1e-3, kWall = 0.5, kMu = 0.5;
struct NamedCoupling {
  const char* name;
  CouplingKind kind;
};
constexpr NamedCoupling kCouplings[] = {{"virtual", CouplingKind::virtual_coupling},
                                        {"proxy", CouplingKind::proxy},
                                        {"direct", CouplingKind::direct},
                                        {"none", CouplingKind::none}};

std::FILE* csv = nullptr;
void row(const char* figure, const std::string& of, double value, const char* unit, double goal) {
  std::printf("%-16s %-34s %12.4g %-8s goal %g\n", figure, of.c_str(), value, unit, goal);
  std::fprintf(csv, "%s,%s,%.6g,%s,%g\n", figure, of.c_str(), value, unit, goal);
}

Tool packed(TriangleMesh mesh, int num_spheres) {
  return Tool::pack(std::move(mesh), {.max_spheres = num_spheres}).value();
}

RunSettings settings_of(CouplingKind kind, double mu = kMu) {
  RunSettings settings;
  settings.num_threads = 1;
  settings.coupling.kind = kind;
  settings.coupling.friction.coefficient = mu;
  return settings;
}

/// A hand on prescribed poses, before a wall in front of a camera of 30 Hz.
class Touch {
 public:
  Touch(const Tool& tool, const RunSettings& settings, double noise = 0) : noise_(noise) {
    info_.width = 160;
    info_.height = 120;
    info_.intrinsics = {150, 150, 79.5, 59.5};
    info_.unit = 1e-5;
    info_.rate = 30;
    DeviceInfo device;
    device.limits = find_device_model("sigma.7")->limits;
    pipeline_.emplace(Pipeline::create(tool, info_, device, settings).value());
  }
  const TickRecord& to(const Pose& X_BH) {
    const double time = kTick * static_cast<double>(num_ticks_);
    for (; num_frames_ / 30.0 <= time; ++num_frames_) {
      DepthFrame frame{info_.width, info_.height, info_.unit, {}, num_frames_ / 30.0};
      for (int i = 0; i < info_.width * info_.height; ++i) {
        const double z = kWall + noise_ * random_.normal();
        frame.pixels.push_back(static_cast<std::uint16_t>(std::lround(z / info_.unit)));
      }
      if (noise_ > 0 || num_frames_ < 2) pipeline_->push(frame, num_frames_ / 30.0);
    }
    DeviceState state;
    state.time = time;
    state.X_BH = X_BH;
    if (num_ticks_ > 0) {
      state.V_BH = {(X_BH.translation - last_.translation) / kTick,
                    rotation_between(last_.rotation, X_BH.rotation) / kTick};
    }
    last_ = X_BH;
    state.is_valid = true;
    ++num_ticks_;
    return pipeline_->tick(state);
  }

 private:
  double noise_;
  test::Random random_{5};
  DepthStreamInfo info_;
  std::optional<Pipeline> pipeline_;
  int num_frames_ = 0, num_ticks_ = 0;
  Pose last_;
};

double into(const TickRecord& tick) { return -tick.step.contact_W.force.z; }
Vec3d along(const TickRecord& tick) {
  return {tick.step.contact_W.force.x, tick.step.contact_W.force.y, 0};
}

// ----------------------------------------------------------------------------------- 1. creep

/// Foot of the tool on the wall, m: noise may tilt the rest of the tool.
constexpr Vec3d kFoot{0, 0, 0.02};

/// Loads the contact to `share` of its limit, by a force aside or a torque about the normal.
void creep_of(const Tool& tool, const NamedCoupling& coupling, double noise, bool turns,
              double share) {
  Touch touch(tool, settings_of(coupling.kind), noise);
  const auto hand = [&](double amount) {
    return Pose{{turns ? 0 : amount, 0, kWall - 0.02 + 5e-3},
                turns ? axis_angle({0, 0, 1}, amount) : Quaternion{}};
  };
  TickRecord tick;
  for (int i = 0; i < 500; ++i) {
    tick = touch.to({{0, 0, kWall - 0.022 + 7e-3 * std::min(1.0, i / 300.0)}, {}});
  }
  // Effective radius: limit of the torque over mu N, measured by turning until it slips.
  double radius = 0;
  if (turns) {
    Touch other(tool, settings_of(coupling.kind));
    TickRecord slipping;
    for (int i = 0; i < 2500; ++i) {
      Pose X = hand(i < 500 ? 0 : 5e-4 * (i - 500));
      if (i < 500) X.translation.z = kWall - 0.022 + 7e-3 * std::min(1.0, i / 300.0);
      slipping = other.to(X);
    }
    radius = std::abs(slipping.step.contact_W.torque.z) / (kMu * into(slipping));
  }
  double amount = 0;
  for (int i = 0; i < 20'000; ++i) {
    const double held = turns ? std::abs(tick.step.contact_W.torque.z) / radius : norm(along(tick));
    if (held >= share * kMu * into(tick)) break;
    tick = touch.to(hand(amount += turns ? 1e-5 : 1e-6));
  }
  for (int i = 0; i < 1000; ++i) tick = touch.to(hand(amount));
  const Pose held = tick.step.X_WT;
  const int seconds = 60;
  double farthest = 0;
  for (int i = 0; i < seconds * 1000; ++i) {
    tick = touch.to(hand(amount));
    const Vec3d off = tick.step.X_WT * kFoot - held * kFoot;
    farthest = std::max(farthest, std::hypot(off.x, off.y));
  }
  const Vec3d off = tick.step.X_WT * kFoot - held * kFoot;
  char of[64];
  std::snprintf(of, sizeof of, "%s %s %.0f %%%s", coupling.name, turns ? "turned" : "pulled",
                100 * share, noise > 0 ? " noise 1.5 mm" : "");
  const double spun = std::abs(rotation_between(held.rotation, tick.step.X_WT.rotation).z);
  row("creep-60s", of, 1e6 * std::hypot(off.x, off.y), "um", noise > 0 ? NAN : 1);
  row("creep-60s", of, spun, "rad", noise > 0 ? NAN : 1e-4);
  if (noise > 0) row("wander-60s", of, 1e6 * farthest, "um", NAN);
}

// -------------------------------------------------------------------------------- 2. Coulomb

void slides(const Tool& tool) {
  for (const NamedCoupling& coupling : kCouplings) {
    Touch touch(tool, settings_of(coupling.kind));
    const bool is_soft =
        coupling.kind == CouplingKind::virtual_coupling || coupling.kind == CouplingKind::proxy;
    const double press = is_soft ? 5e-3 : 3e-3;
    double worst = 0, at_hand = 0;
    for (int i = 0; i < 1500; ++i) {
      const TickRecord& tick =
          touch.to({{0.03e-3 * std::max(0, i - 300), 0,
                     kWall - 0.022 + (0.002 + press) * std::min(1.0, i / 200.0)},
                    {}});
      if (i < 1000) continue;
      const double want = kMu * into(tick);
      worst = std::max(worst, norm(along(tick) + Vec3d{want, 0, 0}) / want);
      at_hand = std::max(at_hand, std::abs(tick.step.F_H_B.force.x + want) / want);
    }
    row("slide", coupling.name, 100 * worst, "%", 1);
    if (coupling.kind != CouplingKind::none) {
      row("slide-at-hand", coupling.name, 100 * at_hand, "%", 1);
    }
  }
}

void turns(const std::string& of, const Tool& tool, double want) {
  Touch touch(tool, settings_of(CouplingKind::none));
  double worst = 0;
  for (int i = 0; i < 1000; ++i) {
    const double z = kWall - 0.017 + 5e-3 * std::min(1.0, i / 200.0);
    const Wrench F =
        touch.to({{0, 0, z}, axis_angle({0, 0, 1}, 2e-3 * std::max(0, i - 200))}).step.contact_W;
    if (i < 500) continue;
    worst = std::max(worst, std::abs(F.torque.z / (kMu * F.force.z) / want - 1));
  }
  row("torsion", of, 100 * worst, "%", 5);
}

double of_rectangle(double a, double b) {
  const double d = std::hypot(a, b);
  return (2 * d + b * b / a * std::log((a + d) / b) + a * a / b * std::log((b + d) / a)) / 6;
}

// --------------------------------------------------------------------------------- 3. energy

/// A closed path of pressing, sliding and turning, 2 s long.
struct ClosedPath {
  Vec3d shift[3][2], turn[3][2];
  explicit ClosedPath(test::Random& random) {
    for (int k = 0; k < 3; ++k) {
      for (Vec3d& v : shift[k]) v = 0.004 / (k + 1) * random.in_box(1);
      for (Vec3d& v : turn[k]) v = 0.06 / (k + 1) * random.in_box(1);
    }
  }
  Pose at(double t) const {
    Vec3d p{0, 0, kWall - 0.02 + 2e-3}, r;
    for (int k = 0; k < 3; ++k) {
      const double c = 1 - std::cos(kPi * (k + 1) * t), s = std::sin(kPi * (k + 1) * t);
      p += c * shift[k][0] + s * shift[k][1];
      r += c * turn[k][0] + s * turn[k][1];
    }
    return {p, rotation_by(r)};
  }
};

/// Returns the energy given to the hand in two rounds, J; `most`: the maximum on the way.
double given(const Tool& tool, const ClosedPath& path, CouplingKind kind, double mu, double& most) {
  Touch touch(tool, settings_of(kind, mu));
  Pose last = path.at(0);
  Wrench felt;
  double sum = 0;
  most = -1e9;
  for (int i = 0; i <= 6000; ++i) {
    const Pose X = path.at(kTick * (i % 2000));
    if (i > 2000) {
      sum += dot(felt.force, X.translation - last.translation) +
             dot(felt.torque, rotation_between(last.rotation, X.rotation));
      most = std::max(most, sum);
    }
    felt = touch.to(X).step.F_H_B;
    last = X;
  }
  return sum;
}

void closed_paths(const Tool& tool) {
  for (const NamedCoupling& coupling : kCouplings) {
    if (coupling.kind == CouplingKind::none) continue;
    test::Random random(3);
    double worst = -1e9, without = -1e9, added = -1e9;
    for (int n = 0; n < 12; ++n) {
      const ClosedPath path(random);
      double most;
      const double loose = given(tool, path, coupling.kind, 0, most);
      const double gripped = given(tool, path, coupling.kind, kMu, most);
      worst = std::max(worst, gripped);
      without = std::max(without, loose);
      added = std::max(added, gripped - loose);
    }
    row("energy", std::string(coupling.name) + " closed paths", 1e3 * worst, "mJ", 0);
    row("energy", std::string(coupling.name) + " by friction alone", 1e3 * added, "mJ", 0);
    row("energy", std::string(coupling.name) + " without friction", 1e3 * without, "mJ", NAN);
  }
}

// -------------------------------------------------------------------------------- 4. Z-width

MassProperties small_box() {
  const double side = 0.04, v = side * side * side;
  MassProperties tool{v, {}, {}};
  for (int i = 0; i < 3; ++i) tool.inertia.m[i][i] = v * side * side / 6;
  return tool;
}

/// Makes the local model of a wall, with a delay of one tick.
LocalContact wall_contact(const Pose& X_WT, double time, double k) {
  LocalContact contact;
  contact.is_valid = true;
  contact.time = time;
  contact.X_WT = X_WT;
  contact.p_WC = X_WT.translation;
  const Vec3d lever = rotate(X_WT.rotation, {0, 0, -0.02});
  const double depth = -(X_WT.translation.z + lever.z);
  if (!(depth > 0)) return contact;
  const Vec3d n{0, 0, 1}, arm = cross(lever, n);
  contact.F_C_W = {k * depth * n, k * depth * arm};
  const double along[6] = {n.x, n.y, n.z, arm.x, arm.y, arm.z};
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) contact.stiffness.m[i][j] = k * along[i] * along[j];
  }
  contact.max_stiffness = k;
  contact.volume = 1.6e-3 * depth;
  contact.patch = {lever, 0.015, 1, 0, {}};
  return contact;
}

/// True if the handle comes to rest after a hand presses on the wall, slides and holds still.
bool is_calm(const DeviceModel& base, CouplingKind kind, double mu, double k) {
  SimulatedDeviceOptions options;
  options.model = base;
  options.model.limits.max_stiffness = options.model.limits.max_angular_stiffness = 1e6;
  options.in_real_time = false;
  options.target = [](double t) {
    const auto eased = [](double x) { return x <= 0 ? 0 : x >= 1 ? 1 : x * x * (3 - 2 * x); };
    return Pose{{0.02 * eased(t - 1), 0, 0.022 - 0.015 * eased(t)}, {}};
  };
  auto device = SimulatedDevice::create(options).value();
  CouplingOptions coupling_options;
  coupling_options.kind = kind;
  coupling_options.stiffness = kind == CouplingKind::direct ? 0 : k;
  coupling_options.friction.coefficient = mu;
  const double wall = kind == CouplingKind::direct ? k : 1e6;
  const auto checked =
      check_coupling(coupling_options, device->info().limits, kTick, small_box()).value();
  CouplingOptions used = checked.options;
  if (kind == CouplingKind::direct) {
    // The limits without those of this study.
    used.stiffness = check_coupling({}, base.limits, kTick, small_box()).value().options.stiffness;
  }
  const auto coupling = make_coupling(used, device->info().limits, small_box());
  bool has_begun = false;
  Pose X_WT;
  int number = 0;
  double late = 0;
  const Status started = device->start([&](const DeviceState& state) -> Wrench {
    if (!has_begun) coupling->reset(state);
    const LocalContact contact = has_begun ? wall_contact(X_WT, state.time, wall) : LocalContact{};
    has_begun = true;
    const CouplingStep step = coupling->step(state, contact, kTick);
    X_WT = step.X_WT;
    if (++number > 3500) late = std::max(late, norm(device->true_state().V_BH.linear));
    return step.F_H_B;
  });
  if (!started) return false;
  device->run(4000);
  return late < 2e-3;
}

double stiffest(const DeviceModel& model, CouplingKind kind, double mu) {
  double low = 50, high = 1e5;
  if (!is_calm(model, kind, mu, low)) return 0;
  if (is_calm(model, kind, mu, high)) return high;
  while (high / low > 1.01) {
    const double middle = std::sqrt(low * high);
    (is_calm(model, kind, mu, middle) ? low : high) = middle;
  }
  return low;
}

void z_widths() {
  for (const char* key : {"touch", "omega.6", "lambda.7", "sigma.7"}) {
    const DeviceModel model = *find_device_model(key);
    for (const NamedCoupling& coupling : kCouplings) {
      if (coupling.kind == CouplingKind::none) continue;
      const double without = stiffest(model, coupling.kind, 0);
      const double with = stiffest(model, coupling.kind, kMu);
      const std::string of = std::string(key) + " " + coupling.name;
      row("z-width", of + " without", without, "N/m", NAN);
      row("z-width", of + " with/without", 100 * with / without, "%", 95);
    }
  }
}

// ----------------------------------------------------------------------------------- 5. cost

struct Cost {
  double p50, p99;
};
Cost cost_of(CouplingKind kind, const FrictionOptions& friction, TextureKind texture, bool slides) {
  CouplingOptions options;
  options.kind = kind;
  options.friction = friction;
  options.texture.kind = texture;
  const DeviceLimits limits = find_device_model("sigma.7")->limits;
  const auto checked = check_coupling(options, limits, kTick, small_box()).value();
  const auto coupling = make_coupling(checked.options, limits, small_box());
  DeviceState state;
  state.is_valid = true;
  state.X_BH.translation.z = 0.019;
  coupling->reset(state);
  Pose X_WT = state.X_BH;
  std::vector<double> times;
  for (int i = 0; i < 200'000; ++i) {
    state.time = kTick * i;
    const double way = slides ? 1e-3 * std::sin(0.02 * i) : 0;
    state.X_BH.translation = {5 * way, way, 0.019 - 1e-4 * std::sin(0.003 * i)};
    state.X_BH.rotation = axis_angle({0, 0, 1}, 20 * way);
    const LocalContact contact = wall_contact(X_WT, state.time, 3000);
    const auto start = std::chrono::steady_clock::now();
    const CouplingStep step = coupling->step(state, contact, kTick);
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
    X_WT = step.X_WT;
    if (i > 1000) times.push_back(1e6 * took.count());
  }
  std::sort(times.begin(), times.end());
  const auto at = [&](double share) {
    return times[static_cast<std::size_t>(share * static_cast<double>(times.size() - 1))];
  };
  return {at(0.5), at(0.99)};
}

void costs() {
  FrictionOptions friction;
  friction.coefficient = kMu;
  FrictionOptions all = friction;
  all.viscous = 1;
  all.contact_damping = 1;
  all.static_ratio = 1.2;
  for (const NamedCoupling& coupling : kCouplings) {
    const Cost without = cost_of(coupling.kind, {}, TextureKind::none, true);
    const std::string name = coupling.name;
    row("tick", name + " without p50", without.p50, "us", NAN);
    row("tick", name + " without p99", without.p99, "us", NAN);
    const std::pair<const char*, Cost> kinds[] = {
        {" sticks", cost_of(coupling.kind, friction, TextureKind::none, false)},
        {" slides", cost_of(coupling.kind, friction, TextureKind::none, true)},
        {" all and grain", cost_of(coupling.kind, all, TextureKind::grain, true)}};
    for (const auto& [what, cost] : kinds) {
      row("tick-added", name + what + " p50", cost.p50 - without.p50, "us", 3);
      row("tick-added", name + what + " p99", cost.p99 - without.p99, "us", 3);
    }
  }
}

int run_all(const char* path) {
  csv = std::fopen(path, "w");
  if (csv == nullptr) {
    std::fprintf(stderr, "friction: cannot write %s\n", path);
    return 1;
  }
  std::fprintf(csv, "figure,of,value,unit,goal\n");
  const Tool box = packed(make_box({0.04, 0.04, 0.04}), 200);
  for (const NamedCoupling& coupling : {kCouplings[0], kCouplings[1]}) {
    creep_of(box, coupling, 0, false, 0.95);
    creep_of(box, coupling, 0, true, 0.95);
    creep_of(box, coupling, 1.5e-3, false, 0.5);
    creep_of(box, coupling, 1.5e-3, false, 0.95);
  }
  slides(box);
  turns("disc", packed(make_cylinder(0.015, 0.03, 96), 2000), 0.01);
  turns("rectangle 2:1", packed(make_box({0.04, 0.02, 0.03}), 2000), of_rectangle(0.02, 0.01));
  turns("square", packed(make_box({0.04, 0.04, 0.03}), 2000), of_rectangle(0.02, 0.02));
  turns("rectangle 6:1", packed(make_box({0.06, 0.01, 0.03}), 2000), of_rectangle(0.03, 0.005));
  closed_paths(box);
  z_widths();
  costs();
  return std::fclose(csv) == 0 ? 0 : 1;
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) {
  return palpate::bench::run_all(argc > 1 ? argv[1] : "friction.csv");
}
