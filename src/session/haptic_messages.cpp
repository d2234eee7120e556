#include "src/session/haptic_messages.h"

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "palpate/io/depth_files.h"
#include "src/session/base64.h"
#include "src/session/haptic_fields.h"
#include "src/session/settings_json.h"
#include "src/session/text.h"

namespace palpate {
namespace {

using Json = nlohmann::ordered_json;

template <class T>
concept Number = std::is_arithmetic_v<T> && !std::same_as<T, bool>;

// JSON has no words for what is not a number: these are strings. Its readers take -0 for a whole
// number, which has no sign.
const char* special_name(double value) {
  if (std::isnan(value)) return "\"NaN\"";
  if (std::isinf(value)) return value > 0 ? "\"Infinity\"" : "\"-Infinity\"";
  if (value == 0 && std::signbit(value)) return "-0.0";
  return nullptr;
}

class Writer {
 public:
  explicit Writer(std::string& text) : text_(text) { text_ += '{'; }
  ~Writer() { text_ += '}'; }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;

  template <class T>
  void operator()(const char* name, const T& value) {
    text_ += is_first_ ? "\"" : ",\"";
    is_first_ = false;
    text_ += name;
    text_ += "\":";
    put(value);
  }
  void optional(const char* name, std::uint32_t value) {
    if (value != 0) (*this)(name, value);
  }

 private:
  void put(bool value) { text_ += value ? "true" : "false"; }
  void put(Number auto value) {
    if constexpr (std::floating_point<decltype(value)>) {
      if (const char* name = special_name(value)) {
        text_ += name;
        return;
      }
    }
    append_number(text_, value);
  }
  void put(Fault fault) { text_ += '"' + name_of(fault) + '"'; }
  void put(const std::string& words) {
    text_ += Json(words).dump(-1, ' ', false, Json::error_handler_t::replace);
  }
  void put(const Stiffness& stiffness) {
    text_ += '[';
    for (const auto& row : stiffness.m) {
      for (const double value : row) {
        if (text_.back() != '[') text_ += ',';
        put(value);
      }
    }
    text_ += ']';
  }
  template <class T>
  requires std::is_class_v<T>
  void put(const T& value) { visit_fields(value, Writer(text_)); }

  std::string& text_;
  bool is_first_ = true;
};

class Reader {
 public:
  explicit Reader(const Json& json) : json_(json) {}

  template <class T>
  void operator()(const char* name, T& value) const {
    get(json_.at(name), value);
  }
  void optional(const char* name, std::uint32_t& value) const {
    if (json_.contains(name)) get(json_.at(name), value);
  }

 private:
  template <class T>
  requires std::is_arithmetic_v<T>
  static void get(const Json& json, T& value) {
    if constexpr (std::floating_point<T>) {
      if (json.is_string()) {
        const auto name = json.get<std::string>();
        value = name == "NaN" ? NAN : name == "Infinity" ? INFINITY : -INFINITY;
        return;
      }
    }
    json.get_to(value);
  }
  static void get(const Json& json, std::string& words) { json.get_to(words); }
  static void get(const Json& json, Fault& fault) {
    fault = value_named<Fault>(json.get<std::string>()).value_or(Fault::none);
  }
  static void get(const Json& json, Stiffness& stiffness) {
    for (std::size_t i = 0; i < 36; ++i) get(json.at(i), stiffness.m[i / 6][i % 6]);
  }
  template <class T>
  requires std::is_class_v<T>
  static void get(const Json& json, T& value) { visit_fields(value, Reader(json)); }

  const Json& json_;
};

/// What a message looks like, for viewers.
class Schema {
 public:
  template <class T>
  void operator()(const char* name, const T& value) {
    properties_[name] = type(value);
  }
  void optional(const char* name, std::uint32_t value) { (*this)(name, value); }
  Json object() const { return {{"type", "object"}, {"properties", properties_}}; }

 private:
  static Json type(bool) { return {{"type", "boolean"}}; }
  static Json type(double) { return {{"type", "number"}}; }
  static Json type(std::integral auto) { return {{"type", "integer"}}; }
  static Json type(Fault) { return {{"type", "string"}}; }
  static Json type(const std::string&) { return {{"type", "string"}}; }
  static Json type(const Stiffness&) {
    return {{"type", "array"}, {"items", {{"type", "number"}}}};
  }
  template <class T>
  requires std::is_class_v<T>
  static Json type(const T& value) {
    Schema schema;
    visit_fields(value, schema);
    return schema.object();
  }

