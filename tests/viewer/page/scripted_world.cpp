#include "tests/viewer/page/scripted_world.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "palpate/mesh/mesh.h"

namespace palpate {
namespace {

using Json = ScriptedWorld::Json;

constexpr double kPollSeconds = 1.0 / 60;
constexpr int kTicksPerPoll = 16;  // about 1 kHz
constexpr double kDuration = 60;   // of the recording that it pretends to be, s

Vec3d vec3(const Json& json) { return {json.at(0), json.at(1), json.at(2)}; }

Error refused(const std::string& why) { return {Errc::invalid_argument, why}; }

/// Does `value` suit the control? Else what is wrong.
Status check_value(const Json& control, const Json& value) {
  const std::string key = control.at("key"), kind = control.at("kind");
  if (kind == "switch" && !value.is_boolean()) return refused(key + " is true or false.");
  for (const Json& choice : control.value("choices", Json::array())) {
    if (choice == value) return Done{};
  }
  if (kind == "choice") {
    return refused(key + " is none of its choices: " + control.at("choices").dump() + ".");
  }
  if (kind == "number") {
    const double low = control.at("low"), high = control.at("high");
    if (!value.is_number() || !(value >= low && value <= high)) {
      return refused(key + " must be between " + Json(low).dump() + " and " + Json(high).dump() +
                     ".");
    }
  }
  return Done{};
}

}  // namespace

Result<std::unique_ptr<ScriptedWorld>> ScriptedWorld::create(
    const Json& script, std::function<void(std::string_view)> heard) {
  const Json& shape = script.at("shape");
  Result<TriangleMesh> mesh = make_shape(shape.at("name").get<std::string>(), shape.at("size"));
  if (!mesh) return mesh.error();
  SpherePacking packing;
  for (const Json& s : script.at("spheres")) {
    packing.spheres.push_back({{s.at(0), s.at(1), s.at(2)}, s.at(3)});
  }
  Result<Tool> tool =
      Tool::build(std::move(*mesh), std::move(packing), {.source = "a test", .num_threads = 1});
  if (!tool) return tool.error();
  return std::unique_ptr<ScriptedWorld>(
      new ScriptedWorld(script, std::move(*tool), std::move(heard)));
}

ScriptedWorld::ScriptedWorld(const Json& script, Tool tool,
                             std::function<void(std::string_view)> heard)
    : tool_(std::move(tool)), received_(std::move(heard)), controls_(script.at("controls")) {
  content_.kind = script.at("kind");
  content_.title = script.at("title");
  content_.tool = &tool_;
  if (const Json& stream = script.at("stream"); !stream.is_null()) {
    DepthStreamInfo info;
    info.width = stream.at("width");
    info.height = stream.at("height");
    const double focal = stream.at("focal");
    info.intrinsics = {focal, focal, (info.width - 1) / 2.0, (info.height - 1) / 2.0};
    info.name = "scripted";
    place(script.value("cameras", Json::array({Json::array({0, 0, 0, 0, 0, 0, 1})})));
    content_.streams.assign(X_WC_.size(), info);
  }
}

void ScriptedWorld::apply(const Json& change) {
  const std::lock_guard lock(mutex_);
  if (change.contains("contact")) {
    const Json& contact = change["contact"];
    contact_.emplace();
    contact_->X_WT.translation = vec3(contact.at("position"));
    if (contact.contains("quaternion")) {
      const Json& q = contact["quaternion"];
      contact_->X_WT.rotation = normalized(Quaternion{q.at(0), q.at(1), q.at(2), q.at(3)});
    }
    for (const Json& state : contact.at("states")) {
      contact_->spheres.states.push_back(static_cast<SphereState>(state.get<int>()));
    }
    const auto none = Json::array();
    contact_->spheres.deciders = contact.value("deciders", none).get<std::vector<std::int8_t>>();
    contact_->spheres.unseen = contact.value("unseen", none).get<std::vector<std::uint8_t>>();
    for (const Json& plane : contact.at("planes")) {
      contact_->spheres.planes.push_back({{plane.at(0), plane.at(1), plane.at(2)}, plane.at(3)});
    }
  }
  if (change.contains("depth")) depths_.assign(X_WC_.size(), change["depth"]);
  if (change.contains("depths")) depths_ = change["depths"].get<std::vector<Json>>();
  if (change.contains("cameras")) place(change["cameras"]);
  if (change.contains("sample")) sample_ = change["sample"];
  if (change.contains("state")) state_.update(change["state"]);
  unit_ = change.value("unit", unit_);
  is_frozen_ = change.value("frozen", is_frozen_);
  is_moving_ = change.value("moving", is_moving_);
}

ViewUpdate ScriptedWorld::poll(const ViewSubscription& subscription) {
  ViewUpdate update;
  const std::lock_guard lock(mutex_);
  if (is_frozen_) return update;
  ++num_polls_;
  if (!is_paused_) time_ += kPollSeconds * speed_;
  // Thirty frames a second, as a camera has them.
  const bool has_new_frame = !is_paused_ && !content_.streams.empty() && num_polls_ % 2 == 0;
  if (has_new_frame) ++frame_number_;
  for (std::size_t k = 0; subscription.frames && has_new_frame && k < X_WC_.size(); ++k) {
    update.frames.push_back(make_frame(k));
  }
  if (subscription.surfaces && has_new_frame) update.surface = make_surface();
  if (contact_) {
    ++num_contacts_;
    if (subscription.contacts) update.contact = make_contact();
  }
  for (int i = 0; i < kTicksPerPoll; ++i, ++num_ticks_) {
    if (subscription.samples) {
      update.samples.push_back(make_sample(time_ + i * kPollSeconds / kTicksPerPoll));
    }
  }
  return update;
}

void ScriptedWorld::place(const Json& cameras) {
  X_WC_.clear();
  for (const Json& c : cameras) {
    X_WC_.push_back(
        {{c.at(0), c.at(1), c.at(2)}, normalized(Quaternion{c.at(3), c.at(4), c.at(5), c.at(6)})});
  }
  depths_.resize(X_WC_.size(), Json::array());
}

std::vector<double> ScriptedWorld::depths(std::size_t camera) const {
  std::vector<double> row(static_cast<std::size_t>(content_.streams[camera].width));
  for (const Json& step : depths_[camera]) {
    const double meters = step.at(1), sway = is_moving_ ? 0.01 * std::sin(2 * time_) : 0;
    std::fill(row.begin() + step.at(0).get<int>(), row.end(), meters > 0 ? meters + sway : 0);
  }
  return row;
}

std::shared_ptr<const ViewFrame> ScriptedWorld::make_frame(std::size_t camera) const {
  auto frame = std::make_shared<ViewFrame>();
  frame->number = frame_number_;
  frame->time = time_;
  DepthFrame& image = frame->frame;
  const DepthStreamInfo& stream = content_.streams[camera];
  image.width = stream.width;
  image.height = stream.height;
  image.unit = unit_;
  image.X_WC = X_WC_[camera];
  frame->camera = camera;
  image.timestamp = time_;
  std::vector<std::uint16_t> row;
  for (const double meters : depths(camera)) {
    row.push_back(static_cast<std::uint16_t>(std::lround(meters / image.unit)));
  }
  for (int v = 0; v < image.height; ++v) {
    image.pixels.insert(image.pixels.end(), row.begin(), row.end());
  }
  return frame;
}

/// Walls that face the camera; where a wall ends towards a farther one, vectors across the edge.
std::shared_ptr<const ViewSurface> ScriptedWorld::make_surface() const {
  auto surface = std::make_shared<ViewSurface>();
  const DepthStreamInfo& stream = content_.streams.front();
  const auto& [fx, fy, cx, cy] = stream.intrinsics;
  const float nan = std::nanf("");
  const std::vector<double> row = depths(0);
  surface->frame_number = frame_number_;
  surface->width = stream.width;
  surface->height = stream.height;
  for (int v = 0; v < stream.height; ++v) {
    for (std::size_t u = 0; u < row.size(); ++u) {
      const double z = row[u], x = (static_cast<double>(u) - cx) * z / fx, y = (v - cy) * z / fy;
      const bool is_edge = z > 0 && u + 1 < row.size() && row[u + 1] > z;
      surface->points.push_back(
          z > 0 ? Vec3f{static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)}
                : Vec3f{nan, nan, nan});
      surface->normals.push_back(z > 0 ? Vec3f{0, 0, -1} : Vec3f{nan, nan, nan});
      surface->edges.push_back(is_edge ? Vec3f{0.05F, 0, 0} : Vec3f{});
    }
  }
  return surface;
}

