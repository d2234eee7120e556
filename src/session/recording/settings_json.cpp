#include "src/session/internal/settings_json.h"

#include <nlohmann/json.hpp>
#include <vector>

#include "src/session/internal/probing_path.h"

namespace palpate { inline namespace v0 {
namespace {

using Json = nlohmann::ordered_json;

template <class Stream, class Visit>
void visit_stream(Stream& stream, Visit visit) {
  visit("name", stream.name);
  visit("width", stream.width);
  visit("height", stream.height);
  visit("fx", stream.intrinsics.fx);
  visit("fy", stream.intrinsics.fy);
  visit("cx", stream.intrinsics.cx);
  visit("cy", stream.intrinsics.cy);
  visit("unit", stream.unit);
  visit("rate", stream.rate);
  visit("is_moving", stream.is_moving);
}

/// Visitors that write members to, and read them from, a JSON object.
auto writer(Json& json) {
  return [&json](const char* name, const auto& value) { json[name] = value; };
}
auto reader(const Json& json) {
  return [&json](const char* name, auto& value) { json.at(name).get_to(value); };
}

}  // namespace

Json to_json(const SettingTable& table) {
  Json json = Json::object();
  for (const Setting& setting : table) {
    json[std::string(setting.section)][std::string(setting.name)] = value_to_json(setting);
  }
  return json;
}

Status read_json(SettingTable table, const Json& json) {
  const std::string advice = "; use the version of palpate that wrote this";
  std::size_t num = 0;
  for (const auto& [section, keys] : json.items()) num += keys.size();
  for (Setting& setting : table) {
    const auto section = json.find(std::string(setting.section));
    if (section == json.end() || !section->contains(std::string(setting.name))) {
      return Error{Errc::bad_input, "the settings lack " + setting.key() + advice};
    }
    const auto value = value_from_json(section->at(std::string(setting.name)));
    if (!value) {
      return Error{Errc::bad_input, setting.key() + " must be " + setting.accepted()};
    }
    if (Status status = setting.set(*value); !status) return status;
    --num;
  }
  if (num == 0) return Done{};
  for (const auto& [section, keys] : json.items()) {
    for (const auto& [key, value] : keys.items()) {
      if (table.find(section + "." + key) != nullptr) continue;
      return Error{Errc::bad_input,
                   "the settings have " + section + "." + key + ", which is not known" + advice};
    }
  }
  return Done{};
}

Json value_to_json(const Setting& setting) {
  const SettingValue value = setting.get();
  switch (setting.kind) {
    case SettingKind::flag: return std::get<bool>(value);
    case SettingKind::whole: return static_cast<int>(std::get<double>(value));
    case SettingKind::number:
      if (const double* const number = std::get_if<double>(&value)) return *number;
      [[fallthrough]];
    case SettingKind::word: return std::get<std::string>(value);
    case SettingKind::pose: break;
  }
  return seven_numbers(std::get<Pose>(value));
}

std::optional<SettingValue> value_from_json(const Json& json) {
  if (json.is_boolean()) return SettingValue(json.get<bool>());
  if (json.is_number()) return SettingValue(json.get<double>());
  if (json.is_string()) return SettingValue(json.get<std::string>());
  std::vector<double> numbers;
  for (const Json& element : json) {
    if (!json.is_array() || !element.is_number()) return std::nullopt;
    numbers.push_back(element.get<double>());
  }
  return pose_of(numbers);
}

Json to_json(const ProbeChoice& probe) {
  const auto list = [](const Vec3d& v) { return Json{v.x, v.y, v.z}; };
  return {{"pixel", {probe.u, probe.v}},  {"point", list(probe.p_W)}, {"time", probe.time},
          {"why_place", probe.why_place}, {"tip", list(probe.tip_T)}, {"why_tip", probe.why_tip},
          {"note", probe.note},           {"how_to_aim", kHowToAim}};
}

ProbeChoice probe_from_json(const Json& json) {
  const auto vector = [](const Json& list) {
    const auto v = list.get<std::array<double, 3>>();
    return Vec3d{v[0], v[1], v[2]};
  };
  const auto pixel = json.at("pixel").get<std::array<double, 2>>();
  return {pixel[0],
          pixel[1],
          vector(json.at("point")),
          json.at("time"),
          vector(json.at("tip")),
          json.at("why_place"),
          json.at("why_tip"),
          json.at("note")};
}

Json to_json(const DepthStreamInfo& stream) {
  Json json;
  visit_stream(stream, writer(json));
  json["sensor"] = name_of(stream.sensor);
  if (stream.has_flow) json["has_flow"] = true;
  return json;
}

Json to_json(const std::vector<DepthStreamInfo>& streams) {
  Json list = Json::array();
  for (const DepthStreamInfo& stream : streams) list.push_back(to_json(stream));
  return list;
}

DepthStreamInfo stream_from_json(const Json& json) {
  DepthStreamInfo stream;
  visit_stream(stream, reader(json));
  stream.sensor =
      value_named<SensorKind>(json.at("sensor").get<std::string>()).value_or(SensorKind::none);
  stream.has_flow = json.value("has_flow", false);  // older streams have none
  return stream;
}

}}  // namespace palpate::v0
