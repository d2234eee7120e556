// The thesis' realistic setup: a hand-held tool on a recorded scene.
#pragma once

#include <memory>
#include <string>

#include "eval/context.h"
#include "eval/studies/frozen_frame.h"
#include "eval/studies/hand_paths.h"
#include "eval/studies/method_queries.h"

namespace palpate::eval {

/// One frame to interact with, its tool, and the motion of the hand.
struct Interaction {
  std::string name;  ///< for captions: scene and tool
  FirstFrame picture;
  FrozenFrame frame;  ///< queries on the picture
  std::string shape;  ///< for Context::tool
  double size = 0;    ///< m
  HandMotion motion = figure_of_eight;
  double farthest = std::numeric_limits<double>::infinity();  ///< m: ignores the background
};

/// Returns a table recorded by a Kinect, touched with the bunny; without the data
/// simulated_interaction().
Result<Interaction> recorded_interaction(Context& context);
/// Returns a person recorded by a Kinect, touched with the bunny by a recorded hand; without the
/// data simulated_interaction().
Result<Interaction> hand_interaction(Context& context);
/// Returns a simulated mannequin with Kinect noise, touched with a torus. Needs no data.
Result<Interaction> simulated_interaction(Context& context);

/// Renders the first frame of a simulated scene: with the noise of a Kinect in millimeters, or
/// exact to 0.1 mm.
Result<FirstFrame> picture_of(Context& context, const scenes::Scene& scene, bool with_noise);
/// Renders it and prepares it for queries.
Result<FrozenFrame> seen_scene(Context& context, const scenes::Scene& scene, bool with_noise);

/// Makes the queries of a tool on a frame.
std::unique_ptr<MethodQueries> query_on(const FrozenFrame& frame, const Tool& tool,
                                        Backend backend = Backend::cpu);

/// Times single queries along a path.
Times time_queries(MethodQueries& query, const ContactOptions& options,
                   const std::vector<Pose>& path);

}  // namespace palpate::eval
