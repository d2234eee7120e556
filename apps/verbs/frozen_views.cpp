#include "apps/verbs/frozen_views.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <optional>
#include <utility>

#include "apps/terminal/terminal.h"
#include "apps/touch/objects.h"
#include "apps/touch/sources.h"
#include "palpate/cameras/cameras.h"
#include "palpate/io/files.h"
#include "palpate/io/formats.h"
#include "src/cameras/internal/plausibility.h"
#include "src/cloud/internal/frame_limits.h"
#include "src/core/internal/stamp.h"
#include "src/field/internal/pinhole_cloud.h"

namespace palpate::apps {
namespace {

Result<DepthFrame> read_image(const std::string& file, double unit) {
  return std::filesystem::path(file).extension() == ".pcd" ? load_depth_pcd(file, unit)
                                                           : load_depth_png(file, unit);
}

Result<DepthFrame> first_frame(const CameraUri& uri, Intrinsics& intrinsics, SensorKind& sensor) {
  const auto source = open_camera(uri, opening());
  if (!source) return source.error();
  DepthFrame frame;
  const auto got = (*source)->next(frame);
  for (const std::string& note : (*source)->take_notes()) print_warning(note);
  if (!got) return got.error();
  if (!*got) return Error{Errc::bad_input, (*source)->info().name + " has no frames"};
  intrinsics = (*source)->info().intrinsics;
  sensor = (*source)->info().sensor;
  return frame;
}

}  // namespace

/// The surface of one camera, and the owners of its memory.
struct FrozenViews::Frozen {
  std::string name;  ///< for messages
  PointCloud cloud;
  std::optional<SurfaceEstimator> surface;
  std::optional<DepthField> field, seen_free;
  std::size_t num_usable = 0;

  PointCloudView points() const { return surface ? surface->cloud() : cloud.view(); }

