// The threads that publish a run over ROS 2. The wrench has one of its own, at a steady rate;
// another one publishes all that can wait, so that a slow message never delays a wrench.
#include "apps/ros/ros_output.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <limits>
#include <system_error>
#include <thread>
#include <utility>

#include "apps/ros/ros_display.h"
#include "apps/ros/ros_verdict.h"
#include "apps/ros/wall_time.h"
#include "src/core/internal/guarded.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/core/internal/triple_buffer.h"
#include "src/io/internal/ros_messages.h"
#include "src/math/internal/rotation_vector.h"
#include "src/math/internal/wrench_transform.h"
#include "src/ros/internal/ros_node.h"
#include "src/run/internal/event.h"
#include "src/run/internal/real_time.h"

namespace palpate::apps {
namespace {

using State = RosContact::State;

constexpr double kDiagnosticsPeriod = 1, kShortestDiagnosticsPeriod = 0.1;  // s
constexpr double kLongestLag = 0.02;  // s behind the clock; later publications are left out
constexpr double kLooks = 100;        // Hz: minimum rate of the thread that publishes the rest
constexpr int kPriority = 60;         // below the contact thread
/// Delay of a wrench after its tick, in periods, and gain of the filter that follows the phase of
/// the ticks: slow, so that a late tick does not make its wrench late.
constexpr double kAfterTick = 0.1, kFollowing = 0.01;

class Output final : public RosOutput {
 public:
  Output(const Tool& tool, std::vector<DepthStreamInfo> streams, RosOutputOptions options)
      : options_(std::move(options)),
        tool_(tool),
        streams_(std::move(streams)),
        display_(tool_, streams_, options_) {
    if (options_.camera_frame.empty()) options_.camera_frame = streams_.front().frame;
    if (options_.camera_frame.empty()) options_.camera_frame = "camera";
  }
  ~Output() override { end(); }

  Status open(const std::vector<SceneObject>& objects) {
    auto node = RosNode::join();
    if (!node) return node.error();
    const auto publish = [&](std::unique_ptr<RosPublisher>& to, const std::string& name,
                             const char* type, const RosQos& qos) -> Status {
      auto made = (*node)->publish(full_topic(name, options_.name_space), type, qos);
      if (!made) return made.error();
      to = *std::move(made);
      return Done{};
    };
    for (const Status& status :
         {publish(wrench_, options_.wrench, "geometry_msgs/WrenchStamped", {true, false, 100}),
          publish(contact_, "contact", "palpate_msgs/Contact", {}),
          publish(pose_, "tool_pose", "geometry_msgs/PoseStamped", {}),
          publish(twist_, "tool_twist", "geometry_msgs/TwistStamped", {}), display_.open(publish),
          publish(diagnostics_, "/diagnostics", "diagnostic_msgs/DiagnosticArray", {})}) {
      if (!status) return status.error();
    }
    std::vector<RosBody> bodies;
    body_frames_.reserve(objects.size());  // bodies look at them
    for (const SceneObject& object : objects) {
      const bool moves = object.moves;
      if (moves) body_frames_.push_back(full_topic(object.name, options_.name_space).substr(1));
      bodies.push_back({moves ? body_frames_.back() : options_.camera_frame, object.name,
                        object.shape->mesh(), moves ? Pose{} : object.X_WB});
    }
    display_.publish_meshes(bodies);
    if (body_frames_.empty()) return Done{};
    return publish(transforms_, "/tf", "tf2_msgs/TFMessage", {true, false, 100});
  }

  void join(RunMonitor& monitor) override {
    monitor.on_loop = [this, others = std::move(monitor.on_loop)](RunLoop* loop) {
      loop != nullptr ? begin(*loop) : end();
      if (others) others(loop);
    };
    RunObserver& observer = monitor.observer;
    observer.on_contact = [this,
                           others = std::move(observer.on_contact)](const ContactRecord& contact) {
      const bool follows = contact.number == last_contact_.number + 1;
      contacts_.publish({contact, follows ? last_contact_.time : std::nan("")});
      last_contact_ = {contact.number, contact.contact.time};
      if (others) others(contact);
    };
    observer.on_frame = [this, others = std::move(observer.on_frame)](const FrameRecord& record,
                                                                      const DepthFrame& frame) {
      display_.publish_points(record, frame);
      display_.keep(record, frame);
      if (others) others(record, frame);
    };
  }

 private:
  using Why = RosVerdict::Why;

  /// Contact, and the time of its bodies: that of the contact before, since bodies move after
  /// they are measured. NaN: that contact was not published.
  struct MeasuredBodies {
    ContactRecord contact;
    double bodies_time = 0;  // s, monotonic
  };
  struct ContactTime {
    std::uint64_t number = 0;
    double time = std::numeric_limits<double>::quiet_NaN();  // s, monotonic; before the first: none
  };

