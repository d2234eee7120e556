#include "src/session/settings_json.h"

#include <nlohmann/json.hpp>

#include "palpate/session/names.h"

namespace palpate {
namespace {

using Json = nlohmann::ordered_json;

// One list of members serves both directions.
template <class Options, class Visit>
void visit_filter(Options& options, Visit visit) {
  visit("enabled", options.enabled);
  visit("radius", options.radius);
  visit("sigma_space", options.sigma_space);
  visit("sigma_depth", options.sigma_depth);
}

template <class Options, class Visit>
void visit_normals(Options& options, Visit visit) {
  visit("radius", options.radius);
  visit("max_depth_change", options.max_depth_change);
  visit("anchoring", options.anchoring);
  visit("weighting", options.weighting);
  visit("weight_sigma", options.weight_sigma);
  visit("normalization", options.normalization);
  visit("min_neighbours", options.min_neighbours);
}

template <class Options, class Visit>
void visit_depth_change(Options& options, Visit visit) {
  visit("enabled", options.enabled);
  visit("min_step", options.min_step);
}

template <class Options, class Visit>
void visit_time(Options& options, Visit visit) {
  visit("max_jump", options.max_jump);
  visit("first_period", options.first_period);
  visit("average_frames", options.average.frames);
  visit("average_weight", options.average.weight);
  visit("average_max_jump", options.average.max_jump);
  visit("average_keep_frames", options.average.keep_frames);
}

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
}

/// Visitors that write members to, and read them from, a JSON object.
auto writer(Json& json) {
  return [&json](const char* name, const auto& value) { json[name] = value; };
}
auto reader(const Json& json) {
  return [&json](const char* name, auto& value) { json.at(name).get_to(value); };
}

Json surface_to_json(const SurfaceOptions& options) {
  Json json{{"min_depth", options.min_depth}, {"max_depth", options.max_depth}};
  visit_filter(options.filter, writer(json["filter"]));
  json["normals"]["fit"] = name_of(kPlaneFitNames, options.normals.fit);
  visit_normals(options.normals, writer(json["normals"]));
  visit_depth_change(options.depth_change, writer(json["depth_change"]));
  return json;
}

SurfaceOptions surface_from_json(const Json& json) {
  SurfaceOptions options;
  json.at("min_depth").get_to(options.min_depth);
  json.at("max_depth").get_to(options.max_depth);
  visit_filter(options.filter, reader(json.at("filter")));
  visit_normals(options.normals, reader(json.at("normals")));
  visit_depth_change(options.depth_change, reader(json.at("depth_change")));
  return options;
}

template <class Value, std::size_t n>
bool read_name(const Json& json, const char* key, const std::array<Named<Value>, n>& table,
               Value& value) {
  const std::string name = json.at(key).get<std::string>();
  for (const auto& entry : table) {
    if (entry.name == name) return value = entry.value, true;
  }
  return false;
}

/// The same for a setting that older recordings do not have: they keep its default.
template <class Value, std::size_t n>
bool read_new_name(const Json& json, const char* key, const std::array<Named<Value>, n>& table,
                   Value& value) {
  return !json.contains(key) || read_name(json, key, table, value);
}

Json time_to_json(const TimeOptions& options) {
  Json json{{"mode", name_of(kTimeModeNames, options.mode)},
            {"average", name_of(kDepthAverageNames, options.average.kind)}};
  visit_time(options, writer(json));
  return json;
}

/// Older recordings felt the latest frame. False: a name that is not known.
bool read_time(const Json& json, TimeOptions& options) {
  options.mode = TimeMode::latest;
  if (!json.contains("time")) return true;
  const Json& time = json["time"];
  visit_time(options, reader(time));
  return read_name(time, "mode", kTimeModeNames, options.mode) &&
         read_name(time, "average", kDepthAverageNames, options.average.kind);
}

Json to_json(const SceneObject& object) {
  const Vec3d& p = object.X_WB.translation;
  const Quaternion& q = object.X_WB.rotation;
  return {{"source", object.shape->source()},
          {"spheres", object.shape->spheres().size()},
          {"pose", {p.x, p.y, p.z, q.x, q.y, q.z, q.w}}};
}

std::vector<SceneObject> objects_from_json(const Json& json) {
  std::vector<SceneObject> objects;
  for (const Json& object : json) {
    const auto v = object.at("pose").get<std::array<double, 7>>();
    objects.push_back({nullptr, {{v[0], v[1], v[2]}, {v[3], v[4], v[5], v[6]}}});
  }
  return objects;
}

}  // namespace

