// A node of ROS 2 over Cyclone DDS: its publishers, its subscriptions with a thread each, and its
// place in the graph that graph tools show.
#include "src/ros/internal/ros_node.h"

#include <algorithm>
#include <atomic>
#include <charconv>
#include <cstring>
#include <mutex>
#include <set>
#include <system_error>
#include <thread>

#include "src/core/internal/guarded.h"
#include "src/core/internal/shared_library.h"
#include "src/io/internal/ros_messages.h"
#include "src/ros/dds_endpoint.h"
#include "src/ros/internal/dds_api.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr const char* kEntitiesType = "rmw_dds_common/ParticipantEntitiesInfo";

/// Returns the name of a topic between DDS programs of ROS 2.
std::string dds_topic(const std::string& topic) { return "rt" + topic; }

class Node;

/// Lists an endpoint in the graph as long as it lives.
class Registration {
 public:
  Registration(std::shared_ptr<Node> node, RosGid gid, bool is_writer);
  ~Registration();

 private:
  const std::shared_ptr<Node> node_;
  const RosGid gid_;
  const bool is_writer_;
};

class Publisher final : public RosPublisher {
 public:
  Publisher(std::shared_ptr<Node> node, DdsEndpoint writer)
      : registration_(std::move(node), writer.gid(), true), writer_(std::move(writer)) {}

  bool publish(std::string_view message) override { return write(writer_, message); }
  int num_readers() const override {
    return dds::api()->matched_readers(writer_.endpoint.get(), nullptr, 0);
  }

 private:
  const Registration registration_;  // destroyed last
  const DdsEndpoint writer_;
};

class Subscription final : public RosSubscription {
 public:
  Subscription(std::shared_ptr<Node> node, DdsEntity& participant, DdsEndpoint reader,
               RosNode::MessageHandler handler)
      : registration_(std::move(node), reader.gid(), false),
        reader_(std::move(reader)),
        received_(std::move(handler)) {
    const dds::Api& api = *dds::api();
    ending_ = DdsEntity(api.create_guard_condition(participant.get()));
    waitset_ = DdsEntity(api.create_waitset(participant.get()));
    data_ = DdsEntity(api.create_read_condition(reader_.endpoint.get(), dds::kAnyState));
    api.attach(waitset_.get(), ending_.get(), 0);
    api.attach(waitset_.get(), data_.get(), 1);
  }
  ~Subscription() override {
    is_ending_ = true;
    dds::api()->set_guard_condition(ending_.get(), true);
    if (thread_.joinable()) thread_.join();
  }
  /// Error: the system starts no thread.
  Status start() {
    return start_thread(thread_, "that listens to a topic", [this] { listen(); });
  }
  int num_writers() const override {
    return dds::api()->matched_writers(reader_.endpoint.get(), nullptr, 0);
  }

 private:
  void listen() {
    while (!is_ending_) {
      std::intptr_t triggered[2];
      dds::api()->wait(waitset_.get(), triggered, 2, 1000 * dds::kMillisecond);
      take();
    }
  }
  void take() {
    constexpr std::size_t kMaxSamples = 16;
    void* samples[kMaxSamples] = {};
    dds::SampleInfo infos[kMaxSamples];
    const auto num =
        dds::api()->take(reader_.endpoint.get(), samples, infos, kMaxSamples, kMaxSamples);
    for (int i = 0; i < num && !is_ending_; ++i) {
      if (!infos[i].has_data) continue;
      // A message for which there is no memory is lost, as on a bad network.
      guarded([&] { received_(reader_.type->layout.from_native(samples[i])); },
              [](const Error&) {});
    }
    if (num > 0) dds::api()->return_loan(reader_.endpoint.get(), samples, num);
  }

  const Registration registration_;  // destroyed last
  const DdsEndpoint reader_;
  const RosNode::MessageHandler received_;
  DdsEntity waitset_, ending_, data_;
  std::atomic<bool> is_ending_ = false;
  std::thread thread_;
};

/// Cyclone's own settings come first, from CYCLONEDDS_URI.
std::string configuration(const RosNodeOptions& options) {
  std::string text = environment("CYCLONEDDS_URI");
  if (!options.is_local) return text;
  return text + (text.empty() ? "" : ",") +
         "<General><Interfaces><NetworkInterface address=\"127.0.0.1\"/></Interfaces>"
         "<AllowMulticast>false</AllowMulticast></General>"
         "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
         "<MaxAutoParticipantIndex>60</MaxAutoParticipantIndex>"
         "<SPDPInterval>1s</SPDPInterval>"  // to those who start later
         "<Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery>";
}

