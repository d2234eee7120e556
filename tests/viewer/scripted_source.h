// A source of views whose every number is known: for tests of the server and of the page.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/mesh/mesh.h"
#include "palpate/viewer/viewer.h"
#include "src/core/internal/monotonic_clock.h"

namespace palpate::test {

/// Scene of a scripted source. The defaults are four spheres, 0.4 m before the camera, each in
/// another state, and a slanted wall.
struct ScriptedScene {
  std::string kind = "live", title = "scripted";
  int width = 64, height = 48;
  Intrinsics intrinsics{60, 60, 31.5, 23.5};
  double unit = 0.001;
  double frame_rate = 30, sample_rate = 1000;
  bool has_stream = true;
  std::vector<Pose> cameras = {Pose{}};  ///< where they are; all of them see the same

  Pose X_WT{{0, 0, 0.4}, {}};
  std::vector<Sphere> spheres = {{{-0.06f, 0, 0}, 0.025f},  // outside
                                 {{0, 0, 0}, 0.025f},       // boundary, its lower half is in
                                 {{0.06f, 0, 0}, 0.025f},   // inside
                                 {{0, 0.06f, 0}, 0.02f}};   // inside, cut by a taken plane
  std::vector<SphereState> states = {SphereState::outside, SphereState::boundary,
                                     SphereState::inside, SphereState::inside};
  std::vector<Plane<float>> planes = {{{0, 0, 0}, 0},
                                      {{0, -1, 0}, 0},  // y >= 0 is in the scene
                                      {{0, 0, 0}, 0},
                                      {{-1, 0, 0}, 0.01f}};  // x >= -0.01

  /// Raw depth of pixel (u, v) of a frame.
  std::function<std::uint16_t(int u, int v, std::uint64_t number)> depth =
      [](int u, int v, std::uint64_t number) {
        if (v == 0 && u < 2) return static_cast<std::uint16_t>(u == 0 ? 0 : 65535);
        return static_cast<std::uint16_t>(400 + u + 2 * v + number % 7);
      };
  /// A surface's point, normal and depth-change vector in W; by default a wall at z = 0.5 m that
  /// ends at the rightmost column, and knows nothing of the topmost row.
  std::function<void(int u, int v, Vec3f& point, Vec3f& normal, Vec3f& edge)> surface =
      [](int u, int v, Vec3f& point, Vec3f& normal, Vec3f& edge) {
        point = {0.01f * static_cast<float>(u), 0.01f * static_cast<float>(v), 0.5f};
        normal = v == 0 ? Vec3f{NAN, NAN, NAN} : Vec3f{0, -0.6f, -0.8f};
        edge = u == 63 ? Vec3f{0.02f, 0, 0} : Vec3f{};
      };
};

/// Returns a scene of many spheres on a grid, a third each outside, boundary with a plane, inside.
inline ScriptedScene big_scene(int num_spheres, int width, int height) {
  ScriptedScene scene;
  scene.width = width;
  scene.height = height;
  scene.intrinsics = {0.9 * width, 0.9 * width, (width - 1) / 2.0, (height - 1) / 2.0};
  scene.spheres.clear();
  scene.states.clear();
  scene.planes.clear();
  const int side = static_cast<int>(std::ceil(std::cbrt(num_spheres)));
  const float cell = 0.2f / static_cast<float>(side);
  for (int i = 0; i < num_spheres; ++i) {
    const Vec3f center = Vec3f{static_cast<float>(i % side), static_cast<float>(i / side % side),
                               static_cast<float>(i / side / side)} *
                         cell;
    scene.spheres.push_back({center, 0.45f * cell});
    scene.states.push_back(static_cast<SphereState>(i % 3));
    scene.planes.push_back(i % 3 == 0 ? Plane<float>{}
                                      : Plane<float>{{0, 0, -1}, -center.z - 0.1f * cell});
  }
  return scene;
}

/// Sample k, of time k / sample_rate, in closed form.
inline ViewSample scripted_sample(std::uint64_t k, double sample_rate) {
  const double t = static_cast<double>(k) / sample_rate;
  ViewSample sample;
  sample.time = t;
  sample.F_H_B = {{2 * std::sin(kPi * t), 1, -std::cos(kPi * t)}, {0.01, 0.02, 0.03}};
  sample.contact_W = {{0, 0, -2}, {0.1, 0.2, 0.3}};
  sample.volume = 1e-6 * (1 + std::sin(kPi * t));
  sample.objects_volume = 0.25 * sample.volume;
  sample.compute_seconds = 4e-6;
  sample.contact_age = 1e-3;
  sample.sensor_age = 0.02;
  sample.stretch = 0.005;
  sample.gain = 1;
  sample.energy = static_cast<double>(k % 1000);
  sample.X_WT = {{0.05 * std::sin(kPi * t), 0, 0.4}, {}};
  sample.X_WT_hand = {{0.05 * std::sin(kPi * t), 0.01, 0.4}, {}};
  return sample;
}

/// Runs by the clock, or by `set_time`. Commands and what they changed can be read from any
/// thread.
class ScriptedSource : public ViewSource {
 public:
  explicit ScriptedSource(ScriptedScene scene = {}) : scene_(std::move(scene)) {
    // Not built: that would measure the volumes of thousands of spheres.
    const double volume = 0.2 * 0.2 * 0.1;
    std::vector<float> volumes(scene_.spheres.size(),
                               static_cast<float>(volume / double(scene_.spheres.size())));
    const InnerSphereTree tree(scene_.spheres);
    Result<Tool> tool =
        Tool::restore(make_box({0.2, 0.2, 0.1}), {scene_.spheres, volume, PackStop::count},
                      {LeafGraph(scene_.spheres, GapRule::relative),
                       GapRule::relative,
                       {std::move(volumes), scene_.spheres},
                       {tree.nodes().begin(), tree.nodes().end()}},
                      "scripted");
    tool_ = std::make_unique<Tool>(*std::move(tool));
    content_ = {scene_.kind, scene_.title, tool_.get()};
    if (scene_.has_stream) {
      content_.streams.assign(
          scene_.cameras.size(),
          DepthStreamInfo{scene_.width, scene_.height, scene_.intrinsics, scene_.unit,
                          scene_.frame_rate, std::nullopt, "scripted"});
    }
    settings_ = {
        {"contact.method", "field"}, {"coupling.stiffness", 500.0}, {"surface.filter", true}};
  }

