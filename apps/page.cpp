#include "apps/page.h"

#include <spawn.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <thread>

#include "apps/options.h"
#include "apps/terminal/terminal.h"

extern char** environ;

namespace palpate::apps {
namespace {

std::string environment(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

/// Returns "8787" for "http://127.0.0.1:8787/?token=...".
std::string port_of(const std::string& url) {
  const std::size_t host = url.find("://") + 3;
  const std::size_t end = url.find('/', host), colon = url.rfind(':', end);
  return colon == std::string::npos || colon < host ? "80" : url.substr(colon + 1, end - colon - 1);
}

/// Returns the ssh command to type on the user's own computer, if the session came by ssh.
std::string tunnel(const std::string& url) {
  // "client port server port"
  const std::string connection = environment("SSH_CONNECTION");
  const std::size_t client = connection.find(' ');
  if (client == std::string::npos) return {};
  const std::size_t begin = connection.find(' ', client + 1) + 1;
  const std::string here = connection.substr(begin, connection.find(' ', begin) - begin);
  const std::string user = environment("USER"), port = port_of(url);
  return "ssh -L " + port + ":127.0.0.1:" + port + " " + (user.empty() ? "" : user + "@") + here;
}

bool is_token(const std::string& text) {
  const auto is_fine = [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '-' ||
           c == '_';
  };
  return text.size() >= 16 && text.size() <= 128 && std::all_of(text.begin(), text.end(), is_fine);
}

}  // namespace

void add_page_options(CLI::App& app, const std::string& prefix, PageOptions& options) {
  options.prefix = prefix;
  app.add_option(prefix + "port", options.port,
                 "port of the page; 0: any free one; default: 8787, or the next free one")
      ->check(CLI::Range(0, 65535).description(""))
      ->each([&options](const std::string&) { options.is_port_given = true; })
      ->type_name("PORT")
      ->capture_default_str();
  app.add_option(prefix + "address", options.address,
                 "listen address of the page; any but loopback needs a token")
      ->type_name("ADDRESS")
      ->capture_default_str();
  app.add_option_function<std::string>(
         prefix + "token",
         [&options, flag = prefix + "token"](const std::string& text) {
           if (!is_token(text)) {
             usage_error(flag + ": must be 16 to 128 letters, digits, - and _");
           }
           options.token = text;
         },
         "access token; default: generated if one is needed")
      ->type_name("TOKEN");
}

bool has_screen() {
  return !environment("DISPLAY").empty() || !environment("WAYLAND_DISPLAY").empty();
}

namespace {

/// Opens the user's browser if there is a screen.
void open_browser(const std::string& url) {
  std::string program = "xdg-open", address = url;
  char* const arguments[] = {program.data(), address.data(), nullptr};
  pid_t process = 0;
  if (!has_screen() ||
      posix_spawnp(&process, program.c_str(), nullptr, nullptr, arguments, environ) != 0) {
    print_note("there is no screen or no xdg-open here: open the page by hand");
  }
}

/// Starts a server; at the next free port if the usual one is taken.
Result<std::unique_ptr<ViewServer>> start_server(ViewSource& source, const PageOptions& options) {
  constexpr int kNumTries = 20;
  auto server = ViewServer::start(source, options);
  ViewServerOptions next = options;
  for (int i = 1; !server && !options.is_port_given && i < kNumTries; ++i) {
    ++next.port;
    if (auto other = ViewServer::start(source, next)) {
      print_note("port " + std::to_string(options.port) + " is in use by another program: taking " +
                 std::to_string(next.port));
      return other;
    }
  }
  return server;
}

}  // namespace

Result<OpenPage> OpenPage::serve(ViewSource& source, const PageOptions& options,
                                 std::ostream& out) {
  auto server = start_server(source, options);
  if (!server) {
    return Error{server.error().code, server.error().message + " (" + options.prefix + "port, " +
                                          options.prefix + "address)"};
  }
  const std::string url = (*server)->url();
  out << "open " << url << " in a browser; Ctrl-C ends\n";
  const bool is_here_only = options.address.starts_with("127.") || options.address == "localhost";
  if (const std::string command = tunnel(url); is_here_only && !command.empty()) {
    out << "on the computer with the browser, first: " << command << "\n";
  }
  out << std::flush;
  if (options.opens_browser) open_browser(url);
  return OpenPage(*std::move(server));
}

void OpenPage::print_closing() const {
  constexpr std::chrono::milliseconds kTwoStates{600};
  if (server_->num_pages() > 0) std::this_thread::sleep_for(kTwoStates);
}

}  // namespace palpate::apps
