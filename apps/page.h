// The page in a browser beside a verb.
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <optional>
#include <ostream>
#include <string>

#include "palpate/viewer/viewer.h"

namespace palpate::apps {

/// Options of the page on the command line: "--view-port" for the prefix "--view-", and so on.
struct PageOptions : ViewServerOptions {
  std::string prefix = {};
  bool is_port_given = false;  ///< else one that is taken makes way for the next one
  bool opens_browser = false;
};

/// Adds the options port, address and token with a prefix.
void add_page_options(CLI::App& app, const std::string& prefix, PageOptions& options);

/// True if there is a screen for open_browser(), which starts the user's browser.
bool has_screen();

/// Serves `source` while it exists, and prints how to open it, also from the user's own computer
/// in an ssh session. Opens the browser if the options say so.
class OpenPage {
 public:
  static Result<OpenPage> serve(ViewSource& source, const PageOptions& options, std::ostream& out);
  const ViewServer& server() const { return *server_; }
  /// Gives pages time to receive the end of the run.
  void print_closing() const;

 private:
  explicit OpenPage(std::unique_ptr<ViewServer> server) : server_(std::move(server)) {}
  std::unique_ptr<ViewServer> server_;
};

}  // namespace palpate::apps
