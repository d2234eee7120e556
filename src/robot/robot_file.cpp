// The packed robot (.palprobot), little endian: a header, then links and joints in their order,
// each number as 8 bytes and each text or tool file behind its length; and XXH3-64 of all before
// it.
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <utility>

#include "palpate/io/files.h"
#include "src/core/internal/message_text.h"
#include "src/io/internal/hashes.h"
#include "src/robot/robot_data.h"

namespace palpate { inline namespace v0 {
namespace {

static_assert(std::endian::native == std::endian::little, "packed robots are little endian");

constexpr std::string_view kMagic{"\x89PALPROBOT\r\n\x1a\n\0", 15}, kToolMagic{"\x89PALP\r\n\x1a"};
constexpr std::uint64_t kVersion = 1;
constexpr std::size_t kChecksum = 8;
constexpr std::uint64_t kMaxParts = 4000;  // links, joints and notes

class RobotWriter {
 public:
  RobotWriter() : bytes_(kMagic) { put(kVersion); }

  template <class T>
  void put(T number) {
    static_assert(sizeof(T) == 8);
    bytes_.append(reinterpret_cast<const char*>(&number), sizeof number);
  }
  void put(const Vec3d& v) {
    for (int axis = 0; axis < 3; ++axis) put(v[axis]);
  }
  void put(const Quaternion& q) {
    for (const double number : {q.x, q.y, q.z, q.w}) put(number);
  }
  void put(const std::string& text) {
    put(std::uint64_t(text.size()));
    bytes_ += text;
  }
  std::string finish() {
    if (bytes_.size() < kMinXxh3Bytes) bytes_.resize(kMinXxh3Bytes);
    put(xxh3_of_long(bytes_));
    return std::move(bytes_);
  }

 private:
  std::string bytes_;
};

/// Reads what the writer wrote. After the end, or a count that is too large, it is bad, and all is
/// zero and empty.
class RobotReader {
 public:
  explicit RobotReader(std::string_view bytes) : rest_(bytes) {}

  bool is_good() const { return is_good_; }
  template <class T = std::uint64_t>
  T number() {
    static_assert(sizeof(T) == 8);
    T value{};
    const std::string_view bytes = take(sizeof value);
    if (is_good_) std::memcpy(&value, bytes.data(), sizeof value);
    return value;
  }
  std::uint64_t count(std::uint64_t most) {
    const auto value = number();
    is_good_ = is_good_ && value <= most;
    return is_good_ ? value : 0;
  }
  std::string_view text() { return take(number()); }
  Vec3d vector() {
    const auto x = number<double>(), y = number<double>(), z = number<double>();
    return {x, y, z};
  }
  Pose pose() {
    const Vec3d p = vector(), q = vector();
    return {p, {q.x, q.y, q.z, number<double>()}};
  }

 private:
  std::string_view take(std::uint64_t size) {
    is_good_ = is_good_ && size <= rest_.size();
    if (!is_good_) return {};
    const std::string_view taken = rest_.substr(0, size);
    rest_.remove_prefix(size);
    return taken;
  }

