#include "python/src/run_in_thread.h"

#include <chrono>
#include <limits>
#include <utility>

#include "src/core/internal/guarded.h"

namespace palpate::python {
namespace {
constexpr double kLook = 0.05;  // s between two looks at Ctrl-C
}

RunInThread::RunInThread(RunRequest request) : request_(std::move(request)) {
  monitor_.observer.on_ticks = [this](std::span<const TickRecord> ticks) { hear(ticks); };
  request_.options.monitor = &monitor_;
  request_.options.keep_going = [this] { return !is_stopping_.load(); };
  request_.options.say = [this](double, std::string_view text) {
    const std::lock_guard lock(mutex_);
    notes_.emplace_back(text);
  };
  thread_ = std::thread([this] {
    guarded([&] { run(); },
            [&](const Error& error) {
              const std::lock_guard lock(mutex_);
              error_ = error;
            });
    finish();
  });
}

// Closes cameras and the device. Releasing on_tick may destroy this object.
void RunInThread::finish() {
  std::vector<std::shared_ptr<DepthSource>> sources;
  {
    const std::lock_guard lock(mutex_);
    sources.swap(request_.sources);
  }
  sources.clear();
  request_.device.reset();
  const nb::gil_scoped_acquire gil;
  // on_tick may refer to the run: a cycle that Python's garbage collector does not see.
  const nb::object on_tick = std::exchange(request_.on_tick, nb::object());
  const std::lock_guard lock(mutex_);
  has_ended_ = true;
  changed_.notify_all();
}

void RunInThread::wait_for_ticks() {
  bool is_there = false;
  while (!is_there) {
    {
      const nb::gil_scoped_release no_gil;
      is_there = wait_without_gil(kLook, true);
    }
    if (is_interrupted()) throw nb::python_error();
  }
  if (has_ended_ && !latest()) raise_what_went_wrong();
}

RunInThread::~RunInThread() {
  is_stopping_ = true;
  if (thread_.get_id() == std::this_thread::get_id()) {  // see finish
    thread_.detach();
    return;
  }
  const nb::gil_scoped_release no_gil;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& source : request_.sources) source->cancel();
  }
  thread_.join();
}

void RunInThread::run() {
  RunRequest& r = request_;
  std::vector<DepthSource*> sources;
  for (const auto& source : r.sources) sources.push_back(source.get());
  auto outcome = record_run(*r.tool.tool, DepthSources(std::move(sources)), *r.device, r.settings,
                            r.folder, r.options);
  const std::lock_guard lock(mutex_);
  if (!outcome) {
    error_ = outcome.error();
  } else {
    notes_.insert(notes_.end(), outcome->warnings.begin(), outcome->warnings.end());
    const std::string& what = outcome->failure.empty() ? outcome->not_kept : outcome->failure;
    if (!what.empty()) error_ = Error{Errc::unavailable, what};
  }
}

void RunInThread::hear(std::span<const TickRecord> ticks) {
  if (ticks.empty()) return;
  {
    const std::lock_guard lock(mutex_);
    if (!latest_) changed_.notify_all();
    latest_ = ticks.back();
  }
  if (request_.on_tick.is_none()) return;
  const nb::gil_scoped_acquire gil;
  if (raised_.is_valid()) return;
  try {
    for (const TickRecord& tick : ticks) {
      if (request_.on_tick(PyTick{tick}).is(nb::bool_(false))) is_stopping_ = true;
    }
  } catch (nb::python_error& error) {
    raised_ = nb::borrow(error.value());
    is_stopping_ = true;
  } catch (const std::exception& error) {
    is_stopping_ = true;
  }
}

bool RunInThread::wait_without_gil(double seconds, bool until_ticking) {
  std::unique_lock lock(mutex_);
  const auto is_there = [&] { return has_ended_ || (until_ticking && latest_); };
  if (seconds > 1e6) {
    changed_.wait(lock, is_there);
    return true;
  }
  return changed_.wait_for(lock, std::chrono::duration<double>(seconds), is_there);
}

bool RunInThread::wait(std::optional<double> seconds) {
  double left = seconds.value_or(std::numeric_limits<double>::infinity());
  bool is_over = false;
  while (!is_over && left > 0) {
    {
      const nb::gil_scoped_release no_gil;
      is_over = wait_without_gil(std::min(left, kLook), false);
    }
    left -= kLook;
    if (!is_interrupted()) continue;
    nb::python_error interruption;
    stop();
    {
      const nb::gil_scoped_release no_gil;
      wait_without_gil(std::numeric_limits<double>::infinity(), false);
    }
    throw interruption;
  }
  if (is_over || has_ended_) raise_what_went_wrong();
  return has_ended_;
}

void RunInThread::raise_what_went_wrong() {
  nb::object raised = std::exchange(raised_, nb::object());
  if (!raised.is_valid() && request_.raised_by_device != nullptr) {
    raised = std::exchange(*request_.raised_by_device, nb::object());
  }
  if (raised.is_valid()) {
    PyErr_SetObject(raised.type().ptr(), raised.ptr());
    throw nb::python_error();
  }
  if (error_) {
    const Error error = *std::exchange(error_, std::nullopt);
    raise(error);
  }
}

std::optional<TickRecord> RunInThread::latest() const {
  const std::lock_guard lock(mutex_);
  return latest_;
}

std::vector<std::string> RunInThread::notes() const {
  const std::lock_guard lock(mutex_);
  return notes_;
}

}  // namespace palpate::python
