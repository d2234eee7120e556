// Settings as keyword arguments, from the same tables as files and command line.
#pragma once

#include "palpate/settings/setting_table.h"
#include "python/src/arrays.h"

namespace palpate::python {

/// Sets the settings that the keywords name: "stiffness" if only one section has it,
/// "coupling_stiffness" or "coupling.stiffness". palpate.Error: an unknown name, with the nearest
/// one; those of Setting::set.
void apply(const nb::dict& keywords, SettingTable& table);

}  // namespace palpate::python
