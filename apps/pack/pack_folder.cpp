#include "apps/pack/pack_folder.h"

#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>

#include "apps/options.h"
#include "apps/output_files.h"
#include "apps/terminal/terminal.h"
#include "apps/tool_info.h"
#include "palpate/io/files.h"
#include "palpate/version.h"
#include "src/core/internal/guarded.h"
#include "src/io/internal/atomic_file.h"
#include "src/io/internal/file_names.h"
#include "src/io/internal/hashes.h"

namespace palpate::apps {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// True if load_mesh reads this kind of file.
bool is_mesh_name(const fs::path& path) {
  static constexpr std::string_view kKnown[] = {".obj", ".stl", ".ply", ".off", ".gltf", ".glb"};
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return std::find(std::begin(kKnown), std::end(kKnown), extension) != std::end(kKnown);
}

/// Lists the meshes of a folder by name; skips hidden files.
Result<std::vector<fs::path>> list_meshes(const fs::path& folder) {
  std::vector<fs::path> meshes;
  std::error_code failed;
  for (fs::directory_iterator entry(folder, failed), end; !failed && entry != end;
       entry.increment(failed)) {
    const fs::path& path = entry->path();
    std::error_code ignored;
    if (is_mesh_name(path) && !is_hidden(path) && fs::is_regular_file(path, ignored)) {
      meshes.push_back(path);
    }
  }
  if (failed) {
    return Error{Errc::io_failure, "cannot list " + folder.string() + ": " + failed.message() +
                                       "; check that you may read it"};
  }
  if (meshes.empty()) {
    return Error{Errc::not_found, "there is no mesh in " + folder.string() +
                                      " (.obj, .stl, .ply, .off, .gltf, .glb); subfolders are not "
                                      "searched, so pass the folder with the meshes"};
  }
  std::sort(meshes.begin(), meshes.end());
  return meshes;
}

/// Creates the folder of tools if it does not exist, and checks that it is writable.
Status prepare(const fs::path& folder) {
  std::error_code failed;
  fs::create_directory(folder, failed);
  if (!failed && fs::is_directory(folder) && ::access(folder.c_str(), W_OK | X_OK) == 0) {
    return Done{};
  }
  const std::string why = failed                     ? failed.message()
                          : fs::is_directory(folder) ? std::strerror(EACCES)
                                                     : std::strerror(ENOTDIR);
  return Error{Errc::io_failure,
               "cannot write tools into " + folder.string() + ": " + why + "; give another folder"};
}

template <class Element>
std::string checksum_of(const std::vector<Element>& elements) {
  return sha256(
      {reinterpret_cast<const char*>(elements.data()), elements.size() * sizeof(Element)});
}

/// The output files of one mesh.
struct Outputs {
  fs::path tool, page, stamp;

  Outputs(const fs::path& folder, const fs::path& mesh)
      : tool(folder / mesh.stem().concat(".palp")),
        page(folder / mesh.stem().concat(".html")),
        stamp(folder / mesh.stem().concat(".pack.json")) {}
};

/// Version of the packing: counts changes of the result for the same mesh and options.
constexpr int kPackingVersion = 3;

/// Returns a text about inputs and outputs of a tool: if it is equal, packing again would give the
/// same files. None if a file does not exist.
std::optional<std::string> stamp_text(const TriangleMesh& raw, const std::string& source,
                                      const PackRequest& request, const Outputs& outputs,
                                      bool with_page) {
  const PackOptions& pack = request.pack;
  Json options{{"seed", pack.seed},
               {"gap_rule", name_of(request.gap_rule)},
               {"as_many_as_needed", request.as_many_as_needed}};
  for (const Setting& setting : settings_of(pack)) {
    options[std::string(setting.name)] = std::get<double>(setting.get());
  }
  Json stamp{{"palpate", PALPATE_VERSION},
             {"packing", kPackingVersion},
             {"source", source},
             {"mesh", checksum_of(raw.vertices) + checksum_of(raw.triangles)},
             {"options", options}};
  const auto tool = read_file(outputs.tool);
  if (!tool) return std::nullopt;
  stamp["tool"] = sha256(*tool);
  if (with_page) {
    const auto page = read_file(outputs.page);
    if (!page) return std::nullopt;
    stamp["page"] = sha256(*page);
  }
  return stamp.dump(2) + "\n";
}

bool is_up_to_date(const TriangleMesh& raw, const std::string& source, const FolderJob& job,
                   const Outputs& outputs) {
  const auto found = read_file(outputs.stamp, 1 << 16);
  if (!found) return false;
  const auto agrees = [&](bool with_page) {
    return stamp_text(raw, source, job.request, outputs, with_page) == *found;
  };
  return agrees(true) || (!job.pages && agrees(false));
}

/// Progress, printed as it happens and, with --json, in one document at the end.
class Log {
 public:
  explicit Log(bool json) : json_(json) {}

