// The handles of the C header, and how errors leave: as a kind and one sentence.
#pragma once

#include <algorithm>
#include <array>
#include <cstring>
#include <exception>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/c/palpate.h"
#include "palpate/contact/scene.h"
#include "palpate/core/core.h"
#include "palpate/settings/setting_table.h"
#include "palpate/tool/tool.h"

struct palpate_tool {
  palpate::Tool tool;
};

struct palpate_sensor {
  palpate::Sensor sensor;
  int width, height;
  palpate::SurfaceView newest, before;
  bool has_surface = false;
};

struct palpate_scene {
  std::vector<const palpate_sensor*> sensors;
  std::vector<palpate::Body> bodies;

  /// Returns the scene with the newest surfaces, or those before.
  palpate::Scene at(bool newest) const {
    palpate::Scene scene;
    for (const palpate_sensor* sensor : sensors)
      scene.surfaces.push_back(newest ? sensor->newest : sensor->before);
    scene.bodies = bodies;
    return scene;
  }
};

namespace palpate { inline namespace v0 {

/// Copies a text, cut at the end if it is longer, but not inside a letter of UTF-8.
inline void copy_text(std::string_view from, char* to, std::size_t size) {
  std::size_t length = from.size();
  if (length >= size) {
    length = size - 1;
    while (length > 0 && (from[length] & 0xC0) == 0x80) --length;
  }
  std::memcpy(to, from.data(), length);
  to[length] = '\0';
}

/// Writes an error for the caller. Returns PALPATE_FAILED.
inline int fail(palpate_error* to, const Error& error) {
  if (to == nullptr) return PALPATE_FAILED;
  to->code = static_cast<std::int32_t>(error.code) + 1;
  copy_text(error.message, to->text, sizeof to->text);
  return PALPATE_FAILED;
}
inline int fail(palpate_error* to, const char* message) {
  return fail(to, Error{Errc::invalid_argument, message});
}

/// Returns what `work` returns; `failed` if the machine has no memory or threads for it.
template <class Value, class Work>
Value guarded_call(palpate_error* error, Value failed, const Work& work) noexcept {
  if (error != nullptr) *error = {};
#if defined(__cpp_exceptions)
  try {
    return work();
  } catch (const std::exception&) {
    if (error != nullptr) {
      constexpr char kText[] =
          "there is too little memory, or there are too few threads: give a smaller mesh, fewer "
          "spheres, a smaller image or fewer threads";
      error->code = PALPATE_UNAVAILABLE;
      copy_text(kText, error->text, sizeof error->text);
    }
    return failed;
  }
#else
  static_cast<void>(failed);
  return work();
#endif
}

/// Tells whether a struct of the caller is there and has more than its size.
template <class Struct>
bool is_given(const Struct* from) {
  return from != nullptr && from->size > sizeof from->size;
}
/// Copies what the caller's version of a given struct has room for. Both begin with the size.
template <class Struct>
void give(const Struct& from, Struct* to) {
  constexpr std::size_t kSize = sizeof from.size;
  std::memcpy(reinterpret_cast<char*>(to) + kSize, reinterpret_cast<const char*>(&from) + kSize,
              std::min<std::size_t>(to->size, sizeof from) - kSize);
}
/// Returns what the caller's version of a struct has, and zeros for what it does not know.
template <class Struct>
Struct taken(const Struct* from) {
  Struct all{};
  std::memcpy(&all, from, std::min<std::size_t>(from->size, sizeof all));
  return all;
}

inline Vec3d vector_of(const double* v) { return {v[0], v[1], v[2]}; }
inline void put(const Vec3d& v, double* to) { to[0] = v.x, to[1] = v.y, to[2] = v.z; }
inline Pose pose_of(const palpate_pose& X) {
  return {vector_of(X.translation), {X.rotation[0], X.rotation[1], X.rotation[2], X.rotation[3]}};
}
inline palpate_pose c_pose(const Pose& X) {
  return {{X.translation.x, X.translation.y, X.translation.z},
          {X.rotation.x, X.rotation.y, X.rotation.z, X.rotation.w}};
}
static_assert(sizeof(palpate_pose) == sizeof(Pose));

/// Reads "section.key = value; ..." into settings, null as nothing. Errors: a part without '=', and
/// as SettingTable::set.
Status read_settings(const char* text, SettingTable& table);
template <class... Options>
Status read_options(const char* text, Options&... options) {
  SettingTable table;
  (add_settings(table, options), ...);
  return read_settings(text, table);
}

}}  // namespace palpate::v0
