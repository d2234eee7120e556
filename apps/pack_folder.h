// Every mesh of a folder becomes a tool of another folder.
#pragma once

#include <string>

#include "apps/pack_one.h"

namespace palpate::apps {

struct FolderJob {
  std::string meshes, tools;  ///< folders
  PackRequest request;
  bool pages = false;  ///< a page beside each tool
  bool json = false;
};

/// Packs what is not up to date, in the order of names; carries on past bad meshes. A tool is up to
/// date if NAME.pack.json beside it names this mesh as read, these options, this version of Palpate
/// and the tool file as it is. Prints what was done; Error: something failed, or interrupted.
Status pack_folder(const FolderJob& job);

}  // namespace palpate::apps
