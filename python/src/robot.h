// palpate.Robot, and its configurations in host memory or on a GPU.
#pragma once

#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "palpate/robot/robot.h"
#include "python/src/arrays.h"

namespace palpate::python {

/// Class palpate.Robot: one robot, its base, and what measures it.
class PyRobot {
 public:
  PyRobot(Robot robot, const Pose& base, const Place& where, int threads)
      : X_WB(base),
        robot_(std::move(robot)),
        place_(where),
        threads_(threads),
        contact_(taken(RobotContact::create(robot_, where, threads))) {}

  const Robot& robot() const { return robot_; }
  const Place& place() const { return place_; }
  int threads() const { return threads_; }
  /// One thread at a time; without the GIL.
  template <class Work>
  Status alone(const Work& work) {
    const nb::gil_scoped_release no_gil;
    const std::lock_guard lock(mutex_);
    return work(contact_);
  }

  Pose X_WB;

 private:
  Robot robot_;
  Place place_;
  int threads_;
  RobotContact contact_;
  std::mutex mutex_;
};

template <class Array>
void check_shape(const PyRobot& self, const Array& joints, const char* name) {
  const std::size_t n = self.robot().joints().size();
  if (joints.ndim() >= 1 && joints.ndim() <= 2 && joints.shape(joints.ndim() - 1) == n) return;
  refuse_shape(name, shape_of(joints),
               ("(P, " + std::to_string(n) + "), a number for each of Robot.joint_names").c_str());
}

/// (P, n) or (n,) positions in host memory.
inline Doubles joints_of(const PyRobot& self, nb::handle given, const char* name) {
  const Doubles joints = doubles_of(given, name);
  check_shape(self, joints, name);
  return joints;
}

/// Configurations in host memory or on a GPU, and the arrays that keep them.
struct GivenJoints {
  GivenJoints(const PyRobot& self, nb::handle given, const std::string& limits) {
    if (limits != "hold" && limits != "refuse") {
      throw nb::value_error(("limits: '" + limits + "' is not hold or refuse").c_str());
    }
    if (const std::optional<AnyArray> array = array_on_gpu(given, "joints", nb::none())) {
      there = *array;
      check_shape(self, there, "joints");
      require_dense(there, "joints", nb::dtype<double>());
      poses.joints = {static_cast<const double*>(there.data()), there.size()};
      poses.gpu = there.device_id();
    } else {
      here = joints_of(self, given, "joints");
      poses.joints = {here.data(), here.size()};
    }
    poses.X_WB = self.X_WB;
    poses.refuses_beyond_limits = limits == "refuse";
    num = poses.joints.size() / self.robot().joints().size();
  }
  /// Waits for what still writes them.
  Status wait() const {
    return poses.gpu == kHostMemory ? Done{} : wait_for_producers(poses.gpu, {});
  }

  Doubles here;
  AnyArray there;
  RobotPoses poses;
  std::size_t num = 0;
};

}  // namespace palpate::python