  /// Output of the wrench thread for the other one: the published tick and its verdict.
  struct Published {
    TickRecord tick;
    RosVerdict verdict;
    double time = 0;            // s, monotonic
    std::uint64_t num_due = 0;  // contacts to publish until then
  };

  void begin(RunLoop& loop) {
    full_volume_ = full_volume(tool_, loop.settings().contact);
    is_ending_ = false;
    try {
      // Both threads skip messages for which there is no memory.
      const auto left_out = [](const Error&) {};
      rest_thread_ =
          std::thread([this, &loop, left_out] { guarded([&] { publish_rest(loop); }, left_out); });
      wrench_thread_ = std::thread(
          [this, &loop, left_out] { guarded([&] { publish_wrenches(loop); }, left_out); });
    } catch (const std::system_error&) {
      end_with({State::failed, Why::no_thread});
    }
  }

  void end() {
    if (rest_thread_.joinable()) end_with({State::failed, Why::has_ended});
  }

  /// Publishes a last, invalid wrench, so that subscribers do not keep the one before.
  void end_with(const RosVerdict& verdict) {
    is_ending_ = true;
    event_.ring();
    if (wrench_thread_.joinable()) wrench_thread_.join();
    if (rest_thread_.joinable()) rest_thread_.join();
    published_.refresh();
    Published last = published_.value();
    last.verdict = verdict;
    last.time = monotonic_now();
    publish_wrench(last);
    publish_contact(last);
    say(last);
  }

  /// The wrench thread; another thread publishes everything that can wait.
  void publish_wrenches(RunLoop& loop) {
    if (!loop.settings().wants_real_time || request_real_time(kPriority) != 0) {
      take_rank(ThreadRank::surface);
    }
    const double period = 1 / options_.rate;
    const auto every = [&](double rate) {
      return std::max<std::uint64_t>(static_cast<std::uint64_t>(options_.rate / rate), 1);
    };
    const std::uint64_t contacts_every = every(options_.contact_rate), look_every = every(kLooks);
    std::optional<TickRecord> tick;
    bool was_valid = false;
    std::uint64_t number = 0, num_due = 0;
    double last = 0;
    for (double next = monotonic_now(); !is_ending_;) {
      next += period;
      sleep_until(next);
      const double time = monotonic_now();
      if (time - next > kLongestLag) next = time;
      if (const auto newest = loop.latest()) {
        tick = newest;
        next += kFollowing * std::remainder(tick->device.time + kAfterTick * period - next, period);
      }
      if (!tick) continue;
      if (last > 0) periods_.record(static_cast<std::int64_t>(1e9 * (time - last)));
      last = time;
      Published& published = published_.draft();
      published.tick = *tick;
      published.time = time;
      published.verdict = judge(*tick, time, options_.max_age);
      guarded([&] { publish_wrench(published); }, [&](const Error&) { ++num_not_sent_; });
      const bool is_due = number % contacts_every == 0 || published.verdict.is_valid() != was_valid;
      was_valid = published.verdict.is_valid();
      published.num_due = num_due += is_due ? 1 : 0;
      const bool is_looked_for = is_due || number % look_every == 0;
      ++number;
      published_.publish();
      if (is_looked_for) event_.ring();
    }
  }

  void publish_wrench(const Published& published) {
    const bool in_tool = options_.frame == WrenchFrame::tool;
    const std::string& frame = in_tool ? options_.tool_frame : options_.camera_frame;
    const Pose& X_WT = published.tick.step.X_WT;
    Wrench wrench;
    if (published.verdict.is_valid()) {
      wrench = transformed_to(in_tool ? X_WT : Pose{}, published.tick.step.contact_W,
                              X_WT * tool_.sphere_mass().center_of_mass);
    }
    const bool was_sent =
        wrench_->publish(wrench_message({wall_time(published.tick.device.time), frame}, wrench));
    ++(was_sent ? num_sent_ : num_not_sent_);
  }

  /// The other thread, woken by the wrench's.
  void publish_rest(RunLoop& loop) {
    take_rank(ThreadRank::recorder);
    std::uint64_t num_published = 0;
    for (;;) {
      const std::uint32_t heard = event_.count();
      if (is_ending_) return;
      if (!published_.refresh()) {
        event_.wait(heard);
        continue;
      }
      guarded([&] { publish_due(loop, published_.value(), num_published); }, [](const Error&) {});
      event_.wait(heard);
    }
  }

  void publish_due(RunLoop& loop, const Published& published, std::uint64_t& num_published) {
    if (std::exchange(num_published, published.num_due) != published.num_due) {
      if (contacts_.refresh()) publish_bodies(contacts_.value());
      publish_contact(published);
    }
    display_.publish_spheres(loop, published.time);
    const bool is_changed = published.verdict.state != last_state_;
    if (published.time >= next_diagnostics_ ||
        (is_changed && published.time >= last_diagnostics_ + kShortestDiagnosticsPeriod)) {
      say(published);
    }
  }

