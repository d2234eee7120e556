#include "apps/output_files.h"

#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <string_view>

#include "apps/options.h"
#include "apps/sensor_choice.h"
#include "palpate/cameras/cameras.h"

namespace palpate::apps {
namespace {

/// Resolves a name, which need not exist, to an absolute path. Follows links, except those that
/// lead nowhere or in a circle.
std::filesystem::path resolved(const std::filesystem::path& path) {
  std::error_code error;
  const std::filesystem::path absolute = std::filesystem::absolute(path, error);
  const std::filesystem::path target = std::filesystem::weakly_canonical(absolute, error);
  return error ? absolute.lexically_normal() : target;
}

const char* name_of_kind(OutputKind kind) {
  switch (kind) {
    case OutputKind::tool: return "tool file";
    case OutputKind::robot: return "packed robot";
    case OutputKind::mesh: return "mesh of this format";
    case OutputKind::table: return "table of spheres or edges";
    case OutputKind::page: return "HTML page";
    case OutputKind::stamp: return "note of a packing";
    case OutputKind::recording: return "recording (MCAP)";
    case OutputKind::rig: return "rig file";
    case OutputKind::sensor: return "sensor file";
  }
  return "";
}

/// True for "v", "o" or another word that begins a line of an OBJ file.
bool is_obj(std::string_view text) {
  static constexpr std::string_view kWords[] = {"v", "vn",     "vt",     "f", "o",
                                                "g", "mtllib", "usemtl", "s"};
  while (!text.empty()) {
    const std::string_view line = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(text.size(), line.size() + 1));
    const std::string_view word = line.substr(0, line.find_first_of(" \t\r"));
    if (word.empty() || word.starts_with('#')) continue;
    return std::ranges::find(kWords, word) != std::end(kWords);
  }
  return false;
}

/// True for STL: text, or a header of 80 bytes, the number of triangles and 50 bytes for each.
bool is_stl(std::string_view begin, std::uintmax_t size) {
  std::uint32_t num = 0;
  if (begin.starts_with("solid")) return true;
  if (begin.size() < 84) return false;
  std::memcpy(&num, begin.data() + 80, sizeof num);
  return size == 84 + 50 * std::uintmax_t{num};
}

bool is_page(std::string_view begin) {
  constexpr std::string_view kBegin = "<!doctype html";
  begin.remove_prefix(std::min(begin.size(), begin.find_first_not_of(" \t\r\n")));
  return std::ranges::equal(begin.substr(0, kBegin.size()), kBegin, {},
                            [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
}

/// True if the file has this kind of content; an empty file counts as every kind.
bool is_of_kind(const std::filesystem::path& path, OutputKind kind) {
  char bytes[4096];
  std::ifstream file(path, std::ios::binary);
  file.read(bytes, sizeof bytes);
  if (!file.is_open() || file.bad()) return false;
  const std::string_view begin(bytes, static_cast<std::size_t>(file.gcount()));
  const std::filesystem::path extension = path.extension();
  std::error_code ignored;
  if (begin.empty()) return true;
  switch (kind) {
    case OutputKind::tool: return begin.starts_with("\x89PALP\r\n\x1a");
    case OutputKind::robot: return begin.starts_with("\x89PALPROBOT\r\n");
    case OutputKind::mesh:
      return extension == ".ply"   ? begin.starts_with("ply")
             : extension == ".glb" ? begin.starts_with("glTF")
             : extension == ".obj" ? is_obj(begin)
                                   : is_stl(begin, std::filesystem::file_size(path, ignored));
    case OutputKind::table: return begin.starts_with("x,y,z,r\n") || begin.starts_with("a,b\n");
    case OutputKind::page: return is_page(begin);
    case OutputKind::stamp:
      return begin.starts_with('{') && begin.find("\"palpate\"") != std::string_view::npos;
    case OutputKind::recording: return begin.starts_with("\x89MCAP");
    case OutputKind::rig: return load_rig(path).has_value();
    case OutputKind::sensor: return load_sensor(path).has_value();
  }
  return false;
}

}  // namespace

bool is_same_file(const std::filesystem::path& a, const std::filesystem::path& b) {
  std::error_code ignored;
  return std::filesystem::equivalent(a, b, ignored) || resolved(a) == resolved(b);
}

Status check_output_file(const std::filesystem::path& path, OutputKind kind,
                         const std::filesystem::path& input) {
  const auto refuse = [&path](const std::string& why) {
    return Error{Errc::io_failure, "cannot write " + path.string() + ": " + why};
  };
  std::error_code ignored;
  const std::filesystem::path target = resolved(path);
  const auto folder = target.parent_path();
  if (!std::filesystem::is_directory(folder, ignored)) {
    return refuse("there is no folder " + folder.string() + "; make it first");
  }
  if (std::filesystem::is_directory(target, ignored)) {
    return refuse("it is a folder; give the name of a file");
  }
  std::error_code error;
  const auto type = std::filesystem::status(target, error).type();
  if (type == std::filesystem::file_type::none) {
    return refuse(error.message() + "; give another name");
  }
  if (type != std::filesystem::file_type::not_found &&
      type != std::filesystem::file_type::regular) {
    return refuse("it is not a regular file; give the name of a new file");
  }
  if (::access(folder.c_str(), W_OK | X_OK) != 0) {
    return refuse(std::string("its folder: ") + std::strerror(errno) + "; choose another one");
  }
  if (!input.empty() && is_same_file(path, input)) {
    return refuse("it is the input " + input.string() + "; give another name");
  }
  if (type == std::filesystem::file_type::regular && !is_of_kind(target, kind)) {
    return refuse(std::string("it is there and is no ") + name_of_kind(kind) +
                  "; give another name, or remove it");
  }
  return Done{};
}

void check_mesh_name(const std::string& flag, const std::filesystem::path& path) {
  const auto extension = path.extension();
  if (extension != ".ply" && extension != ".stl" && extension != ".obj") {
    usage_error(flag + ": '" + path.string() + "' must end in .ply, .stl or .obj");
  }
}

}  // namespace palpate::apps
