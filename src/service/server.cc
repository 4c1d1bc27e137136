#include "raylift/service/server.h"

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <exception>
#include <new>
#include <string_view>
#include <thread>

#include "service/connection.h"
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/steady_timer.hpp>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr std::chrono::milliseconds kAcceptAgain(100);
constexpr std::chrono::milliseconds kMemoryAgain(10);

void Listen(const ServerOptions& options, tcp::acceptor& acceptor) {
  error_code error;
  const auto address = asio::ip::make_address(options.listen, error);
  if (error) {
    throw OptionError("listen", options.listen, "expected an IP address of this machine");
  }
  if (options.port < 0 || options.port > UINT16_MAX) {
    throw OptionError("port", std::to_string(options.port), "must lie between 0 and 65535");
  }
  const tcp::endpoint asked(address, static_cast<uint16_t>(options.port));
  acceptor.open(asked.protocol(), error);
  if (!error) acceptor.set_option(tcp::acceptor::reuse_address(true), error);
  if (!error) acceptor.bind(asked, error);
  if (!error) acceptor.listen(asio::socket_base::max_listen_connections, error);
  if (error == boost::system::errc::address_not_available) {
    throw OptionError("listen", options.listen, "is no address of this machine");
  }
  if (error) {
    throw OptionError("port", std::to_string(options.port),
                      fmt::format("{} at {}", error.message(), options.listen));
  }
}

// Refuses a client: what fits into a new socket's buffer goes out without waiting.
void SendAway(tcp::socket& socket) {
  constexpr std::string_view kAnswer =
      "HTTP/1.1 503 Service Unavailable\r\nRetry-After: 1\r\nConnection: close\r\n"
      "Content-Length: 0\r\n\r\n";
  error_code ignored;
  socket.non_blocking(true, ignored);
  socket.write_some(asio::buffer(kAnswer.data(), kAnswer.size()), ignored);
  socket.shutdown(tcp::socket::shutdown_send, ignored);
}

template <typename Begin>
void OnceThereIsMemory(const Begin& begin) {
  while (true) {
    try {
      return begin();
    } catch (const std::bad_alloc&) {
      std::this_thread::sleep_for(kMemoryAgain);
    }
  }
}

}  // namespace

