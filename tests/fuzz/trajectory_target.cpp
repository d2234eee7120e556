// Paths of poses, single poses, and lists of depth frames.
#include <limits>

#include "palpate/io/files.h"
#include "palpate/io/formats.h"
#include "tests/fuzz/target.h"

namespace palpate::fuzz {

std::vector<std::string> seeds() {
  return {"# t tx ty tz qx qy qz qw\n0 0 0 0.5 0 0 0 1\n1e-3 -1 2.5 .3 0.5 0.5 0.5 0.5 # end\n",
          "1305031102.1 1 2 3 1 0 0 0\r\n\r\n1305031102.2\t1 2 3 0 0 0 1", "0 0 0 1 0 0 0 1",
          "# timestamp filename\n0.1 depth/a.png\n0.2 b.png\n1e3\ta.png\n"};
}

namespace {

/// A folder with two small images, whose list is what the input says.
class Frames {
 public:
  Frames() {
    std::filesystem::create_directories(path_ / "depth");
    const DepthFrame frame{8, 8, 0.001, std::vector<std::uint16_t>(64, 700), 0};
    for (const char* name : {"a.png", "b.png", "depth/a.png"}) {
      require(save_depth_png(frame, path_ / name).has_value(), "an image can be written");
    }
  }
  ~Frames() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }

  void read(std::string_view list) {
    std::FILE* const file = std::fopen((path_ / "depth.txt").c_str(), "wb");
    std::fwrite(list.data(), 1, list.size(), file);
    std::fclose(file);
    const auto source = open_depth_folder(path_, {{8, 8, 3.5, 3.5}});
    if (!source) return;
    DepthFrame frame;
    double last = -std::numeric_limits<double>::infinity();
    while (true) {
      const auto got = (*source)->next(frame);
      if (!got || !*got) return;
      require(frame.timestamp > last, "frames come in the order of time");
      last = frame.timestamp;
    }
  }

 private:
  const std::filesystem::path path_ = [] {
    static ScratchFile name(".frames");
    return name.path();
  }();
};

}  // namespace

}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  using namespace palpate::fuzz;
  static ScratchFile file(".txt"), again(".again.txt");
  const std::string_view text = text_of(data, size);
  static Frames frames;
  (void)parse_pose(text);
  frames.read(text);
  const auto path = load_trajectory(file.write(text));
  if (!path) return 0;
  (void)pose_at(*path, path->front().time + 0.5);
  require(save_trajectory(*path, again.path()).has_value(), "a path that was read can be written");
  const auto back = load_trajectory(again.path());
  require(back && back->size() == path->size(), "a path comes back with all its poses");
  for (std::size_t i = 0; i < path->size(); ++i) {
    require((*back)[i].time == (*path)[i].time &&
                (*back)[i].X_WT.translation == (*path)[i].X_WT.translation,
            "times and places come back to the bit");
  }
  return 0;
}