Pose ScriptedWorld::tool_pose(double time) const {
  Pose X_WT = contact_ ? contact_->X_WT : Pose{};
  if (is_moving_) {
    X_WT.translation += Vec3d{0.05 * std::sin(3 * time), 0.03 * std::cos(3 * time), 0};
  }
  return X_WT;
}

std::shared_ptr<const ViewContact> ScriptedWorld::make_contact() const {
  auto contact = std::make_shared<ViewContact>(*contact_);
  contact->time = time_;
  contact->frame_number = frame_number_;
  contact->X_WT = tool_pose(time_);
  return contact;
}

ViewSample ScriptedWorld::make_sample(double time) const {
  const auto vector = [&](const char* name) {
    return sample_.contains(name) ? vec3(sample_[name]) : Vec3d{};
  };
  ViewSample sample;
  sample.time = time;
  sample.F_H_B = {vector("force"), vector("torque")};
  sample.contact_W = {vector("contact_force"), vector("contact_torque")};
  sample.volume = sample_.value("volume", 0.0);
  sample.compute_seconds = 120e-6;
  sample.contact_age = 0.001;
  sample.sensor_age = 0.02;
  sample.gain = 1;
  sample.X_WT = tool_pose(time);
  sample.X_WT_hand = sample.X_WT;
  if (sample_.contains("hand")) sample.X_WT_hand.translation = vector("hand");
  sample.stretch = norm(sample.X_WT_hand.translation - sample.X_WT.translation);
  return sample;
}