  std::string_view rest_;
  bool is_good_ = true;
};

Error damaged(const std::string& how) {
  return {Errc::bad_input, "is damaged: " + how + "; copy it again or pack the robot again"};
}

/// Reads a joint whose parent is one of the links that are placed already.
bool read_joint(RobotReader& reader, std::vector<bool>& is_placed, std::size_t num_joints,
                RobotJoint& joint) {
  joint.name = reader.text();
  joint.kind = static_cast<RobotJoint::Kind>(reader.count(3));
  joint.is_endless = reader.count(1) == 1;
  joint.parent = reader.number();
  joint.child = reader.number();
  joint.X_PJ = reader.pose();
  joint.axis = reader.vector();
  joint.source = reader.number();
  joint.factor = reader.number<double>();
  joint.offset = reader.number<double>();
  joint.lower = reader.number<double>();
  joint.upper = reader.number<double>();
  const std::size_t num_links = is_placed.size();
  if (!reader.is_good() || joint.parent >= num_links || joint.child >= num_links ||
      joint.source >= num_joints || !is_placed[joint.parent] || is_placed[joint.child]) {
    return false;
  }
  is_placed[joint.child] = true;
  const Quaternion& q = joint.X_PJ.rotation;
  const double length = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w;
  return is_finite(joint.X_PJ) && std::abs(length - 1) < 1e-6 &&
         std::abs(norm(joint.axis) - 1) < 1e-6 && std::isfinite(joint.factor + joint.offset);
}

}  // namespace

Result<std::string> Robot::to_bytes() const {
  const RobotModel& model = data_->model;
  RobotWriter writer;
  writer.put(model.name);
  writer.put(std::uint64_t(model.notes.size()));
  for (const std::string& note : model.notes) writer.put(note);
  writer.put(std::uint64_t(model.root));
  writer.put(std::uint64_t(model.links.size()));
  for (std::size_t i = 0; i < model.links.size(); ++i) {
    writer.put(model.links[i].name);
    writer.put(data_->standoffs[i]);
    std::string tool;
    if (data_->tools[i] != nullptr) {
      auto bytes = tool_to_bytes(*data_->tools[i]);
      if (!bytes) return bytes.error();
      tool = *std::move(bytes);
    }
    writer.put(tool);
  }
  writer.put(std::uint64_t(model.joints.size()));
  for (const RobotJoint& joint : model.joints) {
    writer.put(joint.name);
    writer.put(std::uint64_t(joint.kind));
    writer.put(std::uint64_t(joint.is_endless));
    writer.put(std::uint64_t(joint.parent));
    writer.put(std::uint64_t(joint.child));
    writer.put(joint.X_PJ.translation);
    writer.put(joint.X_PJ.rotation);
    writer.put(joint.axis);
    writer.put(std::uint64_t(joint.source));
    for (const double number : {joint.factor, joint.offset, joint.lower, joint.upper}) {
      writer.put(number);
    }
  }
  return writer.finish();
}

Result<Robot> Robot::from_bytes(std::string_view bytes) {
  if (bytes.starts_with(kToolMagic)) {
    return Error{Errc::bad_input,
                 "is a tool, not a robot; make a robot with 'palpate pack --robot FILE.urdf'"};
  }
  if (!bytes.starts_with(kMagic)) {
    return Error{
        Errc::bad_input,
        "is neither a URDF (.urdf) nor a packed robot; make one with 'palpate pack --robot "
        "FILE.urdf'"};
  }
  if (bytes.size() < kMinXxh3Bytes + kChecksum) return damaged("it is truncated");
  const std::string_view body = bytes.substr(0, bytes.size() - kChecksum);
  std::uint64_t checksum = 0;
  std::memcpy(&checksum, bytes.data() + body.size(), kChecksum);
  if (checksum != xxh3_of_long(body)) return damaged("its checksum does not match");
  RobotReader reader(body.substr(kMagic.size()));
  if (const auto version = reader.number(); version != kVersion) {
    return Error{Errc::bad_input, "has format version " + std::to_string(version) +
                                      ", this program reads " + std::to_string(kVersion) +
                                      "; pack the robot again"};
  }
  Data data;
  RobotModel& model = data.model;
  model.name = reader.text();
  for (auto num = reader.count(kMaxParts); num > 0; --num) {
    model.notes.emplace_back(reader.text());
  }
  model.root = reader.number();
  const auto num_links = reader.count(kMaxParts);
  for (std::uint64_t i = 0; i < num_links && reader.is_good(); ++i) {
    model.links.push_back({std::string(reader.text()), {}});
    data.standoffs.push_back(reader.number<double>());
    data.tools.emplace_back();
    if (!(data.standoffs.back() >= 0 && data.standoffs.back() < 1e6)) return damaged("a standoff");
    const std::string_view stored = reader.text();
    if (stored.empty()) continue;
    auto tool = tool_from_bytes(stored);
    if (!tool) {
      return Error{Errc::bad_input, "holds link '" + shown(model.links.back().name) + "', which " +
                                        tool.error().message};
    }
    data.tools.back() = std::make_shared<const Tool>(*std::move(tool));
  }
  const auto num_joints = reader.count(kMaxParts);
  if (!reader.is_good() || model.root >= num_links || num_joints + 1 != num_links) {
    return damaged("its links and joints are no tree");
  }
  std::vector<bool> is_placed(num_links);
  is_placed[model.root] = true;
  model.joints.resize(num_joints);
  for (RobotJoint& joint : model.joints) {
    if (!read_joint(reader, is_placed, num_joints, joint))
      return damaged("a joint is out of range");
  }
  for (const RobotJoint& joint : model.joints) {
    if (model.joints[joint.source].source != joint.source)
      return damaged("joints follow in a chain");
  }
  auto robot = Data::complete(std::move(data), "");
  if (!robot) return Error{Errc::bad_input, "holds a bad robot" + robot.error().message};
  return robot;
}

}}  // namespace palpate::v0