  // Interface for tests.
  const ScriptedScene& scene() const { return scene_; }
  const Tool& tool() const { return *tool_; }
  /// Stops the clock at `seconds` since the run began.
  void set_time(double seconds) {
    const std::lock_guard lock(mutex_);
    fixed_time_ = seconds;
  }
  void set_fault(std::string fault) {
    const std::lock_guard lock(mutex_);
    fault_ = std::move(fault);
  }
  std::vector<std::string> commands() const {
    const std::lock_guard lock(mutex_);
    return commands_;
  }
  nlohmann::json settings() const {
    const std::lock_guard lock(mutex_);
    return settings_;
  }
  ViewSubscription subscription() const {
    const std::lock_guard lock(mutex_);
    return subscription_;
  }
  bool is_paused() const {
    const std::lock_guard lock(mutex_);
    return is_paused_;
  }
  bool has_ended() const {
    const std::lock_guard lock(mutex_);
    return has_ended_;
  }
  std::int64_t num_polls() const { return num_polls_; }

  // ViewSource.
  const ViewContent& content() const override { return content_; }

  ViewUpdate poll(const ViewSubscription& subscription) override {
    ViewUpdate update;
    const std::lock_guard lock(mutex_);
    ++num_polls_;
    subscription_ = subscription;
    const double time = now();
    const auto frame_number = is_paused_ ? held_frame_ : frame_at(time);
    if (subscription.frames && scene_.has_stream && frame_number != last_sent_frame_) {
      last_sent_frame_ = frame_number;
      for (std::size_t k = 0; k < scene_.cameras.size(); ++k) {
        update.frames.push_back(make_frame(k, frame_number));
      }
    }
    if (subscription.contacts) {
      auto contact = std::make_shared<ViewContact>();
      *contact = {time, frame_number, scene_.X_WT, {scene_.states, scene_.planes, {}, {}}};
      update.contact = std::move(contact);
    }
    if (subscription.surfaces && frame_number != last_sent_surface_) {
      last_sent_surface_ = frame_number;
      update.surface = make_surface(frame_number);
    }
    const auto end = static_cast<std::uint64_t>(time * scene_.sample_rate);
    if (subscription.samples) {
      for (std::uint64_t k = std::max(next_sample_, end > 5000 ? end - 5000 : 0); k < end; ++k)
        update.samples.push_back(scripted_sample(k, scene_.sample_rate));
    }
    next_sample_ = end;
    return update;
  }

  std::string state() override {
    const std::lock_guard lock(mutex_);
    const double time = now();
    nlohmann::json state = {
        {"time", time},          {"running", !has_ended_},
        {"fault", nullptr},      {"note", nullptr},
        {"paused", is_paused_},  {"revision", revision_},
        {"settings", settings_}, {"frame_number", is_paused_ ? held_frame_ : frame_at(time)}};
    if (!fault_.empty()) state["fault"] = fault_;
    if (scene_.kind == "live") {
      state["ticks"] = static_cast<std::int64_t>(time * scene_.sample_rate);
      state["missed"] = state["lost"] = 0;
      state["frames"] = frame_at(time);
      state["contacts"] = state["ticks"];
      state["sensor_age"] = 0.02;
      state["stages"] = {{{"name", "haptic"},
                          {"num", 1000},
                          {"p50", 3.0},
                          {"p99", 5.0},
                          {"p999", 8.0},
                          {"max", 9.5},
                          {"histogram", {{2.0, 300}, {3.0, 400}, {4.0, 300}}}}};
    } else if (scene_.kind == "recording") {
      state["duration"] = 60.0;
      state["speed"] = speed_;
      state["num_marks"] = 1;
    }
    return state.dump();
  }

