#include "src/session/internal/run_messages.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <vector>

#include "palpate/version.h"
#include "src/cloud/internal/frame_limits.h"
#include "src/io/internal/cdr.h"
#include "src/io/internal/json_shape.h"
#include "src/io/internal/ros_types.h"
#include "src/session/internal/run_fields.h"
#include "src/session/internal/settings_json.h"
#include "src/session/report/text.h"

namespace palpate { inline namespace v0 {
namespace {

using Json = nlohmann::ordered_json;

/// The settings as JSON, beside the fields of their own.
struct SettingsText {
  std::uint32_t revision = 0;
  double time_origin = 0;
  DeviceInfo device;
  std::string json;
};
template <Of<SettingsText> T>
void visit_fields(T& settings, auto&& visit) {
  visit("revision", settings.revision);
  visit("time_origin", settings.time_origin);
  visit("device", settings.device);
  visit("json", settings.json);
}

/// A sequence of numbers.
using Numbers = std::vector<double>;

/// Length of a ground as numbers, in the order of its fields; none: nothing special.
constexpr std::uint32_t kGroundNumbers = 12;

struct PartText {
  PartStart part;
  Numbers hand;
};
template <Of<PartText> T>
void visit_fields(T& text, auto&& visit) {
  visit("number", text.part.number);
  visit("revision", text.part.revision);
  visit("periods", text.part.periods);
  visit("has_surfaces", text.part.has_surfaces);
  visit("tick", text.part.hand.tick);
  visit("tick_revision", text.part.hand.revision);
  visit("hand", text.hand);
}

/// A sequence of bytes.
struct Bytes {
  std::string bytes;
};

struct EstimateText {
  std::uint32_t camera = 0, revision = 0;
  Bytes state;
};
template <Of<EstimateText> T>
void visit_fields(T& text, auto&& visit) {
  visit("camera", text.camera);
  visit("revision", text.revision);
  visit("state", text.state);
}

struct Note {
  std::string text;
};
template <Of<Note> T>
void visit_fields(T& note, auto&& visit) {
  visit("text", note.text);
}

std::span<const CameraBlend> seen(const CameraBlends& cameras) {
  return {cameras.of, std::min<std::size_t>(cameras.num, kMaxCameras)};
}

std::span<const Pose> poses(const BodyPoses& bodies) {
  return {bodies.of, std::min<std::size_t>(bodies.num, kMaxMovingBodies)};
}

template <class T>
concept Scalar = std::is_arithmetic_v<T> || std::is_enum_v<T>;

struct Writer {
  CdrWriter& to;

  template <class T>
  void operator()(const char*, const T& value) const {
    if constexpr (Scalar<T>) {
      to.number(value);
    } else if constexpr (std::same_as<T, std::string>) {
      to.text(value);
    } else if constexpr (std::same_as<T, Bytes>) {
      to.bytes(value.bytes.data(), value.bytes.size());
    } else if constexpr (std::same_as<T, Numbers>) {
      to.number(static_cast<std::uint32_t>(value.size()));
      for (const double number : value) to.number(number);
    } else if constexpr (std::same_as<T, Ground>) {
      const bool is_plain = value == Ground{};
      to.number(is_plain ? 0 : kGroundNumbers);
      if (!is_plain) visit_fields(value, *this);
    } else if constexpr (std::same_as<T, CameraBlends>) {
      to.number(value.num);
      for (const CameraBlend& blend : seen(value)) visit_fields(blend, *this);
    } else if constexpr (std::same_as<T, BodyPoses>) {
      to.number(value.num);
      for (const Pose& X_WB : poses(value)) visit_fields(X_WB, *this);
    } else if constexpr (std::same_as<T, Stiffness>) {
      for (const auto& row : value.m) {
        for (const double number : row) to.number(number);
      }
    } else {
      visit_fields(value, *this);
    }
  }
};

struct Reader {
  CdrReader& from;