Json ScriptedWorld::current_state() const {
  Json settings = Json::object();
  for (const Json& control : controls_) {
    settings[control.at("key").get<std::string>()] = control.at("value");
  }
  Json state{{"time", time_},        {"running", true},
             {"fault", nullptr},     {"note", nullptr},
             {"paused", is_paused_}, {"revision", revision_},
             {"settings", settings}, {"frame_number", frame_number_}};
  if (content_.kind == "live") {
    const Json histogram = {{100, num_ticks_ / 2}, {120, num_ticks_ / 2}, {200, 1}};
    state.update({{"ticks", num_ticks_},
                  {"missed", 3},
                  {"lost", 0},
                  {"frames", frame_number_},
                  {"contacts", num_contacts_},
                  {"sensor_age", 0.02},
                  {"stages", Json::array({{{"name", "haptic_compute"},
                                           {"num", num_ticks_},
                                           {"p50", 110.0},
                                           {"p99", 180.0},
                                           {"p999", 220.0},
                                           {"max", 250.0},
                                           {"histogram", histogram}}})}});
  }
  if (content_.kind == "recording") {
    state.update({{"duration", kDuration}, {"speed", speed_}, {"num_marks", marks_.size()}});
  }
  state.update(state_);
  return state;
}

std::string ScriptedWorld::state() {
  const std::lock_guard lock(mutex_);
  return current_state().dump();
}

std::string ScriptedWorld::controls() {
  const std::lock_guard lock(mutex_);
  return controls_.dump();
}

Result<std::string> ScriptedWorld::set(const Json& command) {
  const std::string key = command.value("key", "");
  for (Json& control : controls_) {
    if (control.at("key") != key) continue;
    const Json value = command.value("value", Json());
    if (Status status = check_value(control, value); !status) return status.error();
    control["value"] = value;
    ++revision_;
    return std::string("{}");
  }
  return refused("There is no control " + key + ": see hello.controls.");
}

Result<std::string> ScriptedWorld::command(std::string_view text) {
  received_(text);
  const std::lock_guard lock(mutex_);
  const Json command = Json::parse(text, nullptr, false);
  if (!command.is_object()) return refused("This is not a JSON object.");
  const std::string name = command.value("command", "");
  if (name == "set") return set(command);
  if (name == "pause" || name == "resume") {
    is_paused_ = name == "pause";
  } else if (name == "step") {
    is_paused_ = true;
    const int frames = command.value("frames", 1);
    frame_number_ += static_cast<std::uint64_t>(frames);
    time_ = std::max(0.0, time_ + frames / 30.0);
  } else if (name == "seek") {
    const double time = command.value("time", -1.0);
    if (!(time >= 0 && time <= kDuration)) return refused("The recording has no such time.");
    time_ = time;
  } else if (name == "speed") {
    const double factor = command.value("factor", 0.0);
    if (!(factor >= 0.01 && factor <= 10)) return refused("factor must be 0.01 to 10.");
    speed_ = factor;
  } else if (name == "mark") {
    marks_.push_back({{"time", time_}, {"text", command.value("text", "")}});
  } else if (name == "marks" && content_.kind == "recording") {
    return Json{{"marks", marks_}}.dump();
  } else if (name == "force") {
    state_["force"] = "engaged";
    state_["note"] = nullptr;
  } else if (name == "end") {
    state_["running"] = false;
  } else {
    return refused("There is no command " + name + ".");
  }
  return std::string("{}");
}

}  // namespace palpate
