// Packs every mesh of a folder into a tool of another folder.
#pragma once

#include <string>

#include "apps/pack/pack_one.h"

namespace palpate::apps {

struct FolderJob {
  std::string meshes, tools;  ///< folders
  PackRequest request;
  bool pages = false;  ///< a page beside each tool
  bool json = false;
};

/// Packs meshes whose tool is not up to date, in the order of names; continues after bad meshes. A
/// tool is up to date if NAME.pack.json beside it matches this mesh, these options, this version of
/// Palpate and the tool file. Prints a summary. Error: something failed, or interrupted.
Status pack_folder(const FolderJob& job);

}  // namespace palpate::apps