class Node final : public RosNode {
 public:
  static Result<std::shared_ptr<RosNode>> create(const RosNodeOptions& options) {
    const auto& api = dds::api();
    if (!api) return api.error();
    const auto domain = static_cast<std::uint32_t>(options.domain);
    // Fails where the program has opened the domain before, in its own way.
    if (const std::string text = configuration(options); !text.empty()) {
      api->create_domain(domain, text.c_str());
    }
    const QosPointer qos(api->create_qos());
    constexpr std::string_view kEnclave = "enclave=/;";
    api->set_user_data(qos.get(), kEnclave.data(), kEnclave.size());
    DdsEntity participant(api->create_participant(domain, qos.get(), nullptr));
    if (!participant.is_good()) {
      return dds_error("cannot join the ROS domain " + std::to_string(options.domain),
                       participant.get());
    }
    auto node = std::make_shared<Node>(options, std::move(participant));
    if (const Status status = node->announce(); !status) return status.error();
    return std::shared_ptr<RosNode>(std::move(node));
  }

  Node(const RosNodeOptions& options, DdsEntity participant)
      : options_(options), participant_(std::move(participant)) {}

  Result<std::unique_ptr<RosPublisher>> publish(const std::string& topic, const std::string& type,
                                                const RosQos& qos) override {
    auto writer = open_topic(topic, type, qos, true);
    if (!writer) return writer.error();
    return std::unique_ptr<RosPublisher>(std::make_unique<Publisher>(self(), *std::move(writer)));
  }

  Result<std::unique_ptr<RosSubscription>> subscribe(const std::string& topic,
                                                     const std::string& type, const RosQos& qos,
                                                     MessageHandler handler) override {
    auto reader = open_topic(topic, type, qos, false);
    if (!reader) return reader.error();
    auto made = std::make_unique<Subscription>(self(), participant_, *std::move(reader),
                                               std::move(handler));
    if (const Status status = made->start(); !status) return status.error();
    return std::unique_ptr<RosSubscription>(std::move(made));
  }

  std::vector<RosTopic> topics() override;

  /// Adds to or removes from the list that graph tools show.
  void change_entities(const RosGid& gid, bool is_writer, bool is_there) {
    const std::lock_guard lock(mutex_);
    auto& gids = is_writer ? entities_.writers : entities_.readers;
    if (is_there) gids.push_back(gid);
    if (!is_there) std::erase(gids, gid);
    announce_entities();
  }

 private:
  std::shared_ptr<Node> self() { return std::static_pointer_cast<Node>(shared_from_this()); }
  Result<DdsEndpoint> open_topic(const std::string& topic, const std::string& type,
                                 const RosQos& qos, bool is_writer) const {
    const std::string full = full_topic(topic, options_.node_namespace);
    if (const Status status = check_topic(full); !status) return status.error();
    return make_endpoint(participant_, dds_topic(full), type, qos, is_writer);
  }

  Status announce() {
    dds::Guid guid{};
    dds::api()->get_guid(participant_.get(), &guid);
    std::copy(std::begin(guid.bytes), std::end(guid.bytes), entities_.participant.begin());
    entities_.node_namespace = options_.node_namespace;
    entities_.node_name = options_.name;
    // Peers of Humble expect other bytes there; they see topics, and no node.
    if (environment("ROS_DISTRO") == "humble") return Done{};
    auto writer = make_endpoint(participant_, "ros_discovery_info", kEntitiesType,
                                {.is_reliable = true, .is_kept = true, .depth = 1}, true);
    if (!writer) return writer.error();
    graph_ = *std::move(writer);
    const std::lock_guard lock(mutex_);
    announce_entities();
    return Done{};
  }
  void announce_entities() {
    if (graph_.endpoint.is_good()) write(graph_, entities_message(entities_));
  }

  const RosNodeOptions options_;
  DdsEntity participant_;
  DdsEndpoint graph_;
  std::mutex mutex_;
  RosEntities entities_;
};

Registration::Registration(std::shared_ptr<Node> node, RosGid gid, bool is_writer)
    : node_(std::move(node)), gid_(gid), is_writer_(is_writer) {
  node_->change_entities(gid_, is_writer_, true);
}
Registration::~Registration() { node_->change_entities(gid_, is_writer_, false); }

