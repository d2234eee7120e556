// Large texts: paths, lists of frames, tables of joints, robots, settings and rigs.
#include <limits>

#include "palpate/cameras/cameras.h"
#include "palpate/io/files.h"
#include "palpate/io/formats.h"
#include "palpate/session/run.h"
#include "src/cameras/internal/robot_model.h"
#include "src/cameras/robot/joint_history.h"
#include "src/io/internal/cdr.h"
#include "src/session/internal/run_messages.h"
#include "tests/fuzz/large_inputs.h"

namespace palpate::fuzz {
namespace {

namespace fs = std::filesystem;

std::string time_of(std::size_t i) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3f", 1e-3 * static_cast<double>(i));
  return text;
}

void poses_txt(const fs::path& path, std::size_t num_bytes) {
  write_pieces(path, num_bytes, "",
               [](std::size_t i) { return time_of(i) + " 0.123456 -0.5 0.75 0 0 0.6 0.8\n"; });
}

/// A folder whose list names one image again and again.
void list_txt(const fs::path& path, std::size_t num_bytes) {
  fs::create_directories(path);
  (void)save_depth_png({8, 8, 0.001, std::vector<std::uint16_t>(64, 700), 0}, path / "a.png");
  write_pieces(path / "depth.txt", num_bytes, "",
               [](std::size_t i) { return time_of(i) + " a.png\n"; });
}

/// No image has an optical flow; another one has.
void flowless_txt(const fs::path& path, std::size_t num_bytes) {
  list_txt(path, num_bytes);
  fs::create_directories(path / "flow");
  write_pieces(path / "flow" / "b.flo", 0, "PIEH", nullptr);
}

void joints_csv(const fs::path& path, std::size_t num_bytes) {
  write_pieces(path, num_bytes, "time,elbow,shoulder\n",
               [](std::size_t i) { return time_of(i) + ",0.123456,-1.5\n"; });
}
void columns_csv(const fs::path& path, std::size_t num_bytes) {
  std::string names = "time", values = "0";
  for (int k = 0; names.size() + values.size() < num_bytes; ++k) {
    names += ",a" + std::to_string(k);
    values += ",1";
  }
  write_pieces(path, 0, names + "\n" + values + "\n", nullptr);
}

std::size_t urdf_size(std::size_t num_bytes) {
  return std::min(num_bytes, std::size_t(64) << 20);  // more is refused
}
void elements_urdf(const fs::path& path, std::size_t num_bytes) {
  write_pieces(
      path, urdf_size(num_bytes), "<robot><link name='a'>", [](std::size_t) { return "<b/>"; },
      "</link></robot>");
}
void attributes_urdf(const fs::path& path, std::size_t num_bytes) {
  write_pieces(
      path, urdf_size(num_bytes), "<robot><link ", [](std::size_t) { return "a='' "; },
      "name='a'/></robot>");
}
/// Joints that follow each other, with numbers behind many blanks.
void followers_urdf(const fs::path& path, std::size_t num_bytes) {
  constexpr std::size_t kJoints = 1900;
  const std::string blanks(urdf_size(num_bytes) / kJoints, ' ');
  std::string text = "<robot><link name='l0'/>";
  for (std::size_t i = 1; i <= kJoints; ++i) {
    const std::string n = std::to_string(i), before = std::to_string(i - 1);
    text += "<link name='l" + n + "'/><joint name='j" + n +
            "' type='continuous'><parent link='l0'/><child link='l" + n + "'/>";
    if (i > 1) {
      text += "<mimic joint='j" + before + "' multiplier='" + blanks + "1'/>";
    }
    text += "</joint>";
  }
  write_pieces(path, 0, text + "</robot>", nullptr);
}

/// One mesh of long comments, named again and again.
void meshes_urdf(const fs::path& path, std::size_t num_bytes) {
  fs::create_directories(path);
  write_pieces(path / "a.obj", num_bytes / 2, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
               [](std::size_t) { return "#\n"; });
  write_pieces(
      path / "robot.urdf", urdf_size(num_bytes / 2), "<robot><link name='a'>",
      [](std::size_t i) {
        return "<collision><geometry><mesh filename='" + std::string(i % 2 == 0 ? "./" : "") +
               "a.obj'/></geometry></collision>";
      },
      "</link></robot>");
}

/// Frames in one robot, as many as a rig has room for.
void frames_toml(const fs::path& path, std::size_t num_bytes) {
  fs::create_directories(path);
  elements_urdf(path / "a.urdf",
                std::min<std::size_t>(num_bytes, 60'000'000));  // the limit: 64 MiB
  write_pieces(path / "rig.toml", std::min<std::size_t>(num_bytes / 16, 65'000),
               "camera = [{uri = 'scene:wall'}]\n[frames]\n", [](std::size_t i) {
                 return "f" + std::to_string(i) + " = 'urdf:" + (i % 2 == 0 ? "./" : "") +
                        "a.urdf#a'\n";
               });
}

void keys_json(const fs::path& path, std::size_t num_bytes) {
  write_pieces(
      path, num_bytes, "{", [](std::size_t i) { return "\"" + std::to_string(i) + "\":1,"; },
      "\"format\":1}");
}
void lists_json(const fs::path& path, std::size_t num_bytes) {
  write_pieces(
      path, num_bytes, R"({"format":[0)", [](std::size_t) { return ",[]"; }, "]}");
}
void toml(const fs::path& path, std::size_t num_bytes) {
  write_pieces(path, num_bytes, "",
               [](std::size_t i) { return "[a" + std::to_string(i) + "]\nb = 1\n"; });
}
/// As large as is read, of tables in tables.
void deep_toml(const fs::path& path, std::size_t) {
  std::string keys = "a";
  while (keys.size() < 990) keys += ".a";
  write_pieces(path, 65'000, "", [&](std::size_t i) {
    return "[t" + std::to_string(i) + "." + keys.substr(0, 900) + "]\n";
  });
}

Status read_poses(const fs::path& path) { return status_of(load_trajectory(path)); }
Status read_list(const fs::path& path) {
  return status_of(open_depth_folder(path, {{8, 8, 3.5, 3.5}}));
}
Status read_flow(const fs::path& path) {
  return status_of(open_depth_folder(path, {{8, 8, 3.5, 3.5}, 0.001, 30, path / "flow"}));
}
Status read_joints(const fs::path& path) {
  JointHistory history({{"elbow", false}, {"shoulder", true}});
  return read_joint_table(file_bytes(path), "joints", history);
}
Status read_robot(const fs::path& path) {
  return status_of(parse_urdf(file_bytes(path), "robot.urdf", {}, RobotGeometry::collision));
}
Status read_robot_folder(const fs::path& path) {
  return status_of(parse_urdf(file_bytes(path / "robot.urdf"), "robot.urdf", {path, {}},
                              RobotGeometry::collision));
}

/// The text as that of settings in a recording: it is the last of its message's members.
Status read_settings_text(const fs::path& path) {
  RunSetup setup;
  setup.streams.resize(1);
  std::string message = settings_message(setup);
  const std::size_t begin = message.find("{\"format\"");
  message.resize(begin);
  const std::string text = file_bytes(path);
  const auto size = static_cast<std::uint32_t>(text.size() + 1);
  message.replace(begin - 4, 4, reinterpret_cast<const char*>(&size), 4);
  return status_of(read_settings(message + text + '\0'));
}
Status read_toml_file(const fs::path& path) { return status_of(load_settings<RunSettings>(path)); }
Status read_rig(const fs::path& path) { return status_of(load_rig(path)); }
Status read_rig_folder(const fs::path& path) { return read_rig(path / "rig.toml"); }

}  // namespace

