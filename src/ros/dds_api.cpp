#include "src/ros/internal/dds_api.h"

#include <dlfcn.h>

#include <filesystem>
#include <system_error>
#include <vector>

#include "src/core/internal/shared_library.h"

namespace palpate { inline namespace v0 { namespace dds {
namespace {

/// libddsc.so of a build by its makers, of Debian and Ubuntu, of distributions of ROS 2.
std::vector<std::string> candidates() {
  std::vector<std::string> files;
  if (const std::string given = environment("PALPATE_DDSC"); !given.empty()) return {given};
  for (const char* name : {"libddsc.so", "libddsc.so.11", "libddsc.so.0", "libddsc.so.0debian"}) {
    files.emplace_back(name);
  }
  for (const char* folder : {"/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu"}) {
    for (std::string& file : library_files(folder, "libddsc.so.")) {
      if (!file.ends_with(".so.")) files.push_back(std::move(file));
    }
  }
  const std::string distribution = environment("ROS_DISTRO");
  for (const std::string& name : {distribution, std::string("lyrical"), std::string("kilted"),
                                  std::string("jazzy"), std::string("humble")}) {
    if (name.empty() || name.find('/') != std::string::npos) continue;
    for (const char* folder : {"/lib/", "/lib/x86_64-linux-gnu/", "/lib/aarch64-linux-gnu/"}) {
      files.push_back("/opt/ros/" + name + folder + "libddsc.so");
    }
  }
  return files;
}

/// The file that a function was loaded from, which the loader may have found by a shorter name.
std::string file_of(const void* function, const std::string& name) {
  Dl_info info;
  if (dladdr(function, &info) == 0 || info.dli_fname == nullptr) return name;
  std::error_code error;
  const auto file = std::filesystem::canonical(info.dli_fname, error);
  return error ? name : file.string();
}

Result<Api> load() {
  auto library = SharedLibrary::open(candidates());
  if (!library) {
    return Error{Errc::unavailable, "Cyclone DDS is not there: " + library.error().message +
                                        "; install libddsc0debian (Debian) or cyclonedds, or name "
                                        "its libddsc.so in PALPATE_DDSC"};
  }
  Api api{};
  library->require("dds_strretcode", api.error_text);
  library->require("dds_create_domain", api.create_domain);
  library->require("dds_create_participant", api.create_participant);
  library->require("dds_create_topic", api.create_topic);
  library->require("dds_create_writer", api.create_writer);
  library->require("dds_create_reader", api.create_reader);
  library->require("dds_delete", api.remove);
  library->require("dds_write", api.write);
  library->require("dds_take", api.take);
  library->require("dds_read", api.read);
  library->require("dds_return_loan", api.return_loan);
  library->require("dds_create_waitset", api.create_waitset);
  library->require("dds_waitset_attach", api.attach);
  library->require("dds_waitset_wait", api.wait);
  library->require("dds_create_readcondition", api.create_read_condition);
  library->require("dds_create_guardcondition", api.create_guard_condition);
  library->require("dds_set_guardcondition", api.set_guard_condition);
  library->require("dds_get_guid", api.get_guid);
  library->require("dds_get_matched_publications", api.matched_writers);
  library->require("dds_get_matched_subscriptions", api.matched_readers);
  library->require("dds_create_qos", api.create_qos);
  library->require("dds_delete_qos", api.delete_qos);
  library->require("dds_qset_reliability", api.set_reliability);
  library->require("dds_qset_durability", api.set_durability);
  library->require("dds_qset_history", api.set_history);
  library->require("dds_qset_userdata", api.set_user_data);
  library->require("dds_qset_data_representation", api.set_representation);
  if (const auto status = library->check("; install Cyclone DDS 0.10 or newer"); !status)
    return status.error();
  api.path = file_of(reinterpret_cast<const void*>(api.create_participant), library->path());
  api.version = version_of_file(api.path);
  return api;
}

}  // namespace

const Result<Api>& api() {
  static const Result<Api>& loaded = *new Result<Api>(load());
  return loaded;
}

}}}  // namespace palpate::v0::dds