  Json properties_ = Json::object();
};

template <class T>
std::string schema_of() {
  Schema schema;
  const T value{};
  visit_fields(value, schema);
  return schema.object().dump();
}

template <class T>
std::string text_of(const T& value) {
  std::string text;
  text.reserve(2048);
  visit_fields(value, Writer(text));
  return text;
}

/// What `read` makes of a message; it may throw JSON's exceptions.
template <class T, class Read>
Result<T> parse(std::string_view message, const char* what, Read read) {
  try {
    return read(Json::parse(message));
  } catch (const Json::exception&) {
    return Error{Errc::bad_input, std::string("a message is not ") + what +
                                      " of a haptic run; record the run again"};
  }
}

template <class T>
Result<T> parse_fields(std::string_view message, const char* what) {
  return parse<T>(message, what, [](const Json& json) -> Result<T> {
    T value;
    visit_fields(value, Reader(json));
    return value;
  });
}

constexpr std::uint64_t kNanoseconds = 1'000'000'000;

Json time_json(std::uint64_t time) {
  return {{"sec", time / kNanoseconds}, {"nsec", time % kNanoseconds}};
}

const char* const kTimeSchema =
    R"("timestamp":{"type":"object","title":"time","properties":{"sec":{"type":"integer"},)"
    R"("nsec":{"type":"integer"}}})";

}  // namespace

McapChannel settings_channel() {
  return {kSettingsTopic, "palpate.HapticSettings", R"({"type":"object"})"};
}

McapChannel depth_channel() {
  return {kDepthTopic, "foxglove.CompressedImage",
          std::string(R"({"title":"foxglove.CompressedImage","type":"object","properties":{)") +
              kTimeSchema +
              R"(,"frame_id":{"type":"string"},)"
              R"("data":{"type":"string","contentEncoding":"base64"},"format":{"type":"string"},)"
              R"("number":{"type":"integer"},"capture_time":{"type":"number"},)"
              R"("source_time":{"type":"number"},"unit":{"type":"number"},)"
              R"("revision":{"type":"integer"}}})"};
}

McapChannel contact_channel() {
  return {kContactTopic, "palpate.Contact", schema_of<ContactRecord>()};
}

McapChannel tick_channel() { return {kTickTopic, "palpate.Tick", schema_of<HapticRecord>()}; }

McapChannel note_channel() {
  return {kNoteTopic, "foxglove.Log",
          std::string(R"({"title":"foxglove.Log","type":"object","properties":{)") + kTimeSchema +
              R"(,"level":{"type":"integer"},"message":{"type":"string"},)"
              R"("name":{"type":"string"},"file":{"type":"string"},"line":{"type":"integer"}}})"};
}

std::string settings_message(const HapticSetup& setup) {
  Json json{{"format", kHapticFormat},
            {"version", kHapticVersion},
            {"program", PALPATE_VERSION},
            {"settings", to_json(settings_of(setup.settings))},
            {"stream", to_json(setup.stream)},
            {"device", Json::parse(text_of(setup.device))},
            {"tool", {{"file", kHapticTool}, {"xxh3", setup.tool_checksum}}}};
  if (setup.revision != 0) json["revision"] = setup.revision;
  if (setup.probe) json["probe"] = to_json(*setup.probe);
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Result<std::string> depth_message(std::uint64_t number, double capture_time,
                                  const DepthFrame& frame, std::uint64_t time,
                                  std::uint32_t revision) {
  const auto png = encode_depth_png(frame, "depth frame " + std::to_string(number));
  if (!png) return png.error();
  Json json{{"timestamp", time_json(time)},
            {"frame_id", "camera"},
            {"format", "png"},
            {"number", number},
            {"capture_time", capture_time},
            {"source_time", frame.timestamp},
            {"unit", frame.unit},
            {"data", base64(*png)}};
  if (revision != 0) json["revision"] = revision;
  return json.dump();
}

std::string contact_message(const ContactRecord& contact) { return text_of(contact); }

std::string tick_message(const HapticRecord& tick) { return text_of(tick); }

std::string note_message(std::string_view text, std::uint64_t time) {
  constexpr int kInformation = 2;
  const Json json{{"timestamp", time_json(time)},
                  {"level", kInformation},
                  {"message", text},
                  {"name", "palpate"},
                  {"file", ""},
                  {"line", 0}};
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Result<HapticSetup> read_settings(std::string_view message) {
  return parse<HapticSetup>(message, "the settings", [](const Json& json) -> Result<HapticSetup> {
    if (json.at("format") != kHapticFormat) {
      return Error{Errc::bad_input, "the recording is not that of a haptic run; give another one"};
    }
    if (json.at("version") != kHapticVersion) {
      return Error{Errc::bad_input, "the recording has format version " +
                                        json.at("version").dump() + ", this program reads " +
                                        std::to_string(kHapticVersion) +
                                        "; use the version that wrote it"};
    }
    HapticSetup setup;
    const Status settings = read_json(settings_of(setup.settings), json.at("settings"));
    if (!settings) return settings.error();
    setup.stream = stream_from_json(json.at("stream"));
    visit_fields(setup.device, Reader(json.at("device")));
    json.at("tool").at("xxh3").get_to(setup.tool_checksum);
    setup.revision = json.value("revision", 0u);
    if (json.contains("probe")) setup.probe = probe_from_json(json.at("probe"));
    return setup;
  });
}

Result<HapticFrame> read_depth(std::string_view message) {
  return parse<HapticFrame>(message, "a depth frame", [](const Json& json) -> Result<HapticFrame> {
    HapticFrame seen;
    json.at("number").get_to(seen.number);
    json.at("capture_time").get_to(seen.capture_time);
    seen.revision = json.value("revision", 0u);
    const auto png = from_base64(json.at("data").get_ref<const std::string&>());
    if (!png) return Error{Errc::bad_input, "a depth frame is not base64; record the run again"};
    auto frame = decode_depth_png(*png, "depth frame " + std::to_string(seen.number),
                                  json.at("unit").get<double>());
    if (!frame) return frame.error();
    seen.frame = *std::move(frame);
    json.at("source_time").get_to(seen.frame.timestamp);
    return seen;
  });
}

Result<ContactRecord> read_contact(std::string_view message) {
  return parse_fields<ContactRecord>(message, "a contact");
}

Result<HapticRecord> read_tick(std::string_view message) {
  return parse_fields<HapticRecord>(message, "a tick");
}

}  // namespace palpate