  void publish_contact(const Published& published) {
    const std::uint64_t time = wall_time(published.tick.device.time);
    if (published.tick.dt > 0) {  // else there is no hand yet
      pose_->publish(pose_message({time, options_.camera_frame}, published.tick.step.X_WT));
    }
    publish_twist(time, published);
    const RosContact contact = contact_of(published.tick, published.verdict,
                                          contacts_.value().contact, tool_, full_volume_);
    contact_->publish(ros_contact_message({time, options_.tool_frame}, contact));
  }

  void publish_bodies(const MeasuredBodies& measured) {
    if (body_frames_.empty() || std::isnan(measured.bodies_time)) return;
    const BodyPoses& bodies = measured.contact.bodies;
    std::vector<RosTransform> transforms;
    for (std::size_t i = 0; i < std::min<std::size_t>(body_frames_.size(), bodies.num); ++i) {
      transforms.push_back({options_.camera_frame, body_frames_[i], bodies.of[i]});
    }
    transforms_->publish(transform_message(wall_time(measured.bodies_time), transforms));
  }

  /// Twist since the last published pose. Zero while the wrench is not valid: a follower then
  /// stops.
  void publish_twist(std::uint64_t time, const Published& published) {
    const double tick_time = published.tick.device.time, seconds = tick_time - last_pose_time_;
    const bool is_valid = published.verdict.is_valid();
    const Pose& X_WT = published.tick.step.X_WT;
    Twist V_WT;
    if (is_valid && has_last_pose_ && seconds > 0 && seconds <= options_.max_age) {
      V_WT = {(X_WT.translation - last_X_WT_.translation) / seconds,
              rotation_between(last_X_WT_.rotation, X_WT.rotation) / seconds};
    }
    if (seconds != 0) {
      has_last_pose_ = is_valid;
      last_X_WT_ = X_WT;
      last_pose_time_ = tick_time;
    }
    twist_->publish(twist_message({time, options_.camera_frame}, V_WT));
  }

  void say(const Published& published) {
    const RosVerdict& verdict = published.verdict;
    last_state_ = verdict.state;
    last_diagnostics_ = published.time;
    next_diagnostics_ = published.time + kDiagnosticsPeriod;
    constexpr RosDiagnostic::Level kLevels[] = {
        RosDiagnostic::Level::ok, RosDiagnostic::Level::stale, RosDiagnostic::Level::error};
    const auto periods = periods_.summary();
    const auto milliseconds = [](double seconds) {
      char text[32];
      std::snprintf(text, sizeof text, "%.1f", 1e3 * seconds);
      return std::string(text);
    };
    const RosDiagnostic status[] = {
        {kLevels[static_cast<int>(verdict.state)],
         "palpate: contact",
         verdict.is_valid() ? "the wrench is valid" : verdict.reason(),
         "",
         {{"age of the depth image, ms", milliseconds(verdict.depth_age)},
          {"age of the measurement, ms", milliseconds(verdict.contact_age)},
          {"wrenches sent", std::to_string(num_sent_)},
          {"wrenches not sent", std::to_string(num_not_sent_)},
          {"readers of the wrench", std::to_string(wrench_->num_readers())},
          {"period of the wrench, p99, us", std::to_string(static_cast<int>(periods.p99))}}}};
    diagnostics_->publish(diagnostics_message({wall_time(published.time), ""}, status));
  }

  RosOutputOptions options_;
  const Tool& tool_;
  const std::vector<DepthStreamInfo> streams_;
  RosDisplay display_;
  std::unique_ptr<RosPublisher> wrench_, contact_, pose_, twist_, diagnostics_, transforms_;
  std::vector<std::string> body_frames_;  // of objects that move
  double full_volume_ = 0;

  TripleBuffer<MeasuredBodies> contacts_;  // from the thread of the observer
  ContactTime last_contact_;               // of that thread

  // Written by the wrench's thread, read by others.
  TripleBuffer<Published> published_;
  Event event_;
  LatencyHistogram periods_;
  std::atomic<std::uint64_t> num_sent_ = 0, num_not_sent_ = 0;

  // State of the thread that publishes the rest.
  bool has_last_pose_ = false;
  Pose last_X_WT_;
  double last_pose_time_ = 0;
  State last_state_ = State::failed;
  double last_diagnostics_ = 0, next_diagnostics_ = 0;

  std::atomic<bool> is_ending_ = false;
  std::thread wrench_thread_, rest_thread_;
};

}  // namespace

Result<std::unique_ptr<RosOutput>> RosOutput::create(const Tool& tool,
                                                     const std::vector<SceneObject>& objects,
                                                     std::vector<DepthStreamInfo> streams,
                                                     const RosOutputOptions& options) {
  auto output = std::make_unique<Output>(tool, std::move(streams), options);
  if (const Status status = output->open(objects); !status) return status.error();
  return std::unique_ptr<RosOutput>(std::move(output));
}

}  // namespace palpate::apps
