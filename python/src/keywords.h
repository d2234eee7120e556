// Settings as keyword arguments: every table of settings is a way into Python too.
#pragma once

#include "palpate/settings/setting_table.h"
#include "python/src/arrays.h"

namespace palpate::python {

/// Sets what the keywords name: "stiffness" if only one section has it, "coupling_stiffness" or
/// "coupling.stiffness". palpate.Error: nothing is called so, with the nearest name; as of
/// Setting::set.
void apply(const nb::dict& keywords, SettingTable& table);

}  // namespace palpate::python
