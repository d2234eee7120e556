// Context of every figure: settings, data, tools and progress.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/contact/contact.h"
#include "palpate/tool/tool.h"
#include "scenes/scene.h"

namespace palpate::eval {

struct Settings {
  bool quick = false;                      ///< two minutes in all instead of forty-five
  int num_threads = 0;                     ///< 0: one per core; times are always measured on one
  std::filesystem::path data;              ///< real frames; may be absent
  std::vector<std::filesystem::path> gpu;  ///< CSV of scripts/gpu_check.sh, oldest first
  std::filesystem::path peers;             ///< CSV of the peer benchmark; may be empty
  Backend backend = Backend::cpu;          ///< backend of the figures that time queries
};

/// A method with its options, its name and its color.
struct Method {
  const char* name;  ///< weighted, simplified, graph, graph-cap, field: also Curve::style
  ContactOptions options;
};
std::vector<Method> all_methods();  ///< these five
/// The same for comparisons of exactness: all count the represented volumes of spheres.
std::vector<Method> all_methods_alike();
std::vector<Method> thesis_methods();  ///< weighted, simplified, graph

/// One depth frame of a recording.
struct FirstFrame {
  std::string name;  ///< short, for tables
  DepthStreamInfo stream;
  DepthFrame frame;
};

/// Exception of Context::progress after the caller requested a stop. Figures let it pass;
/// run_evaluation catches it.
struct Cancelled {};

class Context {
 public:
  explicit Context(Settings settings);
  ~Context();

  const Settings& settings() const { return settings_; }
  bool quick() const { return settings_.quick; }
  /// Processor that times queries: "one CPU core", "an NVIDIA H200".
  std::string place() const;
  /// Returns `full` or, in the quick form, `quick`.
  template <class T>
  T choose(T full, T quick) const {
    return settings_.quick ? quick : full;
  }

  /// Packs a tool once for all figures, and takes prefixes of it. `shape` of mesh/mesh.h or the
  /// path of a mesh, absolute or in the folder of data; its longest side becomes `size` meters. The
  /// leaf graph is that of `palpate pack` by default.
  Result<std::shared_ptr<const Tool>> tool(const std::string& shape, double size, int num_spheres,
                                           GapRule rule = GapRule::relative);
  /// The same with the thesis' own leaf graph: for claims of the thesis.
  Result<std::shared_ptr<const Tool>> thesis_tool(const std::string& shape, double size,
                                                  int num_spheres) {
    return tool(shape, size, num_spheres, GapRule::absolute);
  }

  /// Reads a real recording, one of recording_names(), or nullopt if the data are absent.
  Result<std::optional<std::vector<DepthFrame>>> recorded(const std::string& name,
                                                          DepthStreamInfo& info);
  /// Reads the first frame of each real recording that is present; sequences only if requested.
  Result<std::vector<FirstFrame>> first_frames(bool of_sequences);
  /// Renders the frames of a simulated scene.
  Result<std::vector<DepthFrame>> simulated(const scenes::Scene& scene,
                                            const scenes::SimulatedCameraOptions& camera,
                                            DepthStreamInfo& info);

  /// Reports progress within a figure, 0..1. Cheap. Throws Cancelled: call it on the thread of the
  /// figure, a few times a second.
  void progress(double share);
  std::function<void(double)> on_progress;
  std::function<bool()> keep_going;  ///< false: stop; empty: never

 private:
  Settings settings_;
  struct Cache;
  std::unique_ptr<Cache> cache_;
};

/// Real recordings whose intrinsics are known: "sequences/visp_rbt", "frames/pcl_person.png", ...
std::vector<std::string> recording_names();

/// Times of single calls on this thread, as all benchmarks here report them.
struct Times {
  double median = 0, p99 = 0, max = 0, mean = 0, deviation = 0;  ///< s
  std::size_t num = 0;
};
/// Calls `once(i)` for i = 0 ... num - 1, after a warm-up, and times each.
Times time_calls(std::size_t num, const std::function<void(std::size_t)>& once);

}  // namespace palpate::eval
