// The thesis' realistic set-up: a hand-held tool on something that a depth camera recorded.
#pragma once

#include <memory>
#include <string>

#include "eval/context.h"
#include "eval/studies/frozen_frame.h"
#include "eval/studies/hand_paths.h"
#include "eval/studies/method_queries.h"

namespace palpate::eval {

/// One frame to interact with, the tool that goes with it, and how a hand moves it.
struct Interaction {
  std::string name;  ///< for captions: what is touched, with what
  FirstFrame picture;
  FrozenFrame frame;  ///< what is made of it
  std::string shape;  ///< for Context::tool
  double size = 0;    ///< m
  HandMotion motion = figure_of_eight;
  double farthest = std::numeric_limits<double>::infinity();  ///< m: what is meant is nearer
};

/// A table that a Kinect recorded, touched with the bunny, if the data are there; else what
/// simulated_interaction gives.
Result<Interaction> recorded_interaction(Context& context);
/// A person that a Kinect recorded, touched with the bunny by a recorded hand, if the data are
/// there; else what simulated_interaction gives.
Result<Interaction> hand_interaction(Context& context);
/// A simulated mannequin with Kinect noise, touched with a torus. Needs no data.
Result<Interaction> simulated_interaction(Context& context);

/// The first frame of a simulated scene: with the noise of a Kinect in millimetres, or exact to 0.1
/// mm.
Result<FirstFrame> picture_of(Context& context, const scenes::Scene& scene, bool with_noise);
/// What is made of it.
Result<FrozenFrame> seen_scene(Context& context, const scenes::Scene& scene, bool with_noise);

/// A query of a method on a tool that looks at a frame.
std::unique_ptr<MethodQueries> query_on(const FrozenFrame& frame, const Tool& tool,
                                        Backend backend = Backend::cpu);

/// Times of single queries along a path.
Times time_queries(MethodQueries& query, const ContactOptions& options,
                   const std::vector<Pose>& path);

}  // namespace palpate::eval