/// "sensor_msgs/Image" of "sensor_msgs::msg::dds_::Image_"; empty: no message of ROS 2.
std::string ros_type(std::string_view dds_name) {
  constexpr std::string_view kMiddle = "::msg::dds_::";
  const std::size_t at = dds_name.find(kMiddle);
  if (at == std::string_view::npos || !dds_name.ends_with('_')) return {};
  const std::string_view type = dds_name.substr(at + kMiddle.size());
  return std::string(dds_name.substr(0, at)) + "/" + std::string(type.substr(0, type.size() - 1));
}

std::vector<RosTopic> Node::topics() {
  const dds::Api& api = *dds::api();
  const DdsEntity reader(
      api.create_reader(participant_.get(), dds::kPublications, nullptr, nullptr));
  std::set<RosTopic> found;
  constexpr std::size_t kMaxSamples = 64;
  for (;;) {
    void* samples[kMaxSamples] = {};
    dds::SampleInfo infos[kMaxSamples];
    const auto num = api.take(reader.get(), samples, infos, kMaxSamples, kMaxSamples);
    for (int i = 0; i < num; ++i) {
      if (!infos[i].has_data) continue;
      const auto* const endpoint = static_cast<const dds::Endpoint*>(samples[i]);
      const std::string_view topic = endpoint->topic;
      if (topic.starts_with("rt/")) {
        found.insert({std::string(topic.substr(2)), ros_type(endpoint->type)});
      }
    }
    if (num > 0) api.return_loan(reader.get(), samples, num);
    if (num < static_cast<int>(kMaxSamples)) return {found.begin(), found.end()};
  }
}

}  // namespace

Result<RosNodeOptions> RosNodeOptions::of_environment() {
  constexpr int kMaxDomains = 232;  // ports end there
  RosNodeOptions options;
  const std::string domain = environment("ROS_DOMAIN_ID");
  const auto [end, error] =
      std::from_chars(domain.data(), domain.data() + domain.size(), options.domain);
  if (!domain.empty() && (error != std::errc() || end != domain.data() + domain.size() ||
                          options.domain < 0 || options.domain > kMaxDomains)) {
    return Error{Errc::invalid_argument, "ROS_DOMAIN_ID is '" + domain.substr(0, 20) +
                                             "'; it must be a number from 0 to 232"};
  }
  options.is_local = environment("ROS_LOCALHOST_ONLY") == "1" ||
                     environment("ROS_AUTOMATIC_DISCOVERY_RANGE") == "LOCALHOST";
  return options;
}

Result<std::shared_ptr<RosNode>> RosNode::join(const RosNodeOptions& options) {
  static std::mutex mutex;
  static auto& nodes = *new std::vector<std::pair<RosNodeOptions, std::weak_ptr<RosNode>>>;
  const std::lock_guard lock(mutex);
  std::erase_if(nodes, [](const auto& each) { return each.second.expired(); });
  for (const auto& [theirs, node] : nodes) {
    if (const auto there = node.lock(); there && theirs == options) return there;
  }
  auto node = Node::create(options);
  if (node) nodes.emplace_back(options, *node);
  return node;
}

Result<std::shared_ptr<RosNode>> RosNode::join() {
  const auto options = RosNodeOptions::of_environment();
  if (!options) return options.error();
  return join(*options);
}

std::string full_topic(const std::string& topic, const std::string& node_namespace) {
  if (topic.starts_with("/")) return topic;
  return node_namespace + (node_namespace.ends_with("/") ? "" : "/") + topic;
}

Status check_topic(const std::string& full_topic) {
  const auto is_digit = [](char letter) { return letter >= '0' && letter <= '9'; };
  const auto is_name = [&](char letter) {
    return is_digit(letter) || letter == '_' || (letter >= 'a' && letter <= 'z') ||
           (letter >= 'A' && letter <= 'Z');
  };
  bool is_good = full_topic.starts_with('/') && !full_topic.ends_with('/');
  for (std::size_t i = 1; i < full_topic.size(); ++i) {
    const char letter = full_topic[i];
    const bool begins = full_topic[i - 1] == '/';
    is_good = is_good &&
              (begins ? is_name(letter) && !is_digit(letter) : is_name(letter) || letter == '/');
  }
  if (is_good) return Done{};
  return Error{Errc::invalid_argument,
               "no ROS topic can be called '" + full_topic.substr(0, 60) +
                   "': give letters, digits and _ between single /, no part with a digit first, "
                   "e.g. /camera/depth/image_raw"};
}

}}  // namespace palpate::v0
