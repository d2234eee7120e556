// palpate query: single measurements against frozen views of one or more cameras.

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/options.h"
#include "apps/output_files.h"
#include "apps/terminal/terminal.h"
#include "apps/tool_info.h"
#include "apps/touch/frames.h"
#include "apps/touch/objects.h"
#include "apps/verbs.h"
#include "apps/verbs/caps.h"
#include "apps/verbs/frozen_views.h"
#include "apps/verbs/query_results.h"
#include "palpate/contact/body_contact.h"
#include "palpate/contact/scene.h"
#include "palpate/io/files.h"
#include "src/run/internal/pipeline.h"
#include "src/run/internal/reported_output.h"
#include "src/session/internal/more_than_whole.h"
#include "src/session/internal/sphere_distance.h"

namespace palpate::apps {
namespace {

/// Number of spheres from which a tool is measured by whole clusters deep inside: 127 full ones of
/// 32 and one more.
constexpr std::size_t kManySpheres = 127 * 32 + 1;

struct ChosenQuery {
  Place place;
  std::unique_ptr<ContactQuery> query;
};

/// Creates the query on the backend of the settings, or the fastest one that works here. `pool`
/// must outlive it.
Result<ChosenQuery> choose_query(const RunSettings& settings, const Tool& tool, ThreadPool& pool) {
  const auto method = contact_method(settings.contact);
  if (!method) return method.error();
  const auto index = ToolIndex::create(tool);
  ExecutionOptions execution;
  if (settings.num_threads > 1) execution.pool = &pool;
  Place place{settings.backend.value_or(Backend::cuda), settings.contact_gpu};
  auto query = make_contact_query(place, index, *method, execution);
  if (!query && !settings.backend) {
    note_backend(query.error().message);
    query = make_contact_query(place = Place::cpu(), index, *method, execution);
  }
  if (!query) return query.error();
  return ChosenQuery{place, *std::move(query)};
}

/// Computes the unseen volume at a pose, and the number of spheres that each camera decided.
void find_evidence(const ContactQuery& query, std::span<const SurfaceBlend> cameras,
                   QueryMeasurement& at) {
  SpherePicture spheres;
  spheres.resize(query.index()->tool().spheres().size());
  ContactWants wants = spheres.wants();
  wants.unseen_volume = true;
  const Penetration seen = query.measure(cameras, at.X_WT, wants).penetration;
  at.unseen = seen.unseen_volume;
  at.decided.assign(cameras.size() + 1, 0);
  for (std::size_t i = 0; i < spheres.states.size(); ++i) {
    if (spheres.states[i] == SphereState::outside) continue;
    const std::int8_t camera = spheres.deciders[i];
    ++(camera == kNoCamera ? at.decided.back() : at.decided[static_cast<std::size_t>(camera)]);
  }
}

/// Computes the clearance at all poses, on the CPU, if it was requested.
Status find_clearance(const QueryOptions& options, const Tool& tool, const FrozenViews& views,
                      const std::vector<SceneObject>& objects,
                      std::vector<QueryMeasurement>& measurements) {
  if (!options.wants_clearance) return Done{};
  Scene scene;
  for (const SurfaceBlend& view : views.views()) scene.surfaces.push_back(view.to);
  for (const SceneObject& object : objects) scene.bodies.emplace_back(*object.shape, object.X_WB);
  const Tool* const tools[] = {&tool};
  const auto contact = SceneContact::create(tools, *contact_method(options.settings.contact),
                                            Place::cpu(), options.settings.num_threads);
  if (!contact) return contact.error();
  std::vector<Pose> poses;
  for (const QueryMeasurement& measurement : measurements) poses.push_back(measurement.X_WT);
  std::vector<double> clearance(poses.size()), gradient(6 * poses.size());
  std::vector<std::int32_t> nearest(poses.size());
  SceneAnswers answers;
  answers.clearance = clearance.data();
  answers.nearest = nearest.data();
  answers.clearance_gradient = gradient.data();
  const Status status = contact->measure(scene, {poses}, answers);
  for (std::size_t i = 0; status && i < poses.size(); ++i) {
    measurements[i].clearance = clearance[i];
    measurements[i].nearest = nearest[i];
    std::copy_n(&gradient[6 * i], 6, measurements[i].clearance_gradient.begin());
  }
  return status;
}

/// Returns how near the tool comes to what the cameras measured, at the nearest of all poses; none
/// if it touches, if nothing was measured, or for more poses and pixels than a user waits for.
std::optional<NearestPose> nearest_pose(const Tool& tool, std::span<const SurfaceBlend> views,
                                        const std::vector<QueryMeasurement>& measurements) {
  constexpr std::size_t kMaxLooks = 30'000'000;  // 100 poses in 640 x 480 pixels
  std::optional<NearestPose> nearest;
  std::size_t num_pixels = 0;
  for (const SurfaceBlend& view : views) num_pixels += view.to.cloud.size();
  if (measurements.size() * num_pixels > kMaxLooks) return nearest;
  for (std::size_t i = 0; i < measurements.size(); ++i) {
    if (measurements[i].penetration.volume > 0) return std::nullopt;
    for (const SurfaceBlend& view : views) {
      const PointCloudView& cloud = view.to.cloud;
      const Pose X_TC = inverse(measurements[i].X_WT) * view.to.X_WC;
      for (std::size_t k = 0; k < cloud.size(); ++k) {
        if (std::isnan(cloud.x[k])) continue;
        const double limit = nearest ? nearest->distance : std::numeric_limits<double>::infinity();
        const double distance = sphere_distance_below(
            tool, X_TC * to_double(Vec3f{cloud.x[k], cloud.y[k], cloud.z[k]}), limit);
        if (distance < limit) nearest = {distance, i};
      }
    }
  }
  return nearest;
}

/// Returns the named frames of the query's cameras.
Result<NamedFrames> frames_of(const FrozenViews& scene) {
  auto frames = NamedFrames::of({});
  if (!frames) return frames.error();
  for (std::size_t i = 0; i < scene.X_WC().size(); ++i) {
    const Status status = frames->add(camera_name(i), scene.X_WC()[i]);
    if (!status) return status.error();
  }
  return frames;
}

Status run(const QueryOptions& given) {
  end_at_interrupts();
  QueryOptions options = given;
  const auto tool =
      load_tool_prefix(options.tool, options.num_spheres, options.settings.num_threads);
  if (!tool) return tool.error();
  std::vector<Pose> poses = options.X_WT;
  if (!options.poses.empty()) {
    const auto trajectory = load_trajectory(options.poses);
    if (!trajectory) return trajectory.error();
    for (const TimedPose& pose : *trajectory) poses.push_back(pose.X_WT);
  }
  std::vector<std::string> inputs = options.views.depths;
  for (const std::string& file : {options.tool, options.views.cloud}) inputs.push_back(file);
  for (const std::string& input : inputs) {
    if (options.caps.file.empty() || input.empty()) continue;
    if (const Status status = check_output_file(options.caps.file, OutputKind::mesh, input);
        !status)
      return status;
  }
  ThreadPool pool(options.settings.num_threads);
  if (options.std && !options.settings.backend) options.settings.backend = Backend::cpu;
  auto chosen = choose_query(options.settings, *tool, pool);
  if (!chosen) return chosen.error();
  const auto scene = FrozenViews::read(options.views, options.settings, options.given, pool);
  if (!scene) return scene.error();

  const auto frames = frames_of(*scene);
  if (!frames) return frames.error();
  Status known = put_in_world(*frames, options.frames, options.settings);
  if (known) known = put_in_world(*frames, options.objects);
  if (!known) return known;
  const auto objects = load_objects(options.objects);
  if (!objects) return objects.error();
  if (const Pose& X_TE = options.settings.output.X_TE; !(X_TE == Pose{})) {
    for (Pose& pose : poses) pose = pose * inverse(X_TE);
  }

  BodyWorld world(options.settings.contact.bodies);
  const ContactQuery& query = *chosen->query;
  const int body = world.add_tool(*tool, std::move(chosen->query));
  world.set_wants(body, {.noise = options.std});
  for (const SceneObject& object : *objects) world.add_object(*object.shape, object.X_WB);
  if (chosen->place.backend != Backend::cpu) {
    const Status status = world.measure_pairs_by([&](const auto& a, const auto& b) {
      return make_body_pair_query(chosen->place, a, b, {.method = options.settings.contact.bodies});
    });
    if (!status) return status.error();
  }
  std::vector<QueryMeasurement> measurements;
  for (const Pose& X_WT : poses) {
    const auto start = std::chrono::steady_clock::now();
    world.set_pose(body, X_WT);
    world.measure(scene->views());
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
    const BodyMeasure& measured = world.measured(body);
    // Objects have no noise.
    measurements.push_back(
        {measured.total(), measured, {}, {}, elapsed.count(), X_WT, measured.noise, {}, -1, {}});
    if (options.settings.contact.method == MethodKind::field) {
      find_evidence(query, scene->views(), measurements.back());
    }
    if (measured.total().status.has(StepStatus::backend_failed)) return lost_backend();
  }
  const Status cleared = find_clearance(options, *tool, *scene, *objects, measurements);
  if (!cleared) return cleared.error();
  std::size_t num_caps_triangles = 0;
  if (!options.caps.file.empty()) {
    const auto written = write_caps(options.caps, *tool, query, scene->views(), poses.back());
    if (!written) return written.error();
    num_caps_triangles = *written;
  }
  const double tool_volume = full_volume(*tool, options.settings.contact);
  double largest = 0;
  for (const QueryMeasurement& measurement : measurements) {
    largest = std::max(largest, measurement.penetration.volume);
  }
  const std::string note = more_than_whole(*tool, options.settings.contact, largest);
  if (!note.empty()) print_note(note);
  if (options.std && tool->spheres().size() >= kManySpheres && largest > 0.5 * tool_volume) {
    print_note(
        "the tool lies deep inside, where the deviation of the force of more than 4000 spheres is "
        "up to four times too large; with --spheres 2000 it is not");
  }
  if (options.json) {
    print_results_json(options, options.settings, *tool, scene->X_WC().front(),
                       chosen->place.backend, scene->num_usable(), tool_volume, measurements);
  } else {
    print_results_table(options, tool_volume, measurements);
    // Other methods have no volume behind a surface either, and objects may be nearer.
    if (options.settings.contact.method == MethodKind::field && options.objects.empty()) {
      const auto nearest = nearest_pose(*tool, scene->views(), measurements);
      if (nearest) print_nearest(*nearest, measurements.size());
    }
    if (!options.caps.file.empty()) {
      results() << "written       " << options.caps.file << ", " << num_caps_triangles
                << " triangles\n";
    }
  }
  return Done{};
}

/// Checks combinations of options, which the parser cannot.
void check(const CLI::App& app, QueryOptions& options) {
  if (const auto method = contact_method(options.settings.contact); !method) {
    usage_error("--" + method.error().message);
  }
  check(options.views);
  if (options.std && options.settings.contact.method != MethodKind::field) {
    usage_error("query: --std is for the method field: " +
                std::string(name_of(options.settings.contact.method)) +
                " does not say what noise does to it");
  }
  if (options.std && !options.views.cloud.empty()) {
    usage_error("query: --std goes with --depth: the noise of a cloud is unknown");
  }
  if (const Status status = check(options.settings.surface); !status) {
    usage_error("query: " + status.error().message);
  }
  const auto ends_with = [&](std::string_view end) { return options.poses.ends_with(end); };
  if (ends_with(".parquet") || ends_with(".pq") || !options.shard.empty() ||
      !options.output.empty()) {
    usage_error(
        "query: poses in Parquet, --shard and -o are for the palpate of the Python package: "
        "pip install palpate-*.whl pyarrow (docs/guide/batches.md)");
  }
  if (options.frames.wrench == "device" ||
      options.settings.output.wrench_frame == WrenchFrame::device) {
    usage_error("query: --wrench-frame device is of a run; no device is part of a query");
  }
  if (options.pose.empty() == options.poses.empty()) {
    usage_error("query: give one of --pose and --poses");
  }
  if (!options.pose.empty()) {
    const auto pose = parse_pose(options.pose);
    if (!pose) usage_error("--pose: " + pose.error().message);
    options.X_WT = {*pose};
  }
  check_use(app, options.settings);
  if (options.caps.file.empty() && app.count("--caps-segments") > 0) {
    usage_error("query: --caps-segments goes with --caps");
  }
  if (!options.caps.file.empty()) {
    if (options.pose.empty()) usage_error("query: --caps shows one --pose, not --poses");
    check_caps_options(options.caps);
  }
}

}  // namespace

void add_query(CLI::App& program, Action& action) {
  const auto options = std::make_shared<QueryOptions>();
  CLI::App& app = *program.add_subcommand(
      "query",
      "Measure a tool against single depth images of one or more cameras, once per "
      "pose.");
  app.add_option("tool", options->tool, "tool file")->required()->type_name("TOOL.palp");
  add_prefix_option(app, options->num_spheres);
  add_frozen_options(app, options->views);
  app.add_option("--pose", options->pose,
                 "pose of the tool in the world (with a single camera: the camera frame)")
      ->type_name("'tx ty tz qx qy qz qw'");
  app.add_option("--poses", options->poses,
                 "file of poses: lines 't tx ty tz qx qy qz qw'; or Parquet with columns tx ty tz "
                 "qx qy qz qw and output to -o, with the program of the Python package")
      ->type_name("FILE");
  app.add_option("--shard", options->shard,
                 "with Parquet: compute the K-th of N parts, counted from 1")
      ->type_name("K/N");
  app.add_option("-o,--output", options->output,
                 "with Parquet: output file, the poses with their results")
      ->type_name("FILE.parquet");
  app.option_defaults()->group("Results");
  add_number(app, "--stiffness", options->stiffness, {0, 1e15, "N/m3"},
             "also print newtons: force and torque of this stiffness per volume; 0: none");
  app.add_flag("--std", options->std,
               "also print standard deviations by the noise of the depth (method field)");
  app.add_flag("--clearance", options->wants_clearance,
               "also the distance to what the cameras have seen and to the objects, up to 0.1 m; "
               "negative inside");
  app.add_flag("--json", options->json, "print the results as JSON");
  app.option_defaults()->group("Contact");
  add_object_option(app, options->objects, false);
  app.option_defaults()->group("Options");
  add_output_options(app, options->frames, options->settings);
  add_setting_options(app, "Contact", settings_of(options->settings), kContactOptions);
  add_threads_option(app, options->settings.num_threads, kThreadsHelp);
  add_setting_options(app, "From depth to surface", settings_of(options->settings),
                      kSurfaceOptions);
  SettingTable frozen;  // settings that apply without time
  add_settings(frozen, options->settings.contact);
  add_settings(frozen, options->settings.surface);
  add_settings(frozen, options->settings.field);
  add_settings(frozen, options->settings.output);
  add_set_option(app, frozen);
  add_caps_options(app, options->caps);
  app.footer(
      "Example: palpate query drill.palp --depth frame.png --intrinsics 525,525,319.5,239.5 "
      "--pose '0 0 0.8 0 0 0 1' --method graph");
  app.callback([options, &app, &action] {
    options->given = given_settings(app, {kSurfaceOptions});
    check(app, *options);
    action = [options] { return run(*options); };
  });
}

}  // namespace palpate::apps
