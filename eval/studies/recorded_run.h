// A run that the program itself records, a hand on something seen, and what each method makes of
// the same run: what palpate replay RUN -o OUT --method METHOD does.
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "eval/context.h"
#include "palpate/contact/contact.h"
#include "palpate/tool/tool.h"

namespace palpate::eval {

class RecordedRun {
 public:
  /// A hand that is at these poses, a thousand a second, and feels nothing, in front of one depth
  /// frame. Kept in a folder of its own that goes with the object. Errors: as of record_run.
  static Result<RecordedRun> record(const Tool& tool, const FirstFrame& picture,
                                    const std::vector<Pose>& X_WT);

  /// What the tool measures at each pose by this method. Repeats the run and takes as long.
  Result<std::vector<Penetration>> by(const ContactOptions& options) const;

 private:
  /// Removed with the last run that has it.
  using Folder = std::shared_ptr<const std::filesystem::path>;
  explicit RecordedRun(Folder folder) : folder_(std::move(folder)) {}
  Folder folder_;
};

}  // namespace palpate::eval
