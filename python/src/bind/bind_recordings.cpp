// Recordings as arrays, for palpate.Run.
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <optional>

#include "python/src/arrays.h"
#include "python/src/bindings.h"
#include "src/session/internal/run_fields.h"
#include "src/session/internal/run_reader.h"

namespace palpate::python {
namespace {

/// One array of doubles per number of a record, by its name in the recording: "tool.position.x".
class Columns {
 public:
  template <class Record>
  void add(Record& record) {
    next_ = 0;
    visit("", record);
    ++num_rows_;
  }

  nb::dict arrays() && {
    nb::dict all;
    for (auto& [name, values] : columns_) {
      values.resize(num_rows_, NAN);
      all[nb::str(name.c_str())] = array_of(std::move(values), {num_rows_});
    }
    return all;
  }

 private:
  template <class T>
  void visit(const std::string& name, T& value) {
    if constexpr (std::is_arithmetic_v<T> || std::is_enum_v<T>) {
      append(name, static_cast<double>(value));
    } else if constexpr (std::same_as<T, CameraBlends> || std::same_as<T, BodyPoses>) {
      for (std::uint32_t k = 0; k < value.num; ++k) {
        visit(name + "." + std::to_string(k), value.of[k]);
      }
    } else if constexpr (requires { value.has_value(); }) {
      if (value) visit(name, *value);  // the last of a record: what lacks it has NaN there
    } else if constexpr (requires {
                           requires std::extent_v<decltype(value.m)>
                           == 6;
                         }) {
      for (int row = 0; row < 6; ++row) {
        for (int column = 0; column < 6; ++column) {
          append(name + "." + std::to_string(row) + std::to_string(column), value.m[row][column]);
        }
      }
    } else {
      visit_fields(value, [&](const char* member, auto& part) {
        visit(name.empty() ? std::string(member) : name + "." + member, part);
      });
    }
  }

  /// Adds a number to its column, which is the next one unless records differ in what they have.
  /// Rows before it that lack the number have NaN.
  void append(const std::string& name, double value) {
    if (next_ == columns_.size() || columns_[next_].first != name) {
      const auto known = std::ranges::find(columns_, name, &Column::first);
      next_ = static_cast<std::size_t>(known - columns_.begin());
      if (known == columns_.end()) columns_.emplace_back(name, std::vector<double>());
    }
    std::vector<double>& values = columns_[next_++].second;
    values.resize(num_rows_, NAN);
    values.push_back(value);
  }

