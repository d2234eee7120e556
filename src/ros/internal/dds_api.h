// The functions of Cyclone DDS that Palpate calls, with declarations of our own: it is not needed
// to build. Only functions of its public header dds.h; numbers as there, the same from 0.10 to 11.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 { namespace dds {

using Entity = std::int32_t;  // above 0; else the error's number
using Status = std::int32_t;  // likewise
struct Qos;

inline constexpr std::int64_t kMillisecond = 1'000'000;  // ns
inline constexpr std::int32_t kBestEffort = 0, kReliable = 1;
inline constexpr std::int32_t kVolatile = 0, kTransientLocal = 1;
inline constexpr std::int32_t kKeepLast = 0;
inline constexpr std::int16_t kXcdr1 = 0;
inline constexpr std::uint32_t kAnyState = 127;
inline constexpr Entity kPublications = 0x7fff0003;  // a topic of Cyclone's own

/// Opcodes that describe the layout of messages in memory (dds_opcodes.h).
enum Op : std::uint32_t { kReturn = 0, kAddress = 1u << 24 };
enum Type : std::uint32_t {
  k1Byte = 1,
  k2Bytes = 2,
  k4Bytes = 3,
  k8Bytes = 4,
  kString = 5,
  kSequence = 7,
  kArray = 8,
  kStruct = 10,
};

struct TypeMeta {
  unsigned char* data = nullptr;
  std::uint32_t size = 0;
};
struct TopicDescriptor {
  std::uint32_t size = 0, align = 8, flags = 0, num_keys = 0;
  const char* type_name = nullptr;
  const void* keys = nullptr;
  std::uint32_t num_ops = 0;
  const std::uint32_t* ops = nullptr;
  const char* meta = "";
  TypeMeta information, mapping;
  std::uint32_t representations = 0;
};

struct Sequence {
  std::uint32_t maximum = 0, length = 0;
  void* buffer = nullptr;
  bool is_released = false;
};

struct SampleInfo {
  std::uint32_t sample_state, view_state, instance_state;
  bool has_data;
  std::int64_t source_time;  // ns since 1970
  std::uint64_t instance, publication;
  std::uint32_t ranks[5];
};

struct Guid {
  std::uint8_t bytes[16];
};

struct Endpoint {
  Guid key, participant;
  std::uint64_t participant_instance;
  char *topic, *type;
  Qos* qos;
};

struct Api {
  std::string path, version;

  const char* (*error_text)(Status);
  Entity (*create_domain)(std::uint32_t domain, const char* config);
  Entity (*create_participant)(std::uint32_t domain, const Qos*, const void* listener);
  Entity (*create_topic)(Entity participant, const TopicDescriptor*, const char* name, const Qos*,
                         const void* listener);
  Entity (*create_writer)(Entity participant, Entity topic, const Qos*, const void* listener);
  Entity (*create_reader)(Entity participant, Entity topic, const Qos*, const void* listener);
  Status (*remove)(Entity);
  Status (*write)(Entity writer, const void* sample);
  Status (*take)(Entity reader, void** samples, SampleInfo*, std::size_t size, std::uint32_t max);
  Status (*read)(Entity reader, void** samples, SampleInfo*, std::size_t size, std::uint32_t max);
  Status (*return_loan)(Entity reader, void** samples, std::int32_t size);
  Entity (*create_waitset)(Entity participant);
  Status (*attach)(Entity waitset, Entity, std::intptr_t);
  Status (*wait)(Entity waitset, std::intptr_t* triggered, std::size_t size, std::int64_t timeout);
  Entity (*create_read_condition)(Entity reader, std::uint32_t mask);
  Entity (*create_guard_condition)(Entity participant);
  Status (*set_guard_condition)(Entity, bool);
  Status (*get_guid)(Entity, Guid*);
  Status (*matched_writers)(Entity reader, std::uint64_t* handles, std::size_t size);
  Status (*matched_readers)(Entity writer, std::uint64_t* handles, std::size_t size);
  Qos* (*create_qos)();
  void (*delete_qos)(Qos*);
  void (*set_reliability)(Qos*, std::int32_t kind, std::int64_t max_blocking);
  void (*set_durability)(Qos*, std::int32_t kind);
  void (*set_history)(Qos*, std::int32_t kind, std::int32_t depth);
  void (*set_user_data)(Qos*, const void* data, std::size_t size);
  void (*set_representation)(Qos*, std::uint32_t num, const std::int16_t*);
};

/// Returns the functions, loaded once. Error: no Cyclone DDS, every path tried, what to do.
const Result<Api>& api();

}}}  // namespace palpate::v0::dds
