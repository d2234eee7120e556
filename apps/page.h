// The page in a browser beside a verb.
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <optional>
#include <ostream>
#include <string>

#include "palpate/viewer/viewer.h"

namespace palpate::apps {

/// PREFIX-port, PREFIX-address and PREFIX-token, e.g. "--view-port" for the prefix "--view-".
void add_page_options(CLI::App& app, const std::string& prefix, ViewServerOptions& options);

/// Serves `source` while it exists, and prints how to open it: on another computer too, if
/// they have come here by ssh.
class OpenPage {
 public:
  static Result<OpenPage> serve(ViewSource& source, const ViewServerOptions& options,
                                std::ostream& out);
  const ViewServer& server() const { return *server_; }
  /// Lets pages hear how it ended.
  void print_closing() const;

 private:
  explicit OpenPage(std::unique_ptr<ViewServer> server) : server_(std::move(server)) {}
  std::unique_ptr<ViewServer> server_;
};

}  // namespace palpate::apps
