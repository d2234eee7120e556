#include "palpate/session/recording.h"

#include <zlib.h>

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "palpate/io/atomic_file.h"
#include "palpate/io/depth_files.h"
#include "palpate/io/tool_file.h"
#include "palpate/session/run_folder.h"
#include "src/session/settings_json.h"
#include "src/session/text.h"

namespace palpate {
namespace fs = std::filesystem;
namespace {

using Json = nlohmann::ordered_json;

constexpr int kVersion = 2;
constexpr int kVersionWithoutObjects = 1;  // older programs can repeat such a recording
constexpr const char* kTool = "tool.palp";
constexpr const char* kPath = "path.txt";
constexpr const char* kFrameList = "depth.txt";

std::string crc32_hex(std::string_view bytes) {
  uLong crc = crc32(0, nullptr, 0);
  crc = crc32_z(crc, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size());
  char text[16];
  std::snprintf(text, sizeof text, "%08lx", crc);
  return text;
}

std::string object_file(std::size_t index) {
  char name[40];
  std::snprintf(name, sizeof name, "object-%03zu.palp", index);
  return name;
}

std::string poses_text(const std::vector<TickRecord>& ticks) {
  std::string text = "# t tx ty tz qx qy qz qw\n";
  for (const TickRecord& tick : ticks) {
    const Vec3d& p = tick.X_WT.translation;
    const Quaternion& q = tick.X_WT.rotation;
    append_row(text, ' ', tick.time, p.x, p.y, p.z, q.x, q.y, q.z, q.w);
  }
  return text;
}

/// Poses exactly as they were used. (load_trajectory would normalise the quaternions once more and
/// so change their last bits.)
Result<std::vector<Pose>> parse_poses(std::string_view text, const fs::path& path) {
  std::vector<Pose> poses;
  int line_number = 0;
  while (!text.empty()) {
    ++line_number;
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    if (line.empty() || line[0] == '#') continue;
    double values[8];
    const char* at = line.data();
    const char* const last = at + line.size();
    bool good = true;
    for (double& value : values) {
      while (at < last && *at == ' ') ++at;
      const auto [stop, error] = std::from_chars(at, last, value);
      good = good && error == std::errc{};
      at = stop;
    }
    if (!good || at != last) {
      return Error{Errc::bad_input,
                   path.string() + " line " + std::to_string(line_number) +
                       ": expected 't tx ty tz qx qy qz qw'; record the run again"};
    }
    poses.push_back(
        {{values[1], values[2], values[3]}, {values[4], values[5], values[6], values[7]}});
  }
  return poses;
}

Error damaged(const fs::path& path, const std::string& what) {
  return {Errc::bad_input, path.string() + " " + what + "; record the run again"};
}

/// What a manifest lacks, in plain words.
std::string explain(const Json::exception& exception) {
  constexpr int kMissingKey = 403;
  const std::string what = exception.what();
  const std::size_t begin = what.find('\''), end = what.rfind('\'');
  if (exception.id == kMissingKey && begin < end && end != std::string::npos) {
    return "it has no \"" + what.substr(begin + 1, end - begin - 1) + "\"";
  }
  if (dynamic_cast<const Json::parse_error*>(&exception) != nullptr) return "it is not JSON";
  return "one of its values is of the wrong kind";
}

Error no_manifest(const fs::path& path, const Json::exception& exception) {
  return {Errc::bad_input, path.string() + " is not a recording of palpate: " + explain(exception) +
                               "; give the folder of a run that palpate wrote, or record it again"};
}

/// Everything in the manifest, before the files are touched.
struct Manifest {
  RunSettings settings;
  DepthStreamInfo stream;
  Json files;
};

Result<Manifest> read_manifest(const fs::path& folder) {
  const fs::path path = folder / kRecordingManifest;
  const auto text = read_file(path, std::size_t(1) << 30);
  if (!text && text.error().code == Errc::not_found) {
    return Error{Errc::not_found, "no recording in " + folder.string() +
                                      ": give the folder of a run that palpate wrote"};
  }
  if (!text) return text.error();
  try {
    const Json json = Json::parse(*text);
    if (json.at("format") != kRecordingFormat)
      return damaged(path, "is not the manifest of a recording");
    const int version = json.at("version").get<int>();
    if (version < kVersionWithoutObjects || version > kVersion) {
      return Error{Errc::bad_input,
                   path.string() + " has format version " + json.at("version").dump() +
                       ", this program reads versions up to " + std::to_string(kVersion) +
                       "; use the version that wrote it"};
    }
    if (!json.contains("files")) return damaged(path, "is unfinished");
    auto settings = settings_from_json(json.at("settings"));
    if (!settings) return damaged(path, "cannot be used: " + settings.error().message);
    return Manifest{*settings, stream_from_json(json.at("stream")), json.at("files")};
  } catch (const Json::exception& exception) {
    return no_manifest(path, exception);
  }
}

/// Every listed file must be there as it was written, and every necessary file be listed.
Status check_files(const fs::path& folder, const Json& files, std::size_t num_objects) {
  try {
    for (const Json& entry : files) {
      const auto name = entry.at("name").get<std::string>();
      const fs::path path = folder / name;
      const auto content = read_file(path);
      if (!content) return content.error();
      if (content->size() != entry.at("bytes").get<std::size_t>() ||
          crc32_hex(*content) != entry.at("crc32").get<std::string>()) {
        return damaged(path, "was changed after the recording (its checksum differs)");
      }
    }
    std::vector<std::string> necessary{kTool, kPath, kFrameList};
    for (std::size_t i = 0; i < num_objects; ++i) necessary.push_back(object_file(i));
    for (const std::string& name : necessary) {
      const bool listed = std::any_of(files.begin(), files.end(),
                                      [&](const Json& entry) { return entry.at("name") == name; });
      if (!listed) return damaged(folder / kRecordingManifest, "does not list " + name);
    }
  } catch (const Json::exception& exception) {
    return no_manifest(folder / kRecordingManifest, exception);
  }
  return Done{};
}

}  // namespace

Result<Recorder> Recorder::create(const fs::path& folder, const Tool& tool,
                                  std::span<const SceneObject> objects) {
  std::error_code error;
  fs::create_directories(folder / "depth", error);
  if (error) {
    return Error{Errc::io_failure, "cannot make the folder " + folder.string() + ": " +
                                       error.message() + "; check permissions and free space"};
  }
  // The manifest comes first without its list of files: it marks the folder as ours.
  const Json manifest{{"format", kRecordingFormat},
                      {"version", objects.empty() ? kVersionWithoutObjects : kVersion}};
  if (const Status status =
          write_file_atomically(folder / kRecordingManifest, manifest.dump(1) + "\n");
      !status) {
    return status.error();
  }
  Recorder recorder(folder);
  recorder.frame_list_ = "# time stamp in seconds, file\n";
  if (const Status status = recorder.add_tool(tool, kTool); !status) return status.error();
  for (std::size_t i = 0; i < objects.size(); ++i) {
    if (objects[i].shape == nullptr) {
      return Error{Errc::invalid_argument,
                   "object " + std::to_string(i) + " has no shape; give it a tool"};
    }
    const Status status = recorder.add_tool(*objects[i].shape, object_file(i));
    if (!status) return status.error();
  }
  return recorder;
}

Status Recorder::add_tool(const Tool& tool, const std::string& name) {
  if (const Status status = save_tool(tool, folder_ / name); !status) return status;
  return add_file(name);
}

Status Recorder::add_file(const std::string& name) {
  const auto content = read_file(folder_ / name);
  if (!content) return content.error();
  files_.push_back({name, content->size(), crc32_hex(*content)});
  return Done{};
}

Status Recorder::add_frame(std::size_t index, double time, const DepthFrame& frame) {
  char name[32];
  std::snprintf(name, sizeof name, "depth/%06zu.png", index);
  if (const Status status = save_depth_png(frame, folder_ / name); !status) return status;
  append_number(frame_list_, time);
  frame_list_ += std::string(" ") + name + "\n";
  return add_file(name);
}

Status Recorder::finish(const RunLog& log) {
  const std::pair<const char*, std::string> texts[] = {{kFrameList, frame_list_},
                                                       {kPath, poses_text(log.ticks)}};
  for (const auto& [name, text] : texts) {
    if (const Status status = write_file_atomically(folder_ / name, text); !status) return status;
    if (const Status status = add_file(name); !status) return status;
  }
  const bool has_objects = !log.settings.objects.empty();
  Json manifest{
      {"format", kRecordingFormat},    {"version", has_objects ? kVersion : kVersionWithoutObjects},
      {"program", PALPATE_VERSION},    {"ticks", log.ticks.size()},
      {"frames", log.frames.size()},   {"settings", to_json(log.settings)},
      {"stream", to_json(log.stream)}, {"files", Json::array()}};
  for (const FileEntry& file : files_) {
    manifest["files"].push_back(
        {{"name", file.name}, {"bytes", file.bytes}, {"crc32", file.checksum}});
  }
  // A name in the stream's title may hold any bytes: what is not UTF-8 is replaced.
  return write_file_atomically(folder_ / kRecordingManifest,
                               manifest.dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
}

Result<Recording> load_recording(const fs::path& folder) {
  auto manifest = read_manifest(folder);
  if (!manifest) return manifest.error();
  std::vector<SceneObject>& objects = manifest->settings.objects;
  if (const Status status = check_files(folder, manifest->files, objects.size()); !status)
    return status.error();

  auto tool = load_tool(folder / kTool);
  if (!tool) return tool.error();
  for (std::size_t i = 0; i < objects.size(); ++i) {
    auto shape = load_tool(folder / object_file(i));
    if (!shape) return shape.error();
    objects[i].shape = std::make_shared<const Tool>(*std::move(shape));
  }
  const auto text = read_file(folder / kPath);
  if (!text) return text.error();
  auto poses = parse_poses(*text, folder / kPath);
  if (!poses) return poses.error();
  if (poses->empty()) return damaged(folder / kPath, "holds no pose");
  DepthFolderOptions options;
  options.intrinsics = manifest->stream.intrinsics;
  options.unit = manifest->stream.unit;
  options.rate = manifest->stream.rate;
  auto frames = open_depth_folder(folder, options);
  if (!frames) return frames.error();
  return Recording{*std::move(tool), manifest->settings, *std::move(poses), *std::move(frames)};
}

}  // namespace palpate