  static Result<Frozen> from_points(const std::string& file);
  static Result<Frozen> from_frame(const std::string& name, const Result<DepthFrame>& frame,
                                   const Intrinsics& intrinsics, const SurfaceOptions& options,
                                   ThreadPool& pool);
  Status add_fields(const DepthFieldOptions& options, ThreadPool& pool);
};

Result<FrozenViews::Frozen> FrozenViews::Frozen::from_points(const std::string& file) {
  auto loaded = load_cloud(file);
  if (!loaded) return loaded.error();
  if (!loaded->note.empty()) print_warning(loaded->note);
  Frozen frozen;
  frozen.name = file;
  frozen.cloud = std::move(loaded->cloud);
  if (const std::string doubt = doubt_points(frozen.cloud.view()); !doubt.empty()) {
    print_warning(file + ": " + doubt);
  }
  const float* x = frozen.cloud.channel(0);
  frozen.num_usable = static_cast<std::size_t>(
      std::count_if(x, x + frozen.cloud.size(), [](float value) { return !std::isnan(value); }));
  if (frozen.num_usable == 0) {
    print_warning(file + ": none of " + std::to_string(frozen.cloud.size()) +
                  " points is usable; check its coordinates and normals");
  }
  return frozen;
}

Result<FrozenViews::Frozen> FrozenViews::Frozen::from_frame(const std::string& name,
                                                            const Result<DepthFrame>& frame,
                                                            const Intrinsics& intrinsics,
                                                            const SurfaceOptions& options,
                                                            ThreadPool& pool) {
  if (!frame) return frame.error();
  auto surface = SurfaceEstimator::create(frame->width, frame->height, intrinsics, options);
  if (!surface) return surface.error();
  const SurfaceStats stats = surface->update(*frame, pool);
  Frozen frozen;
  frozen.name = name;
  frozen.num_usable = static_cast<std::size_t>(stats.num_points);
  if (stats.num_points == 0) {
    char text[160];
    std::snprintf(text, sizeof text,
                  stats.num_valid == 0
                      ? "0 of %zu pixels are usable (%g to %g m); check --depth-unit"
                      : "0 of %zu pixels have a normal (%g to %g m); the image is too sparse",
                  frame->pixels.size(), options.min_depth, options.max_depth);
    print_warning(name + ": " + text);
  }
  frozen.surface = *std::move(surface);
  return frozen;
}

Status FrozenViews::Frozen::add_fields(const DepthFieldOptions& options, ThreadPool& pool) {
  PointCloud pinhole;
  if (!surface) {
    auto made = make_pinhole_cloud(cloud.view());
    if (!made) return Error{made.error().code, name + ": " + made.error().message};
    pinhole = *std::move(made);
  }
  const PointCloudView view = surface ? surface->cloud() : pinhole.view();
  for (auto* to : {&field, &seen_free}) {
    auto made = DepthField::create(view.width, view.height,
                                   to == &field ? options : options_of_seen_free(options));
    if (!made) return made.error();
    *to = *std::move(made);
    (*to)->update(view, pool);
  }
  return Done{};
}

Result<FrozenViews> FrozenViews::read(const FrozenOptions& options, const RunSettings& settings,
                                      const std::vector<std::string>& given, ThreadPool& pool) {
  FrozenViews scene;
  const auto add = [&](Result<Frozen> frozen, const Pose& X_WC) -> Status {
    if (!frozen) return frozen.error();
    return scene.add(*std::move(frozen), X_WC, settings, pool);
  };
  const auto from_frame = [&](const std::string& name, Result<DepthFrame> frame,
                              const Intrinsics& intrinsics, SensorKind sensor) {
    SurfaceOptions surface = settings.surface;
    sensor = options.sensor.kind.value_or(sensor);
    use_sensor(sensor, given, surface);
    use_method(settings.contact.method, given, surface);
    if (frame) {
      const Status mode =
          check_mode(options.sensor, name, frame->width, frame->height, frame->unit);
      if (!mode) frame = mode.error();
    }
    if (frame) drop_far_codes(*frame, sensor);
    return Frozen::from_frame(name, frame, intrinsics, surface, pool);
  };
  Status status = Done{};
  if (!options.cloud.empty()) status = add(Frozen::from_points(options.cloud), {});
  const std::size_t num_unposed = options.depths.size() - options.X_WC.size();
  for (std::size_t i = 0; i < options.depths.size() && status; ++i) {
    const std::string& file = options.depths[i];
    const Intrinsics& intrinsics = options.intrinsics[options.intrinsics.size() > 1 ? i : 0];
    const auto frame = read_image(file, options.unit);
    const std::string doubt =
        frame ? Plausibility().look(*frame, {frame->width, frame->height, intrinsics, {}}) : "";
    if (!doubt.empty()) print_warning(file + ": " + doubt);
    status = add(from_frame(file, frame, intrinsics, SensorKind::none),
                 i < num_unposed ? Pose{} : options.X_WC[i - num_unposed]);
  }
  for (std::size_t i = 0; i < options.cameras.size() && status; ++i) {
    Intrinsics intrinsics;
    SensorKind sensor = SensorKind::none;
    const auto frame = first_frame(options.cameras[i], intrinsics, sensor);
    status = add(from_frame(options.cameras[i].text, frame, intrinsics, sensor),
                 frame ? frame->X_WC : Pose{});
  }
  if (!status) return status.error();
  if (settings.contact.method != MethodKind::field) scene.join_points();
  return scene;
}

Status FrozenViews::add(Frozen given, const Pose& X_WC, const RunSettings& settings,
                        ThreadPool& pool) {
  auto frozen = std::make_shared<Frozen>(std::move(given));
  if (settings.contact.method == MethodKind::field) {
    if (const Status status = frozen->add_fields(settings.field, pool); !status) return status;
  }
  SurfaceView surface{frozen->points(), {}};
  surface.cloud.stamp = next_stamp();  // it stays as it is
  if (frozen->field) surface.field = frozen->field->view();
  if (frozen->seen_free) {
    surface.role = SurfaceRole::one_of_several;
    surface.seen_free = frozen->seen_free->view();
  }
  surface.X_WC = X_WC;
  X_WC_.push_back(X_WC);
  views_.push_back({surface, surface, 1});
  num_usable_ += frozen->num_usable;
  frozen_.push_back(std::move(frozen));
  return Done{};
}

void FrozenViews::join_points() {
  if (views_.size() < 2) return;
  joined_ = joined_clouds(views_);
  SurfaceView surface{joined_.view(), {}};
  surface.cloud.stamp = next_stamp();
  views_ = {{surface, surface, 1}};
}

void add_frozen_options(CLI::App& app, FrozenOptions& options) {
  app.add_option("--cloud", options.cloud, "cloud: points with normals (PLY or PCD)")
      ->type_name("FILE");
  app.add_option("--depth", options.depths,
                 "16-bit depth image, PNG or an organized PCD; repeat for several cameras, each "
                 "with its --camera-pose")
      ->type_name("FILE");
  add_intrinsics_option(
      app, [&options](const Intrinsics& k) { options.intrinsics.push_back(k); },
      "intrinsics of the camera, in pixels; once for all images, or once for each");
  add_number(app, "--depth-unit", options.unit, {1e-6, 1, "m"}, "depth scale, meters per count");
  app.add_option_function<std::vector<std::string>>(
         "--camera-pose",
         [&options](const std::vector<std::string>& poses) {
           for (const std::string& text : poses) {
             const auto pose = parse_pose(text);
             if (!pose) usage_error("--camera-pose: " + pose.error().message);
             options.X_WC.push_back(*pose);
           }
         },
         "pose of the camera in the world, once for each image; without the first one, "
         "its frame is the world")
      ->type_name("'tx ty tz qx qy qz qw'");
  app.add_option("--camera", options.streams,
                 "depth stream, of which the first frame is used; repeat for several, each with "
                 "?pose=tx,ty,tz,qx,qy,qz,qw of its camera in the world")
      ->type_name("URI");
  add_sensor_option(app, options.sensor);
}

void check(FrozenOptions& options) {
  auto cameras = parse_camera_uris(options.streams);
  if (!cameras) usage_error("--" + cameras.error().message);
  options.cameras = *std::move(cameras);
  const std::size_t num_images = options.depths.size(), num_streams = options.cameras.size();
  const std::size_t num_poses = options.X_WC.size(), num_intrinsics = options.intrinsics.size();
  const bool has_cloud = !options.cloud.empty();
  if (int(has_cloud) + int(num_images > 0) + int(num_streams > 0) != 1) {
    usage_error("query: give one of --cloud, --depth and --camera");
  }
  if (std::max(num_images, num_streams) > kMaxCameras) {
    usage_error("query: at most " + std::to_string(kMaxCameras) + " cameras");
  }
  if (num_images == 0 && num_intrinsics > 0) {
    usage_error("query: --intrinsics goes with --depth; a camera takes ?intrinsics=");
  }
  if (num_images == 0 && num_poses > 0) {
    usage_error("query: --camera-pose goes with --depth; a camera takes ?pose=");
  }
  if (num_images > 0 && num_intrinsics != 1 && num_intrinsics != num_images) {
    usage_error("query: --depth needs --intrinsics fx,fy,cx,cy, once or once for each image");
  }
  if (num_images > 0 && num_poses != num_images && num_poses + 1 != num_images) {
    usage_error("query: " + std::to_string(num_images) + " images have " +
                std::to_string(num_poses) +
                " times --camera-pose; give it for each, or for all but the first");
  }
  if (const Status status = check_one_world(options.cameras); !status) {
    usage_error("query: " + status.error().message);
  }
  warn_of_twins(options.cameras);
}

}  // namespace palpate::apps
