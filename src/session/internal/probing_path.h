// A tool path for humans who have a scene but no path.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/core/core.h"
#include "palpate/io/files.h"
#include "palpate/session/run.h"
#include "palpate/tool/tool.h"

namespace palpate { inline namespace v0 {

/// Opens the same stream once more, from its first frame.
using OpenDepthSource = std::function<Result<std::unique_ptr<DepthSource>>()>;

struct ProbingPath {
  std::vector<TimedPose> poses;
  ProbeChoice choice;
};

/// Options of `palpate touch` that set the target: help for runs without a path.
inline constexpr const char* kHowToAim =
    "aim with --probe u,v (a pixel of the depth image) or --probe x,y,z (a point, m, in camera "
    "axes); choose the end that leads with --tip x,y,z (a point of the tool, m, in the frame of "
    "its mesh)";

/// Largest speed of any point of the tool and of its frame's origin on a probing path, m/s.
inline constexpr double kProbeSpeed = 0.15;
/// Largest angular speed of the tool, rad/s.
inline constexpr double kProbeTurnRate = 1;

/// Touches one place of what a depth stream shows, as a person would: along the viewing ray out of
/// free space, in until about a tenth of the tool is behind the surface, a slide to the side with a
/// slow turn, and out again. The tool is held like a pen: its thinnest end, or `aim.tip_T`, points
/// into the scene, the rest leans to the upper right.
///
/// The place to touch is, of those seen well (measured, even and calm over time), the one nearest
/// to camera and image center: the one with the least depth times 1 + its distance from the image
/// center in quarters of the image's width; badly seen places count as farther. `aim` may choose
/// another one.
///
/// The path is tried in every frame: it starts and ends where the whole tool is clear of
/// everything, and presses less where other parts of the tool would be in as well. Where the
/// surface moves faster than kProbeSpeed allows, the tool lifts in time and waits until it could
/// follow again.
///
/// Reads the stream twice, up to `duration` seconds (nullopt: to its end, which is then the end of
/// the path; if that comes too early to touch anything, the last frame stays for kShortestProbe in
/// all). Errors: no usable surface near the image center, or where `aim` says; an `aim` outside the
/// image or off the tool; images that no SurfaceEstimator takes; duration not > 0, or none for an
/// endless stream; what the stream reports.
Result<ProbingPath> probing_path(const OpenDepthSource& open, const Tool& tool,
                                 std::optional<double> duration, const ProbeAim& aim = {});
/// Shortest probing path, s.
inline constexpr double kShortestProbe = 3;

}}  // namespace palpate::v0