  template <class T>
  void operator()(const char*, T& value) const {
    if constexpr (std::same_as<T, bool>) {
      value = from.number<std::uint8_t>() != 0;
    } else if constexpr (Scalar<T>) {
      value = from.number<T>();
    } else if constexpr (std::same_as<T, std::string>) {
      value = std::string(from.text());
    } else if constexpr (std::same_as<T, Bytes>) {
      value.bytes = std::string(from.bytes());
    } else if constexpr (std::same_as<T, Numbers>) {
      const std::size_t num = from.number<std::uint32_t>();
      value.clear();
      for (std::size_t i = 0; i < num && from.is_good(); ++i) {
        value.push_back(from.number<double>());
      }
    } else if constexpr (std::same_as<T, Ground>) {
      value = {};
      if (from.number<std::uint32_t>() == kGroundNumbers) visit_fields(value, *this);
    } else if constexpr (std::same_as<T, CameraBlends>) {
      value.num = from.number<std::uint32_t>();
      for (std::uint32_t k = 0; k < value.num && k < kMaxCameras; ++k) {
        visit_fields(value.of[k], *this);
      }
    } else if constexpr (std::same_as<T, BodyPoses>) {
      value.num = from.number<std::uint32_t>();
      for (std::uint32_t k = 0; k < value.num && k < kMaxMovingBodies; ++k) {
        visit_fields(value.of[k], *this);
      }
    } else if constexpr (std::same_as<T, Stiffness>) {
      for (auto& row : value.m) {
        for (double& number : row) number = from.number<double>();
      }
    } else {
      visit_fields(value, *this);
    }
  }
};

// Name of a type in ROS.
template <class T>
std::string type_name() {
  if constexpr (std::same_as<T, bool>) return "bool";
  if constexpr (std::same_as<T, double>) return "float64";
  if constexpr (std::same_as<T, std::uint64_t>) return "uint64";
  if constexpr (std::same_as<T, std::int64_t>) return "int64";
  if constexpr (std::same_as<T, std::uint32_t>) return "uint32";
  if constexpr (std::same_as<T, std::int32_t>) return "int32";
  if constexpr (std::same_as<T, Fault> || std::same_as<T, ForceState>) return "uint8";
  if constexpr (std::same_as<T, std::string>) return "string";
  if constexpr (std::same_as<T, Numbers> || std::same_as<T, Ground>) return "float64[]";
  if constexpr (std::same_as<T, Stiffness>) return "float64[36]";
  if constexpr (std::same_as<T, Vec3d>) return "geometry_msgs/Vector3";
  if constexpr (std::same_as<T, Quaternion>) return "geometry_msgs/Quaternion";
  if constexpr (std::same_as<T, Pose>) return "geometry_msgs/Pose";
  if constexpr (std::same_as<T, Wrench>) return "geometry_msgs/Wrench";
  if constexpr (std::same_as<T, VolumeWrench>) return "palpate_msgs/VolumeWrench";
  if constexpr (std::same_as<T, Twist>) return "geometry_msgs/Twist";
  if constexpr (std::same_as<T, SurfaceStats>) return "palpate_msgs/SurfaceStats";
  if constexpr (std::same_as<T, PixelWindow>) return "palpate_msgs/PixelWindow";
  if constexpr (std::same_as<T, FrameRecord>) return "palpate_msgs/Frame";
  if constexpr (std::same_as<T, Penetration>) return "palpate_msgs/Penetration";
  if constexpr (std::same_as<T, ContactPatch>) return "palpate_msgs/ContactPatch";
  if constexpr (std::same_as<T, LocalContact>) return "palpate_msgs/LocalContact";
  if constexpr (std::same_as<T, CameraBlend>) return "palpate_msgs/CameraBlend";
  if constexpr (std::same_as<T, CameraBlends>) return "palpate_msgs/CameraBlend[]";
  if constexpr (std::same_as<T, BodyPoses>) return "geometry_msgs/Pose[]";
  if constexpr (std::same_as<T, ContactRecord>) return "palpate_msgs/ContactRecord";
  if constexpr (std::same_as<T, DeviceState>) return "palpate_msgs/DeviceState";
  if constexpr (std::same_as<T, CouplingStep>) return "palpate_msgs/CouplingStep";
  if constexpr (std::same_as<T, SafetyStatus>) return "palpate_msgs/SafetyStatus";
  if constexpr (std::same_as<T, TickRecord>) return "palpate_msgs/Tick";
  if constexpr (std::same_as<T, DeviceLimits>) return "palpate_msgs/DeviceLimits";
  if constexpr (std::same_as<T, DeviceInfo>) return "palpate_msgs/DeviceInfo";
  if constexpr (std::same_as<T, SettingsText>) return "palpate_msgs/Settings";
  if constexpr (std::same_as<T, PartText>) return "palpate_msgs/Part";
  if constexpr (std::same_as<T, EstimateText>) return "palpate_msgs/Estimate";
  if constexpr (std::same_as<T, Bytes>) return "uint8[]";
  if constexpr (std::same_as<T, Note>) return "palpate_msgs/Note";
}

/// Writes down the definitions of our types.
struct Describer {
  std::map<std::string, std::string>& texts;
  std::string& text;

