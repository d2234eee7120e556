// Writers and readers of DDS for topics of ROS 2: their entities, which live as long as their
// owner, and the types of their messages, which Cyclone DDS knows by description.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "src/io/internal/ros_messages.h"
#include "src/io/internal/ros_types.h"
#include "src/ros/internal/dds_api.h"
#include "src/ros/internal/ros_node.h"
#include "src/ros/native_layout.h"

namespace palpate { inline namespace v0 {

/// A type as Cyclone DDS knows it, for as long as the program runs.
struct DdsType {
  explicit DdsType(const std::string& type)
      : layout(type),
        program(layout.program()),
        name(dds_type_name(type)),
        hash("typehash=" + ros_type_hash(type) + ";") {
    descriptor.size = static_cast<std::uint32_t>(layout.size());
    descriptor.align = static_cast<std::uint32_t>(layout.align());
    descriptor.type_name = name.c_str();
    descriptor.num_ops = static_cast<std::uint32_t>(program.size());
    descriptor.ops = program.data();
  }

  const NativeLayout layout;
  const std::vector<std::uint32_t> program;
  const std::string name, hash;
  dds::TopicDescriptor descriptor;
};

/// Owns an entity of DDS.
class DdsEntity {
 public:
  explicit DdsEntity(dds::Entity entity = 0) : entity_(entity) {}
  DdsEntity(DdsEntity&& other) noexcept : entity_(std::exchange(other.entity_, 0)) {}
  DdsEntity& operator=(DdsEntity&& other) noexcept {
    std::swap(entity_, other.entity_);
    return *this;
  }
  ~DdsEntity() {
    if (entity_ > 0) dds::api()->remove(entity_);
  }
  dds::Entity get() const { return entity_; }
  bool is_good() const { return entity_ > 0; }

 private:
  dds::Entity entity_;
};

/// Returns the error that Cyclone DDS gives instead of an entity.
Error dds_error(const std::string& what, dds::Entity code);

struct QosDeleter {
  void operator()(dds::Qos* qos) const { dds::api()->delete_qos(qos); }
};
using QosPointer = std::unique_ptr<dds::Qos, QosDeleter>;

/// A topic with its writer or reader.
struct DdsEndpoint {
  DdsEntity topic, endpoint;  // in this order: the endpoint is destroyed first
  const DdsType* type = nullptr;

  /// Returns the identity of the endpoint in the graph.
  RosGid gid() const;
};

/// Makes the writer or reader of a topic, by its name in DDS. Errors: what Cyclone DDS says.
Result<DdsEndpoint> make_endpoint(const DdsEntity& participant, const std::string& name,
                                  const std::string& type, const RosQos& desired, bool is_writer);
/// Writes a message; false: it is damaged, or was not sent.
bool write(const DdsEndpoint& writer, std::string_view message);

}}  // namespace palpate::v0