class Server::Impl {
 public:
  Impl(OpenScenes open, const ServerOptions& options)
      : open_(std::move(open)), shared_(options), acceptor_(shared_.io), signals_(shared_.io) {
    Listen(options, acceptor_);
    shared_.service.Take(open_(), options.threads);
    shared_.on_closed = [this] { EndIfDone(); };
    // Signals wait for Run() from now on; before, they end the opening.
    for (const int signal : {SIGTERM, SIGINT, SIGHUP}) signals_.add(signal);
  }
  ~Impl() {
    shared_.on_closed = nullptr;
    ends_ = true;
    if (reopening_.joinable()) reopening_.join();
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  tcp::endpoint endpoint() const { return acceptor_.local_endpoint(); }

  void Run() {
    WaitForSignal();
    Accept();
    while (true) {
      try {
        shared_.io.run();
        return;
      } catch (const std::exception& error) {  // a connection's: it is closed by now
        Log(error.what());
        ResumeAccepting();
      }
    }
  }

  void Stop() {
    asio::post(shared_.io, [this] { Drain(); });
  }

 private:
  void Log(const std::string& message) const {
    if (shared_.options.log) shared_.options.log(message);
  }

  void Accept() {
    const auto accepting = std::make_shared<bool>();
    accepting_ = accepting;
    acceptor_.async_accept([this, accepting](error_code error, tcp::socket socket) {
      if (shared_.is_draining) return;
      if (error == asio::error::no_descriptors && CloseOne()) return Accept();
      if (error) return AcceptLater();
      try {
        Take(std::move(socket));
        Accept();
      } catch (const std::exception& failure) {  // memory has run out
        Log(failure.what());
        AcceptLater();
      }
    });
  }

  void Take(tcp::socket socket) {
    const auto most = static_cast<size_t>(shared_.options.limits.connections);
    if (shared_.connections.size() < most || CloseOne()) {
      std::make_shared<Connection>(std::move(socket), shared_)->ReadHeader();
    } else {
      SendAway(socket);
    }
  }

  // Closes an idle connection to make room: whoever holds connections open without a request keeps
  // nobody out, but newcomers do not take their places from each other before they could ask,
  // unless most places are idle. Returns whether one has given way.
  bool CloseOne() {
    if (!shared_.lingering.empty()) {
      shared_.lingering.front()->Close();
      return true;
    }
    if (shared_.idle.empty()) return false;
    const bool most_are_idle = shared_.idle.size() > shared_.connections.size() / 2;
    if (!most_are_idle && !shared_.idle.front()->CouldAsk()) return false;
    shared_.idle.front()->Close();
    return true;
  }

  // Accepts again where a failure may have taken the accepting handler with it.
  void ResumeAccepting() {
    if (shared_.is_draining || !accepting_.expired()) return;
    OnceThereIsMemory([this] { AcceptLater(); });
  }

  void AcceptLater() {
    accept_again_.expires_after(kAcceptAgain);
    accept_again_.async_wait([this](error_code error) {
      if (!error && !shared_.is_draining) Accept();
    });
  }

  // Waits for the next signal; none is lost.
  void WaitForSignal() {
    OnceThereIsMemory([this] {
      signals_.async_wait([this](error_code error, int signal) {
        if (!error) OnSignal(signal);
      });
    });
  }

  void OnSignal(int signal) {
    WaitForSignal();  // first: what follows may end the waiting
    if (signal == SIGHUP && shared_.is_draining) {
      EndIfDone();  // it came together with SIGTERM: nothing else may be left to wait for
    } else if (signal == SIGHUP) {
      Reopen();
    } else if (shared_.is_draining) {
      shared_.io.stop();
    } else if (std::exchange(shared_.is_ready, false) && shared_.options.drain_s > 0) {
      DrainLater();
    } else {
      Drain();
    }
  }

  void DrainLater() {
    drain_.expires_after(std::chrono::duration_cast<asio::steady_timer::duration>(
        std::chrono::duration<double>(shared_.options.drain_s)));
    drain_.async_wait([this](error_code error) {
      if (!error) Drain();
    });
  }

  void Drain() {
    if (std::exchange(shared_.is_draining, true)) return;
    shared_.is_ready = false;
    ends_ = true;
    drain_.cancel();
    error_code ignored;
    acceptor_.close(ignored);
    accept_again_.cancel();
    while (!shared_.idle.empty()) shared_.idle.front()->Close();
    EndIfDone();
  }

  void EndIfDone() {
    if (!shared_.is_draining || !shared_.connections.empty()) return;
    signals_.cancel();
    working_.reset();
  }

  void Reopen() {
    if (reopenings_asked_++ > 0) return;  // the thread sees it
    if (reopening_.joinable()) reopening_.join();
    try {
      reopening_ = std::thread([this] { ReopenWhileAsked(); });
    } catch (const std::exception& error) {  // no thread, or no memory for one
      reopenings_asked_ = 0;
      LogStays(error);
    }
  }

  // Opens the scenes again while that is asked for: a request that comes meanwhile may be about
  // later files.
  void ReopenWhileAsked() {
    const CallWatch call({.stop_wanted = [this] { return ends_.load(); }});
    int asked = 0;
    do {
      asked = reopenings_asked_;
      try {
        shared_.service.Take(open_(), 1);  // the other threads are for photographs
        Log("the scenes are opened anew");
      } catch (const Cancelled&) {
        return;
      } catch (const std::exception& error) {
        LogStays(error);
      }
    } while (reopenings_asked_.fetch_sub(asked) != asked);
  }

  void LogStays(const std::exception& error) const {
    Log(fmt::format("the scenes stay as they are: {}", error.what()));
  }

  const OpenScenes open_;
  Shared shared_;
  tcp::acceptor acceptor_;
  asio::signal_set signals_;
  std::weak_ptr<bool> accepting_;  // expired: no handler waits for a connection
  asio::steady_timer accept_again_{shared_.io}, drain_{shared_.io};
  asio::executor_work_guard<asio::io_context::executor_type> working_{shared_.io.get_executor()};
  std::thread reopening_;
  std::atomic<int> reopenings_asked_ = 0;
  std::atomic<bool> ends_ = false;  // opens nothing anew any more
};

Server::Server(OpenScenes open, const ServerOptions& options)
    : impl_(std::make_unique<Impl>(std::move(open), options)) {}

Server::~Server() = default;

std::string Server::url() const {
  const tcp::endpoint endpoint = impl_->endpoint();
  std::string address = endpoint.address().to_string();
  if (endpoint.address().is_v6()) address = "[" + address + "]";
  return fmt::format("http://{}:{}", address, endpoint.port());
}

void Server::Run() { impl_->Run(); }

void Server::Stop() { impl_->Stop(); }

}  // namespace raylift