  std::string controls() override {
    const std::lock_guard lock(mutex_);
    return nlohmann::json{{{"key", "contact.method"},
                           {"words", "How contact is measured"},
                           {"kind", "choice"},
                           {"choices", {"weighted", "simplified", "graph", "field"}},
                           {"value", settings_["contact.method"]}},
                          {{"key", "coupling.stiffness"},
                           {"words", "Stiffness of the coupling, N/m"},
                           {"kind", "number"},
                           {"low", 0},
                           {"high", 2000},
                           {"value", settings_["coupling.stiffness"]}},
                          {{"key", "surface.filter"},
                           {"words", "Depth filter"},
                           {"kind", "switch"},
                           {"value", settings_["surface.filter"]}}}
        .dump();
  }

  Result<std::string> command(std::string_view text) override {
    const std::lock_guard lock(mutex_);
    commands_.emplace_back(text);
    const nlohmann::json message = nlohmann::json::parse(text, nullptr, false);
    const auto text_of = [&message](const char* key) {
      return message.contains(key) && message[key].is_string() ? message[key].get<std::string>()
                                                               : std::string();
    };
    const auto number_of = [&message](const char* key, double otherwise) {
      return message.contains(key) && message[key].is_number() ? message[key].get<double>()
                                                               : otherwise;
    };
    const std::string name = text_of("command");
    if (name == "set") {
      const std::string key = text_of("key");
      if (!settings_.contains(key))
        return Error{Errc::not_found, "there is no control \"" + key + "\""};
      const nlohmann::json value = message.contains("value") ? message["value"] : nullptr;
      if (value.type_name() != std::string_view(settings_[key].type_name()))
        return Error{Errc::invalid_argument, key + " cannot have this value"};
      settings_[key] = value;
      ++revision_;
    } else if (name == "pause") {
      hold_frame(frame_at(now()));
    } else if (name == "resume") {
      is_paused_ = false;
    } else if (name == "step") {
      hold_frame((is_paused_ ? held_frame_ : frame_at(now())) + 1);
    } else if (name == "seek" && scene_.kind == "recording") {
      offset_ += number_of("time", 0) - now();
    } else if (name == "speed" && scene_.kind == "recording") {
      speed_ = number_of("factor", 1);
    } else if (name == "marks" && scene_.kind == "recording") {
      return nlohmann::json{{"marks", {{{"time", 1.5}, {"text", "first touch"}}}}}.dump();
    } else if (name == "mark" && scene_.kind == "live") {
      return nlohmann::json{{"time", now()}}.dump();
    } else if (name == "end" && scene_.kind == "live") {
      has_ended_ = true;
    } else {
      return Error{Errc::not_found, "there is no command \"" + name + "\" here"};
    }
    return std::string("{}");
  }

 private:
  double now() const { return fixed_time_ >= 0 ? fixed_time_ : monotonic_now() - began_ + offset_; }
  std::uint64_t frame_at(double time) const {
    return static_cast<std::uint64_t>(std::max(0.0, time) * scene_.frame_rate);
  }
  void hold_frame(std::uint64_t frame) {
    is_paused_ = true;
    held_frame_ = frame;
  }

  std::shared_ptr<const ViewFrame> make_frame(std::size_t camera, std::uint64_t number) const {
    auto made = std::make_shared<ViewFrame>();
    made->number = number;
    made->camera = camera;
    made->time = static_cast<double>(number) / scene_.frame_rate;
    made->frame = {scene_.width, scene_.height, scene_.unit,
                   {},           made->time,    scene_.cameras[camera]};
    made->frame.pixels.reserve(static_cast<std::size_t>(scene_.width) * scene_.height);
    for (int v = 0; v < scene_.height; ++v)
      for (int u = 0; u < scene_.width; ++u)
        made->frame.pixels.push_back(scene_.depth(u, v, number));
    return made;
  }
  std::shared_ptr<const ViewSurface> make_surface(std::uint64_t number) const {
    auto made = std::make_shared<ViewSurface>();
    made->frame_number = number;
    made->width = scene_.width;
    made->height = scene_.height;
    const std::size_t size = static_cast<std::size_t>(scene_.width) * scene_.height;
    made->points.resize(size);
    made->normals.resize(size);
    made->edges.resize(size);
    std::size_t i = 0;
    for (int v = 0; v < scene_.height; ++v)
      for (int u = 0; u < scene_.width; ++u, ++i)
        scene_.surface(u, v, made->points[i], made->normals[i], made->edges[i]);
    return made;
  }

  const ScriptedScene scene_;
  std::unique_ptr<Tool> tool_;
  ViewContent content_;
  const double began_ = monotonic_now();
  std::atomic<std::int64_t> num_polls_ = 0;

  mutable std::mutex mutex_;
  double fixed_time_ = -1, offset_ = 0, speed_ = 1;
  std::string fault_;
  nlohmann::json settings_;
  std::uint32_t revision_ = 0;
  bool is_paused_ = false, has_ended_ = false;
  std::uint64_t held_frame_ = 0;
  std::uint64_t last_sent_frame_ = ~0ull, last_sent_surface_ = ~0ull;
  std::uint64_t next_sample_ = 0;
  ViewSubscription subscription_;
  std::vector<std::string> commands_;
};

}  // namespace palpate::test
