// The two halves of LocalContact::at, which the couplings need one by one.
#pragma once

#include "palpate/haptics/local_contact.h"
#include "src/math/internal/matrix6.h"

namespace palpate { inline namespace v0 {

/// Returns the tool's motion since the measurement, about its center of mass.
Vec6 motion_since(const LocalContact& contact, const Pose& X_WT_now);

/// Returns F - K (shift, turn) without limits: beyond the end of the contact it pulls.
Wrench contact_line(const LocalContact& contact, const Pose& X_WT_now);

/// Limits a wrench on that line: it never pulls and grows to a few times the measured one.
Wrench limit_contact(const LocalContact& contact, const Wrench& line);

}}  // namespace palpate::v0