  template <class T>
  void operator()(const char* name, const T& value) const {
    const std::string type = type_name<T>();
    text += type + " " + name + "\n";
    constexpr bool is_plain = Scalar<T> || std::same_as<T, std::string> ||
                              std::same_as<T, Stiffness> || std::same_as<T, Numbers> ||
                              std::same_as<T, BodyPoses> || std::same_as<T, Ground> ||
                              std::same_as<T, Bytes>;
    if constexpr (std::same_as<T, CameraBlends>) {
      describe(CameraBlend{});
    } else if constexpr (!is_plain) {
      if (type.starts_with("palpate_msgs/") && texts.count(type) == 0) describe(value);
    }
  }
  template <class T>
  void describe(const T& value) const {
    std::string inner;
    visit_fields(value, Describer{texts, inner});
    texts[type_name<T>()] = inner;
  }
};

template <class T>
McapChannel channel_of(const char* topic) {
  std::map<std::string, std::string> texts;
  std::string unused;
  Describer{texts, unused}.describe(T{});
  std::string type = type_name<T>();
  const std::string schema = message_schema(type, [&](const auto& name) { return texts[name]; });
  type.insert(type.find('/'), "/msg");
  return {topic, type, schema};
}

template <class T>
std::string message_of(const T& value) {
  CdrWriter to;
  visit_fields(value, Writer{to});
  return to.take();
}

template <class T>
Result<T> read(std::string_view message) {
  CdrReader from(message);
  T value;
  visit_fields(value, Reader{from});
  if (from.is_good()) return value;
  return Error{Errc::bad_input, "a message is no " + type_name<T>() + "; record the run again"};
}

/// Collects every number with its place.
struct Flattener {
  std::vector<std::pair<std::string, std::string>>& values;
  std::string place;