Json to_json(const RunSettings& settings) {
  Json json{{"rate", settings.rate},
            {"method", name_of(kMethodNames, settings.contact.method)},
            {"priority", name_of(kPriorityNames, settings.contact.priority)},
            {"inside", name_of(kInsideNames, settings.contact.inside)},
            {"volumes", name_of(kVolumesNames, std::optional(settings.contact.counted()))},
            {"edges", name_of(kEdgesNames, settings.contact.edges)},
            {"continuity", name_of(kContinuityNames, settings.contact.continuity)},
            {"backend", name_of(kBackendNames, settings.backend)},
            {"sensing_gpu", settings.sensing_gpu},
            {"contact_gpu", settings.contact_gpu},
            {"threads", settings.num_threads},
            {"surface", surface_to_json(settings.surface)},
            {"field",
             {{"unknown", name_of(kUnknownNames, settings.field.unknown)},
              {"fill_levels", settings.field.fill_levels},
              {"thickness", settings.field.thickness}}},
            {"time", time_to_json(settings.time)}};
  for (const SceneObject& object : settings.objects) json["objects"].push_back(to_json(object));
  if (settings.probe) json["probe"] = to_json(*settings.probe);
  return json;
}

Result<RunSettings> settings_from_json(const Json& json) {
  RunSettings settings;
  json.at("rate").get_to(settings.rate);
  json.at("threads").get_to(settings.num_threads);
  settings.sensing_gpu = json.value("sensing_gpu", 0);  // older recordings know no GPU
  settings.contact_gpu = json.value("contact_gpu", 0);
  settings.surface = surface_from_json(json.at("surface"));
  if (json.contains("field")) {
    json["field"].at("fill_levels").get_to(settings.field.fill_levels);
    json["field"].at("thickness").get_to(settings.field.thickness);
  }
  if (json.contains("objects")) settings.objects = objects_from_json(json.at("objects"));
  if (json.contains("probe")) settings.probe = probe_from_json(json.at("probe"));
  if (!read_name(json, "method", kMethodNames, settings.contact.method) ||
      !read_name(json, "priority", kPriorityNames, settings.contact.priority) ||
      !read_name(json, "inside", kInsideNames, settings.contact.inside) ||
      (json.contains("field") &&
       !read_name(json["field"], "unknown", kUnknownNames, settings.field.unknown)) ||
      !read_new_name(json, "volumes", kVolumesNames, settings.contact.volumes) ||
      !read_new_name(json, "edges", kEdgesNames, settings.contact.edges) ||
      !read_new_name(json, "continuity", kContinuityNames, settings.contact.continuity) ||
      !read_time(json, settings.time) ||
      !read_name(json, "backend", kBackendNames, settings.backend) ||
      !read_name(json.at("surface").at("normals"), "fit", kPlaneFitNames,
                 settings.surface.normals.fit)) {
    return Error{Errc::bad_input,
                 "the settings name a method, priority, volume, edge rule, smoothing, time mode, "
                 "average, backend or plane fit that this version does not know"};
  }
  return settings;
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
  return json;
}

DepthStreamInfo stream_from_json(const Json& json) {
  DepthStreamInfo stream;
  visit_stream(stream, reader(json));
  return stream;
}

}  // namespace palpate
