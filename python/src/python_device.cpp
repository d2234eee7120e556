#include "python/src/python_device.h"

#include <cmath>

#include "palpate/devices/devices.h"
#include "src/devices/internal/polling_device.h"
#include "src/devices/internal/twist_between.h"

namespace palpate::python {
namespace {

double number_of(nb::handle object, const char* name, double otherwise, double least) {
  const nb::object given = nb::getattr(object, name, nb::none());
  if (given.is_none()) return otherwise;
  double number = NAN;
  if (!nb::try_cast<double>(given, number) || !(number >= least && number <= 1e6)) {
    throw PalpateError(std::string("the device's ") + name + " has to be a number from " +
                       std::to_string(least) + " to 1000000");
  }
  return number;
}

DeviceInfo info_of(nb::handle object) {
  DeviceInfo info;
  info.kind = "python";
  info.name =
      nb::cast<std::string>(nb::str(nb::getattr(object, "name", object.type().attr("__name__"))));
  DeviceLimits& limits = info.limits;
  limits = device_models().front().limits;
  limits.max_force = number_of(object, "max_force", limits.max_force, 0);
  limits.max_torque = number_of(object, "max_torque", limits.max_torque, 0);
  limits.max_stiffness = number_of(object, "max_stiffness", limits.max_stiffness, 0);
  limits.max_angular_stiffness =
      number_of(object, "max_angular_stiffness", limits.max_angular_stiffness, 0);
  limits.max_damping = number_of(object, "max_damping", limits.max_damping, 0);
  limits.workspace_radius = number_of(object, "workspace_radius", limits.workspace_radius, 1e-3);
  limits.damping = number_of(object, "damping", limits.damping, 0);
  limits.angular_damping = number_of(object, "angular_damping", limits.angular_damping, 0);
  info.rate = number_of(object, "rate", info.rate, 1);
  info.num_buttons = 32;
  return info;
}

class PolledInPython final : public PolledDevice {
 public:
  PolledInPython(nb::handle object, std::shared_ptr<nb::object> raised)
      : read_(object.attr("read")), write_(object.attr("write")), raised_(std::move(raised)) {
    info_ = info_of(object);
  }

  ~PolledInPython() override {
    const nb::gil_scoped_acquire gil;
    read_.reset();
    write_.reset();
    raised_.reset();
  }

  Status begin() override { return Done{}; }

  bool read(DeviceState& state) noexcept override {
    const nb::gil_scoped_acquire gil;
    try {
      nb::object given = read_();
      state.is_valid = !given.is_none();
      if (!state.is_valid) return true;
      if (nb::isinstance<nb::tuple>(given) && nb::len(given) == 2) {
        state.buttons = nb::cast<std::uint32_t>(given[1]);
        given = given[0];
      }
      const Pose X_BH = pose_of(given, "what read() returned");
      if (!is_finite(X_BH)) throw nb::value_error("what read() returned is not finite");
      const double seconds = state.time - last_time_;
      const bool is_later = last_time_ > 0 && seconds > 0;
      state.V_BH = is_later ? twist_between(state.X_BH, X_BH, seconds) : Twist{};
      state.X_BH = X_BH;
      last_time_ = state.time;
      return true;
    } catch (nb::python_error& error) {
      return keep(error, "read()");
    } catch (const std::exception& error) {
      return fail("read()", error.what());
    }
  }

  bool write(const Wrench& F) noexcept override {
    const nb::gil_scoped_acquire gil;
    try {
      const auto& [f, t] = F;
      write_(array_of<double>({f.x, f.y, f.z, t.x, t.y, t.z}, {6}));
      return true;
    } catch (nb::python_error& error) {
      return keep(error, "write()");
    } catch (const std::exception& error) {
      return fail("write()", error.what());
    }
  }

  void end() noexcept override { write({}); }

 private:
  bool keep(nb::python_error& error, const char* where) {
    if (!raised_->is_valid()) *raised_ = nb::borrow(error.value());
    std::string text = "an exception without a text";
    try {
      text = nb::cast<std::string>(error.type().attr("__name__"));
      text += ": " + nb::cast<std::string>(nb::str(error.value()));
    } catch (const std::exception&) {
      PyErr_Clear();  // its __str__ raises, or gives what is no UTF-8
    }
    return fail(where, text);
  }
  bool fail(const char* where, const std::string& what) {
    if (trouble_.message.empty()) {
      trouble_ = {Errc::unavailable, info_.name + ", a device in Python: " + where + ": " + what};
    }
    return false;
  }

  nb::object read_, write_;
  std::shared_ptr<nb::object> raised_;
  double last_time_ = 0;
};

}  // namespace

PythonDevice make_python_device(nb::handle object) {
  for (const char* name : {"read", "write"}) {
    if (!nb::hasattr(object, name)) {
      throw nb::type_error(
          (std::string(
               "device: an object with read() and write(wrench) is taken; this one has no ") +
           name)
              .c_str());
    }
  }
  auto raised = std::make_shared<nb::object>();
  return {std::make_unique<PollingDevice>(std::make_unique<PolledInPython>(object, raised)),
          raised};
}

}  // namespace palpate::python