std::vector<LargeInput> large_texts() {
  return {{"TUM", "poses", true, poses_txt, read_poses, ".txt"},
          {"depth.txt", "one image again and again", true, list_txt, read_list, ""},
          {"depth.txt", "no optical flow of its images", false, flowless_txt, read_flow, ""},
          {"joints", "rows", true, joints_csv, read_joints, ".csv"},
          {"joints", "columns", true, columns_csv, read_joints, ".csv"},
          {"URDF", "elements", true, elements_urdf, read_robot, ".urdf"},
          {"URDF", "attributes", {}, attributes_urdf, read_robot, ".urdf"},
          {"URDF", "joints that follow each other", true, followers_urdf, read_robot, ".urdf"},
          {"URDF", "one mesh again and again", true, meshes_urdf, read_robot_folder, ""},
          {"settings", "keys in a recording", false, keys_json, read_settings_text, ".json"},
          {"settings", "lists in a recording", false, lists_json, read_settings_text, ".json"},
          {"settings", "TOML", false, toml, read_toml_file, ".toml"},
          {"settings", "TOML of 64 KiB of nested keys", false, deep_toml, read_toml_file, ".toml"},
          {"rig", "TOML", false, toml, read_rig, ".toml"},
          {"rig", "frames in one robot", true, frames_toml, read_rig_folder, ""}};
}

}  // namespace palpate::fuzz