  template <class T>
  void operator()(const char* name, const T& value) const {
    const std::string at = place + (place.empty() ? "" : "/") + name;
    if constexpr (Scalar<T>) {
      put(at, value);
    } else if constexpr (std::same_as<T, CameraBlends>) {
      for (std::uint32_t k = 0; k < value.num && k < kMaxCameras; ++k) {
        visit_fields(value.of[k], Flattener{values, at + "/" + std::to_string(k)});
      }
    } else if constexpr (std::same_as<T, BodyPoses>) {
      for (std::uint32_t k = 0; k < value.num && k < kMaxMovingBodies; ++k) {
        visit_fields(value.of[k], Flattener{values, at + "/" + std::to_string(k)});
      }
    } else if constexpr (std::same_as<T, Stiffness>) {
      for (int i = 0; i < 36; ++i) put(at + "/" + std::to_string(i), value.m[i / 6][i % 6]);
    } else {
      visit_fields(value, Flattener{values, at});
    }
  }
  template <class T>
  void put(const std::string& at, T value) const {
    std::string text;
    if constexpr (std::is_enum_v<T> || std::same_as<T, bool>) {
      append_number(text, static_cast<int>(value));
    } else {
      append_number(text, value);
    }
    values.emplace_back(at, text);
  }
};

template <class T>
std::string difference_of(const T& recorded, const T& repeated) {
  if (message_of(recorded) == message_of(repeated)) return {};
  std::vector<std::pair<std::string, std::string>> a, b;
  visit_fields(recorded, Flattener{a, ""});
  visit_fields(repeated, Flattener{b, ""});
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (a[i] == b[i]) continue;
    return a[i].first + ": recorded " + a[i].second + ", repeated " + b[i].second;
  }
  return "a number differs in bits that are not written";
}

Json json_of(const std::vector<SceneObject>& objects) {
  Json list = Json::array();
  for (const SceneObject& object : objects) {
    list.push_back({{"pose", seven_numbers(object.X_WB)}});
    if (!object.name.empty()) list.back()["name"] = object.name;
    if (object.friction) list.back()["friction"] = *object.friction;
    if (object.static_ratio) list.back()["static_ratio"] = *object.static_ratio;
    if (object.viscous) list.back()["viscous"] = *object.viscous;
    if (object.moves) list.back()["mass"] = object.mass;
  }
  return list;
}

std::vector<SceneObject> objects_from(const Json& list) {
  std::vector<SceneObject> objects;
  for (const Json& json : list) {
    const auto v = json.at("pose").get<std::array<double, 7>>();
    SceneObject object{nullptr, {{v[0], v[1], v[2]}, {v[3], v[4], v[5], v[6]}}};
    const auto optional = [&](const char* name, std::optional<double>& value) {
      if (json.contains(name)) value = json[name].get<double>();
    };
    optional("friction", object.friction);
    optional("static_ratio", object.static_ratio);
    optional("viscous", object.viscous);
    object.moves = json.contains("mass");
    if (object.moves) object.mass = json["mass"].get<double>();
    object.name = json.value("name", "");  // older recordings have none
    objects.push_back(object);
  }
  return objects;
}

/// Returns, for each camera, the materials by label and the size of its labels.
Json json_of(const std::vector<std::shared_ptr<const MaterialRegions>>& regions) {
  Json list = Json::array();
  for (const auto& own : regions) {
    Json json{{"width", own ? own->width : 0}, {"height", own ? own->height : 0}};
    Json& materials = json["materials"] = Json::object();
    for (std::size_t label = 0; own && label < own->materials.size(); ++label) {
      if (!own->materials[label]) continue;
      const Material& m = *own->materials[label];
      materials[std::to_string(label)] = {{"friction", m.friction},
                                          {"static_ratio", m.static_ratio},
                                          {"viscous", m.viscous},
                                          {"ridges", m.ridges},
                                          {"grain", m.grain}};
    }
    list.push_back(std::move(json));
  }
  return list;
}

std::vector<std::shared_ptr<const MaterialRegions>> regions_from(const Json& list) {
  std::vector<std::shared_ptr<const MaterialRegions>> regions;
  for (const Json& json : list) {
    MaterialRegions own{json.at("width").get<int>(), json.at("height").get<int>(), {}, {}};
    for (const auto& [name, m] : json.at("materials").get_ref<const Json::object_t&>()) {
      std::uint8_t label = 0;
      std::from_chars(name.data(), name.data() + name.size(), label);
      if (name != std::to_string(label)) continue;
      if (own.materials.size() <= label) own.materials.resize(label + 1u);
      own.materials[label] = Material{
          m.at("friction").get<double>(), m.at("static_ratio").get<double>(),
          m.at("viscous").get<double>(), m.at("ridges").get<double>(), m.at("grain").get<double>()};
    }
    regions.push_back(std::make_shared<const MaterialRegions>(std::move(own)));
  }
  return regions;
}

Result<RunSetup> setup_of(const SettingsText& text) {
  constexpr std::size_t kMaxDepth = 16, kMaxMembers = 200;
  if (const std::string fault = JsonShape::fault_of(text.json, kMaxDepth, kMaxMembers);
      !fault.empty()) {
    return Error{Errc::bad_input, "the text of the settings " + fault + "; record the run again"};
  }
  const Json json = Json::parse(text.json);
  if (json.at("format") == "palpate run") {
    return Error{
        Errc::unavailable,
        "the recording was made by an unreleased version of palpate; record the run again"};
  }
  if (json.at("format") != kRunFormat) {
    return Error{Errc::bad_input, "the recording is not that of a run; give another one"};
  }
  if (json.at("version") != kRunVersion) {
    return Error{Errc::unavailable, "the recording has format version " +
                                        json.at("version").dump() + ", this program reads " +
                                        std::to_string(kRunVersion) +
                                        "; use the version that wrote it"};
  }
  RunSetup setup;
  const Status settings = read_json(settings_of(setup.settings), json.at("settings"));
  if (!settings) return settings.error();
  setup.settings.objects = objects_from(json.at("objects"));
  if (json.contains("regions")) {
    if (json.at("regions").size() > kMaxCameras) {
      return Error{
          Errc::bad_input,
          "the recording has labels for more cameras than there can be; record the run again"};
    }
    setup.settings.regions = regions_from(json.at("regions"));
  }
  for (const Json& stream : json.at("streams")) setup.streams.push_back(stream_from_json(stream));
  if (setup.streams.empty() || setup.streams.size() > kMaxCameras) {
    return Error{Errc::bad_input,
                 "the recording has no camera, or more than there can be; record "
                 "the run again"};
  }
  if (json.contains("probe")) setup.probe = probe_from_json(json.at("probe"));
  setup.device = text.device;
  setup.revision = text.revision;
  setup.time_origin = text.time_origin;
  return setup;
}

}  // namespace

std::string depth_topic(std::uint32_t camera) {
  return camera == 0 ? "/depth" : "/camera_" + std::to_string(camera + 1) + "/depth";
}

std::string flow_topic(std::uint32_t camera) {
  return camera == 0 ? "/flow" : "/camera_" + std::to_string(camera + 1) + "/flow";
}

std::string object_file(std::size_t index) {
  char name[40];
  std::snprintf(name, sizeof name, "object-%03zu.palp", index);
  return name;
}

std::string labels_file(std::size_t camera) {
  char name[40];
  std::snprintf(name, sizeof name, "labels-%03zu.u8", camera);
  return name;
}

McapChannel ros_channel(const std::string& topic, const std::string& type) {
  std::string name = type;
  name.insert(name.find('/'), "/msg");
  return {topic, name, message_schema(type)};
}

McapChannel part_channel() { return channel_of<PartText>(kPartTopic); }
McapChannel estimate_channel() { return channel_of<EstimateText>(kEstimateTopic); }
McapChannel settings_channel() { return channel_of<SettingsText>(kSettingsTopic); }
McapChannel frame_channel() { return channel_of<FrameRecord>(kFrameTopic); }
McapChannel contact_channel() { return channel_of<ContactRecord>(kContactTopic); }
McapChannel tick_channel() { return channel_of<TickRecord>(kTickTopic); }
McapChannel note_channel() { return channel_of<Note>(kNoteTopic); }

std::string settings_message(const RunSetup& setup) {
  RunSettings settings = setup.settings;
  settings.objects.clear();  // they have a list of their own
  Json json{{"format", kRunFormat},
            {"version", kRunVersion},
            {"program", PALPATE_VERSION},
            {"settings", to_json(settings_of(settings))},
            {"streams", to_json(setup.streams)},
            {"objects", json_of(setup.settings.objects)}};
  if (!setup.settings.regions.empty()) json["regions"] = json_of(setup.settings.regions);
  if (setup.probe) json["probe"] = to_json(*setup.probe);
  return message_of(SettingsText{setup.revision, setup.time_origin, setup.device,
                                 json.dump(-1, ' ', false, Json::error_handler_t::replace)});
}
std::string part_message(const PartStart& part) {
  const auto hand = part.hand.numbers.numbers();
  return message_of(PartText{part, {hand.begin(), hand.end()}});
}
std::string estimate_message(const EstimateStart& estimate) {
  return message_of(EstimateText{estimate.camera, estimate.revision, {estimate.state}});
}
std::string frame_message(const FrameRecord& frame) { return message_of(frame); }
std::string contact_message(const ContactRecord& contact) { return message_of(contact); }
std::string tick_message(const TickRecord& tick) { return message_of(tick); }
std::string note_message(std::string_view text) { return message_of(Note{std::string(text)}); }

Result<RunSetup> read_settings(std::string_view message) {
  const auto text = read<SettingsText>(message);
  if (!text) return text.error();
  try {
    return setup_of(*text);
  } catch (const Json::exception&) {
    return Error{Errc::bad_input,
                 "a message does not hold the settings of a run; record the run again"};
  }
}
Result<PartStart> read_part(std::string_view message) {
  auto text = read<PartText>(message);
  if (!text) return text.error();
  text->part.hand.numbers = StateNumbers(text->hand);
  return text->part;
}
Result<EstimateStart> read_estimate(std::string_view message) {
  auto text = read<EstimateText>(message);
  if (!text) return text.error();
  return EstimateStart{text->camera, text->revision, std::move(text->state.bytes)};
}
Result<FrameRecord> read_frame(std::string_view message) {
  auto frame = read<FrameRecord>(message);
  if (frame && !is_depth_unit(frame->unit)) {
    return Error{Errc::bad_input,
                 "a depth frame has a unit that is no length from 0 to 1 m; record "
                 "the run again"};
  }
  if (frame && !(is_finite(frame->X_WC) && frame->X_WC.rotation != Quaternion{0, 0, 0, 0})) {
    return Error{Errc::bad_input,
                 "a depth frame has a camera that is nowhere; record the run again"};
  }
  return frame;
}
Result<ContactRecord> read_contact(std::string_view message) {
  auto contact = read<ContactRecord>(message);
  if (contact && contact->cameras.num > kMaxCameras) {
    return Error{Errc::bad_input, "a contact has " + std::to_string(contact->cameras.num) +
                                      " cameras, more than there can be; record the run again"};
  }
  if (contact && contact->bodies.num > kMaxMovingBodies) {
    return Error{Errc::bad_input, "a contact has " + std::to_string(contact->bodies.num) +
                                      " bodies, more than can move; record the run again"};
  }
  return contact;
}
Result<TickRecord> read_tick(std::string_view message) { return read<TickRecord>(message); }
Result<std::string> read_note(std::string_view message) {
  auto note = read<Note>(message);
  if (!note) return note.error();
  return std::move(note->text);
}

std::string difference(const ContactRecord& recorded, const ContactRecord& repeated) {
  return difference_of(recorded, repeated);
}
std::string difference(const TickRecord& recorded, const TickRecord& repeated) {
  return difference_of(recorded, repeated);
}

}}  // namespace palpate::v0
