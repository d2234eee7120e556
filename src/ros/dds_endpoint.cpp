#include "src/ros/dds_endpoint.h"

#include <algorithm>
#include <iterator>
#include <map>
#include <mutex>

namespace palpate { inline namespace v0 {
namespace {

const DdsType& dds_type(const std::string& type) {
  static std::mutex mutex;
  static auto& types = *new std::map<std::string, DdsType>;
  const std::lock_guard lock(mutex);
  return types.try_emplace(type, type).first->second;
}

QosPointer make_qos(const RosQos& desired, std::string_view user_data) {
  const dds::Api& api = *dds::api();
  QosPointer qos(api.create_qos());
  // Writers do not wait for readers: with so few messages kept there is always room.
  api.set_reliability(qos.get(), desired.is_reliable ? dds::kReliable : dds::kBestEffort, 0);
  api.set_durability(qos.get(), desired.is_kept ? dds::kTransientLocal : dds::kVolatile);
  api.set_history(qos.get(), dds::kKeepLast, desired.depth);
  api.set_user_data(qos.get(), user_data.data(), user_data.size());
  api.set_representation(qos.get(), 1, &dds::kXcdr1);
  return qos;
}

}  // namespace

Error dds_error(const std::string& what, dds::Entity code) {
  return {Errc::unavailable, what + ": Cyclone DDS says " + dds::api()->error_text(code)};
}

RosGid DdsEndpoint::gid() const {
  dds::Guid guid{};
  dds::api()->get_guid(endpoint.get(), &guid);
  RosGid gid{};
  std::copy(std::begin(guid.bytes), std::end(guid.bytes), gid.begin());
  return gid;
}

Result<DdsEndpoint> make_endpoint(const DdsEntity& participant, const std::string& name,
                                  const std::string& type, const RosQos& desired, bool is_writer) {
  const dds::Api& api = *dds::api();
  DdsEndpoint made;
  made.type = &dds_type(type);
  made.topic = DdsEntity(
      api.create_topic(participant.get(), &made.type->descriptor, name.c_str(), nullptr, nullptr));
  if (!made.topic.is_good()) return dds_error("cannot open the topic " + name, made.topic.get());
  const QosPointer qos = make_qos(desired, made.type->hash);
  const auto create = is_writer ? api.create_writer : api.create_reader;
  made.endpoint = DdsEntity(create(participant.get(), made.topic.get(), qos.get(), nullptr));
  if (!made.endpoint.is_good()) {
    return dds_error(std::string("cannot ") + (is_writer ? "write to " : "read from ") + name,
                     made.endpoint.get());
  }
  return made;
}

bool write(const DdsEndpoint& writer, std::string_view message) {
  const auto native = writer.type->layout.to_native(message);
  return native && dds::api()->write(writer.endpoint.get(), native->get()) == 0;
}

}}  // namespace palpate::v0
