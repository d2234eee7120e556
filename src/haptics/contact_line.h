// The two halves of LocalContact::at, which the couplings need one by one.
#pragma once

#include "palpate/haptics/local_contact.h"
#include "src/haptics/internal/matrix6.h"

namespace palpate::inline v0 {

/// What the tool has moved since it was measured, about its centre of mass.
Vec6 motion_since(const LocalContact& contact, const Pose& X_WT_now);

/// F - K (shift, turn), wherever it leads: beyond the end of the contact it pulls.
Wrench contact_line(const LocalContact& contact, const Pose& X_WT_now);

/// The part of a wrench on that line that the tool may feel.
Wrench limit_contact(const LocalContact& contact, const Wrench& line);

}  // namespace palpate::inline v0