  using Column = std::pair<std::string, std::vector<double>>;
  std::vector<Column> columns_;
  std::size_t next_ = 0, num_rows_ = 0;
};

struct Notes {
  std::vector<double> times;
  std::vector<std::string> texts;
};

/// Reads a recording except its images.
nb::dict read_recording(const std::filesystem::path& folder) {
  Columns ticks, contacts, frames;
  Notes notes;
  std::optional<std::uint64_t> last_tick, last_contact, last_frame;
  const auto is_new = [](std::optional<std::uint64_t>& last, std::uint64_t number) {
    if (last && number <= *last) return false;
    last = number;
    return true;
  };
  Status status = Done{};
  {
    const nb::gil_scoped_release no_gil;
    auto reader = RunReader::open(folder);
    if (!reader) status = reader.error();
    while (reader && status) {
      const auto message = reader->next();
      if (!message) status = message.error();
      if (!message || !*message) break;
      const auto& [topic, data, time] = **message;
      if (topic == kTickTopic) {
        auto tick = read_tick(data);
        if (!tick) status = tick.error();
        if (tick && is_new(last_tick, tick->number)) ticks.add(*tick);
      } else if (topic == kContactTopic) {
        auto contact = read_contact(data);
        if (!contact) status = contact.error();
        if (contact && is_new(last_contact, contact->number)) contacts.add(*contact);
      } else if (topic == kFrameTopic) {
        auto frame = read_frame(data);
        if (!frame) status = frame.error();
        if (frame && is_new(last_frame, frame->number)) frames.add(*frame);
      } else if (topic == kNoteTopic) {
        auto note = read_note(data);
        if (!note) status = note.error();
        if (note) {
          notes.times.push_back(static_cast<double>(time) * 1e-9);
          notes.texts.push_back(*note);
        }
      }
    }
  }
  check(status);
  nb::dict all;
  all["ticks"] = std::move(ticks).arrays();
  all["contacts"] = std::move(contacts).arrays();
  all["frames"] = std::move(frames).arrays();
  all["notes"] = nb::cast(notes.texts);
  return all;
}

RunReader opened(const std::filesystem::path& folder) {
  Result<RunReader> reader = Error{};
  {
    const nb::gil_scoped_release no_gil;
    reader = RunReader::open(folder);
  }
  return taken(std::move(reader));
}

PyTool tool_of_recording(const std::filesystem::path& folder) {
  auto reader = opened(folder);
  Result<Tool> tool = Error{};
  {
    const nb::gil_scoped_release no_gil;
    tool = reader.load_tools();
  }
  return {std::make_shared<const Tool>(taken(std::move(tool)))};
}

/// Class palpate.RecordedFrames: the images in sequence, for one thread or several.
class RecordedFrames {
 public:
  RecordedFrames(const std::filesystem::path& folder, std::uint32_t camera)
      : reader_(opened(folder)), camera_(camera) {
    const std::size_t num = reader_.setup().streams.size();
    if (camera_ >= num) {
      throw nb::value_error(
          ("camera: the run has " + std::to_string(num) + ", numbered from 0").c_str());
    }
  }

  PyCamera camera() const {
    const DepthStreamInfo& stream = reader_.setup().streams[camera_];
    PyCamera camera;
    camera.camera = {stream.width, stream.height, stream.intrinsics};
    camera.unit = stream.unit;
    return camera;
  }

  nb::tuple next() {
    RecordedDepth depth;
    Result<bool> got = false;
    {
      const nb::gil_scoped_release no_gil;
      const std::lock_guard lock(mutex_);
      do {
        got = reader_.next_frame(depth);
      } while (got && *got && depth.record.camera != camera_);
    }
    if (!taken(std::move(got))) throw nb::stop_iteration();
    const auto rows = static_cast<std::size_t>(depth.frame.height);
    const auto columns = static_cast<std::size_t>(depth.frame.width);
    return nb::make_tuple(depth.record.source_time,
                          array_of(std::move(depth.frame.pixels), {rows, columns}));
  }

 private:
  std::mutex mutex_;
  RunReader reader_;
  std::uint32_t camera_;
};

}  // namespace

void bind_recordings(nb::module_& m) {
  m.def("read_recording", read_recording, nb::arg("folder"),
        nb::sig("def read_recording(folder: str | os.PathLike[str]) -> dict[str, typing.Any]"),
        "ticks, contacts and frames as dictionaries of arrays, and notes.");
  m.def("recorded_tool", tool_of_recording, nb::arg("folder"), "The tool of a run.");
  nb::class_<RecordedFrames>(
      m, "RecordedFrames",
      R"(Iterates over the depth images of a camera of a run: time (s, of the source) and (H, W) uint16
counts.)")
      .def(nb::init<const std::filesystem::path&, std::uint32_t>(), nb::arg("folder"),
           nb::arg("camera") = 0)
      .def_prop_ro("camera", &RecordedFrames::camera)
      .def(
          "__iter__", [](nb::handle self) { return nb::borrow(self); },
          nb::sig("def __iter__(self) -> RecordedFrames"))
      .def("__next__", &RecordedFrames::next,
           nb::sig("def __next__(self) -> tuple[float, numpy.typing.NDArray[numpy.uint16]]"));
}

}  // namespace palpate::python
