#pragma once

#include "palpate/session/session.h"

namespace palpate {

/// run_session with a session that exists; `source` is the one it was made for.
Result<RunLog> run_loop(Session& session, DepthSource& source, const PoseFunction& X_WT,
                        const RunCallbacks& callbacks);

}  // namespace palpate
