#include "palpate/viewer/viewer.h"

#include "src/viewer/server/connections.h"

#include <boost/asio/ip/host_name.hpp>
#include <boost/asio/ip/udp.hpp>
#include <boost/asio/ip/v6_only.hpp>
#include <exception>
#include <new>
#include <thread>
#include <utility>

#include "src/core/internal/guarded.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/viewer/server/http_connection.h"

namespace palpate { inline namespace v0 {
namespace {

using std::chrono::milliseconds;

constexpr std::size_t kMaxConnections = 64;  // limit of those that are not pages
constexpr milliseconds kQuickTick{16}, kSlowTick{250};

/// Returns the address by which other computers reach this one; its name if it has no network.
std::string name_in_network() {
  error_code error;
  asio::io_context context;
  asio::ip::udp::socket socket(context);
  socket.connect({asio::ip::make_address_v4("192.0.2.1"), 9}, error);  // sends nothing
  if (!error) {
    const auto here = socket.local_endpoint(error);
    if (!error) return here.address().to_string();
  }
  return asio::ip::host_name(error);
}

class Server : public ViewServer {
 public:
  Server(ViewSource& source, const ViewServerOptions& options, const DoorLimits& limits,
         asio::ip::address address)
      : shared_{ViewHub(source), options.token, static_cast<std::size_t>(options.max_pages),
                limits},
        address_(std::move(address)),
        acceptor_(context_),
        accept_pause_(context_.get_executor()),
        ticker_(context_) {
    shared_.wake = [this] {
      if (!is_quick_ && shared_.hub.is_requested(monotonic_now())) schedule(milliseconds(0));
    };
  }
  ~Server() override {
    context_.stop();
    if (thread_.joinable()) thread_.join();
  }

  Status listen(std::uint16_t port) {
    const tcp::endpoint endpoint(address_, port);
    error_code error;
    acceptor_.open(endpoint.protocol(), error);
    if (!error) acceptor_.set_option(asio::socket_base::reuse_address(true), error);
    if (!error && address_.is_v6()) acceptor_.set_option(asio::ip::v6_only(false), error);
    if (!error) acceptor_.bind(endpoint, error);
    if (!error) acceptor_.listen(asio::socket_base::max_listen_connections, error);
    if (!error) port_ = acceptor_.local_endpoint(error).port();
    if (error) return explain(error, port);
    accept();
    schedule(milliseconds(0));
    thread_ = std::thread([this] { run(); });
    return Done{};
  }

  std::string url() const override {
    std::string host = address_.is_unspecified() ? name_in_network() : address_.to_string();
    if (host.find(':') != std::string::npos) host = '[' + host + ']';
    const std::string query = shared_.token.empty() ? "" : "?token=" + shared_.token;
    return "http://" + host + ':' + std::to_string(port_) + '/' + query;
  }
  int num_pages() const noexcept override { return shared_.hub.num_pages(); }

 private:
  Error explain(error_code error, std::uint16_t port) const {
    const std::string where = "port " + std::to_string(port) + " on " + address_.to_string();
    if (error == asio::error::address_in_use) {
      return {Errc::unavailable, where + " is in use by another program; choose another port"};
    }
    if (error == asio::error::access_denied) {
      return {Errc::unavailable, where + " is not allowed for this user; choose a port above 1023"};
    }
    if (error == boost::system::errc::address_not_available) {
      return {Errc::invalid_argument,
              address_.to_string() +
                  " is not an address of this computer; give one that is, or 0.0.0.0 for all"};
    }
    return {Errc::unavailable, "cannot listen at " + where + ": " + error.message()};
  }

  void run() {
    take_rank(ThreadRank::viewer);
    // If memory runs out for one connection, the others go on.
    for (bool has_ended = false; !has_ended;) {
      guarded([&] { has_ended = (context_.run(), true); }, [](const Error&) {});
    }
  }

  void accept() {
    acceptor_.async_accept([this](error_code error, tcp::socket socket) {
      // An error may mean that no file descriptors are left: waits.
      const double wait = error ? 0.1 : limit_.take(monotonic_now());
      accept_pause_.begin(wait, [this] { accept(); });
      if (error) return;
      // Idle connections must not keep others out: the oldest one is closed.
      if (shared_.connections.size() >= kMaxConnections) shared_.connections.front()->close();
      error_code ignored;
      socket.set_option(tcp::no_delay(true), ignored);
      std::make_shared<HttpConnection>(shared_, std::move(socket))->read();
    });
  }

  void schedule(milliseconds delay) {
    is_quick_ = delay < kSlowTick;
    ticker_.expires_after(delay);
    ticker_.async_wait([this](error_code error) {
      if (!error) tick();
    });
  }

  void tick() {
    schedule(kSlowTick);  // whatever happens now
    const double now = monotonic_now();
    shared_.hub.poll(now);
    for (PageSocket* page : shared_.pages) {
      page->drop_if_stalled(now);
      page->pump(now);
    }
    if (shared_.hub.is_requested(now)) schedule(kQuickTick);
  }

  Shared shared_;
  asio::ip::address address_;
  std::uint16_t port_ = 0;
  asio::io_context context_{1};
  tcp::acceptor acceptor_;
  RateLimit limit_{shared_.limits.connections_per_second, shared_.limits.connections_at_once};
  Pause accept_pause_;
  asio::steady_timer ticker_;
  bool is_quick_ = false;
  std::thread thread_;
};

}  // namespace

Result<std::unique_ptr<ViewServer>> ViewServer::start(ViewSource& source,
                                                      const ViewServerOptions& options) {
  return start_view_server(source, options, {});
}

Result<std::unique_ptr<ViewServer>> start_view_server(ViewSource& source,
                                                      const ViewServerOptions& options,
                                                      const DoorLimits& limits) {
  if (source.content().tool == nullptr)
    return Error{Errc::invalid_argument, "the viewer has no tool to show"};
  if (options.max_pages < 1) return Error{Errc::invalid_argument, "max_pages must be at least 1"};
  if (!options.token.empty() && !is_good_token(options.token)) {
    return Error{Errc::invalid_argument, "the token must be 16 to 128 letters, digits, - and _"};
  }
  error_code error;
  const asio::ip::address address =
      asio::ip::make_address(options.address == "localhost" ? "127.0.0.1" : options.address, error);
  if (error) {
    return Error{Errc::invalid_argument,
                 "\"" + options.address +
                     "\" is not an IP address; give one of this computer, or 0.0.0.0 for all"};
  }
  try {
    ViewServerOptions used = options;
    if (used.token.empty() && !address.is_loopback()) used.token = make_token();
    auto server = std::make_unique<Server>(source, used, limits, address);
    if (const Status listening = server->listen(options.port); !listening) return listening.error();
    return std::unique_ptr<ViewServer>(std::move(server));
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& problem) {  // no thread, no random numbers
    return Error{Errc::unavailable, std::string("cannot start the viewer: ") + problem.what()};
  }
}

}}  // namespace palpate::v0
