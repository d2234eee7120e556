// Paths of poses, single poses, and lists of depth frames.
#include "palpate/io/files.h"
#include "palpate/io/formats.h"
#include "tests/fuzz/target.h"

namespace palpate::fuzz {

std::vector<std::string> seeds() {
  return {"# t tx ty tz qx qy qz qw\n0 0 0 0.5 0 0 0 1\n1e-3 -1 2.5 .3 0.5 0.5 0.5 0.5 # end\n",
          "1305031102.1 1 2 3 1 0 0 0\r\n\r\n1305031102.2\t1 2 3 0 0 0 1", "0 0 0 1 0 0 0 1"};
}

}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  using namespace palpate::fuzz;
  static ScratchFile file(".txt"), again(".again.txt");
  const std::string_view text = text_of(data, size);
  (void)parse_pose(text);
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