  void packed(const fs::path& mesh, const Outputs& outputs, const PackedTool& packed, bool page) {
    const std::size_t num_spheres = packed.tool.spheres().size();
    const double fill = packed.tool.sphere_mass().volume / packed.tool.mesh_mass().volume;
    Json entry{{"mesh", mesh.string()},           {"tool", outputs.tool.string()},
               {"spheres", num_spheres},          {"fill", fill},
               {"stopped", packed.notes.stopped}, {"seconds", packed.seconds}};
    const Json info = tool_info(packed.tool, packed.standoff);
    for (const char* key : {"standoff", "warnings"}) entry[key] = info[key];
    if (page) entry["report"] = outputs.page.string();
    packed_.push_back(entry);
    char text[96];
    std::snprintf(text, sizeof text, "%zu spheres, fill %.2f %%, %.2f s", num_spheres, 100 * fill,
                  packed.seconds);
    say("packed      ", outputs.tool.string() + ": " + text);
  }
  void skipped(const fs::path& mesh, const Outputs& outputs) {
    skipped_.push_back({{"mesh", mesh.string()}, {"tool", outputs.tool.string()}});
    say("up to date  ", outputs.tool.string());
  }
  void failed(const fs::path& mesh, const std::string& reason) {
    failed_.push_back({{"mesh", mesh.string()}, {"reason", reason}});
  }

  std::size_t num_failed() const { return failed_.size(); }
  std::size_t num_done() const { return packed_.size() + skipped_.size() + failed_.size(); }

  void finish(bool was_interrupted) const {
    if (json_) {
      print_json({{"packed", packed_},
                  {"skipped", skipped_},
                  {"failed", failed_},
                  {"interrupted", was_interrupted}});
      return;
    }
    for (const Json& entry : failed_) {
      say("failed      ", entry["reason"].get<std::string>());
    }
  }

 private:
  void say(const char* what, const std::string& words) const {
    if (!json_) results() << what << words << std::endl;
  }

  bool json_;
  Json packed_ = Json::array(), skipped_ = Json::array(), failed_ = Json::array();
};

/// Packs one mesh unless its tool is up to date.
Status process(const fs::path& mesh, const FolderJob& job, const std::string& title, Log& log) {
  const Outputs outputs(job.tools, mesh);
  const std::string source = mesh.filename().string();
  const std::pair<const fs::path&, OutputKind> all[] = {{outputs.tool, OutputKind::tool},
                                                        {outputs.stamp, OutputKind::stamp},
                                                        {outputs.page, OutputKind::page}};
  for (const auto& [output, kind] : all) {
    if (kind == OutputKind::page && !job.pages) continue;
    if (const Status status = check_output_file(output, kind, mesh); !status) return status;
  }
  const auto raw = load_mesh_for(job.request, mesh.string());
  if (!raw) return raw.error();
  if (is_up_to_date(*raw, source, job, outputs)) {
    log.skipped(mesh, outputs);
    return Done{};
  }
  const auto packed = pack_one(*raw, mesh.string(), job.request, title);
  if (!packed) return packed.error();
  // The stamp comes last: a tool without its own one is packed again.
  if (const Status status = save_tool(packed->tool, outputs.tool); !status) return status;
  if (job.pages) {
    if (const Status status = write_page(*packed, outputs.page.string()); !status) return status;
  }
  const auto stamp = stamp_text(*raw, source, job.request, outputs, job.pages);
  if (stamp) {
    if (const Status status = write_file_atomically(outputs.stamp, *stamp); !status) return status;
  }
  log.packed(mesh, outputs, *packed, job.pages);
  return Done{};
}

}  // namespace

Status pack_folder(const FolderJob& job) {
  const auto meshes = list_meshes(job.meshes);
  if (!meshes) return meshes.error();
  if (const Status status = prepare(job.tools); !status) return status;
  catch_interrupts();
  Log log(job.json);
  std::map<std::string, fs::path> taken;  // stems and the meshes that have them
  for (std::size_t i = 0; i < meshes->size() && !interrupted(); ++i) {
    const fs::path& mesh = (*meshes)[i];
    const std::string file = mesh.filename().string();
    const auto [first, is_new] = taken.emplace(mesh.stem().string(), mesh.filename());
    if (!is_new) {
      log.failed(mesh, mesh.string() + ": " + first->second.string() + " already makes " +
                           first->first + ".palp; rename one of them");
      continue;
    }
    const std::string title =
        "packing " + std::to_string(i + 1) + " of " + std::to_string(meshes->size()) + ", " + file;
    Status status = Done{};
    guarded([&] { status = process(mesh, job, title, log); },
            [&](const Error& error) {
              status = Error{error.code, mesh.string() + ": " + error.message};
            });
    if (!status && status.error().code != Errc::cancelled) {
      log.failed(mesh, status.error().message);
    }
  }
  const bool cut_short = log.num_done() < meshes->size();
  log.finish(cut_short);
  const std::string of_all = " of " + std::to_string(meshes->size()) + " meshes";
  if (cut_short) {
    return Error{Errc::cancelled, "interrupted after " + std::to_string(log.num_done()) + of_all +
                                      "; run it again to do the rest"};
  }
  if (log.num_failed() > 0) {
    return Error{Errc::bad_input, std::to_string(log.num_failed()) + of_all +
                                      " could not be packed; the list above says why"};
  }
  return Done{};
}

}  // namespace palpate::apps
