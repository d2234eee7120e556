#include <fstream>
#include <string>
#include <thread>

#include "eval/report/store.h"
#include "palpate/core/core.h"
#include "palpate/gpu/devices.h"
#include "src/io/internal/atomic_file.h"
#include "src/io/internal/hashes.h"

namespace palpate::eval {
namespace {

std::string processor_name() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    const std::size_t colon = line.find(": ");
    if (line.starts_with("model name") && colon != std::string::npos) {
      return line.substr(colon + 2);
    }
  }
  return "unnamed processor";
}

/// Returns the checksum of a file's content; empty if there is no such file.
std::string checksum_of(const std::filesystem::path& path) {
  if (path.empty()) return "";
  const auto content = read_file(path);
  return content ? sha256(*content) : "";
}

}  // namespace

Key key_of(const Settings& settings) {
  Key key;
  key.program = checksum_of("/proc/self/exe");
  key.form = settings.quick ? "quick" : "full";
  key.data = std::filesystem::is_directory(settings.data) ? "present" : "absent";
  std::string of_gpu;
  for (const auto& path : settings.gpu) of_gpu += checksum_of(path);
  key.gpu = of_gpu.empty() ? "" : sha256(of_gpu);
  key.peers = checksum_of(settings.peers);
  key.processor = processor_name();
  key.num_cores = static_cast<int>(std::thread::hardware_concurrency());
  key.isa = isa_name(best_isa());
  if (settings.backend == Backend::cuda) {
    const auto gpus = find_gpus();
    key.isa = "queries on " + (gpus ? gpus->front().name : std::string("no GPU"));
  }
  return key;
}

}  // namespace palpate::eval
