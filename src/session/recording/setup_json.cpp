// The setup of a run as JSON in its recording: settings, cameras, objects and material regions.
//
// Shapes of objects and labels of regions are files of the recording, so the text stays short and
// can be written again at the beginning of each part.
#include "src/session/internal/run_messages.h"

#include <array>
#include <charconv>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "palpate/version.h"
#include "src/io/internal/json_shape.h"
#include "src/session/internal/settings_json.h"

namespace palpate { inline namespace v0 {
namespace {

using Json = nlohmann::ordered_json;

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

Result<RunSetup> setup_of(const std::string& text) {
  constexpr std::size_t kMaxDepth = 16, kMaxMembers = 200;
  if (const std::string fault = JsonShape::fault_of(text, kMaxDepth, kMaxMembers); !fault.empty()) {
    return Error{Errc::bad_input, "the text of the settings " + fault + "; record the run again"};
  }
  const Json json = Json::parse(text);
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
  return setup;
}

}  // namespace

std::string setup_json(const RunSetup& setup) {
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
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Result<RunSetup> setup_from_json(const std::string& json) {
  try {
    return setup_of(json);
  } catch (const Json::exception&) {
    return Error{Errc::bad_input,
                 "a message does not hold the settings of a run; record the run again"};
  }
}

}}  // namespace palpate::v0
