// Connections of clients, HTTP/1.1 by Boost.Beast. One thread moves bytes; those of a queue work on
// photographs, so that neither waits for the other.

#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <list>
#include <memory>
#include <new>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "service/service.h"
#include "service/work_queue.h"
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>

namespace raylift {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using asio::ip::tcp;
using boost::system::error_code;

// A body that takes memory as it comes, whatever length its header claims.
struct GrowingBody {
  using value_type = std::string;
  class reader {
   public:
    template <bool is_request, typename Fields>
    reader(http::header<is_request, Fields>&, value_type& body) : body_(body) {}
    void init(const boost::optional<uint64_t>&, error_code& error) { error = {}; }
    template <typename Buffers>
    size_t put(const Buffers& buffers, error_code& error) {
      const size_t before = body_.size();
      for (const asio::const_buffer buffer : beast::buffers_range_ref(buffers)) {
        body_.append(static_cast<const char*>(buffer.data()), buffer.size());
      }
      error = {};
      return body_.size() - before;
    }
    void finish(error_code& error) { error = {}; }

   private:
    value_type& body_;
  };
};

// The state that connections share. All but the queue's work is done on the one thread that runs
// `io`.
struct Shared {
  explicit Shared(const ServerOptions& asked)
      : options(asked),
        service(asked),
        // Work waits for half of the time at most; in the other half it is to be done.
        queue(asked.threads, asked.limits.queue, WorkQueue::Seconds(asked.limits.answer_s / 2)) {}

  std::vector<Gauge> Gauges() const {
    return {
        {"raylift_queue_waiting", "Requests that wait for a thread.",
         static_cast<double>(queue.NumWaiting())},
        {"raylift_queue_capacity", "How many may wait.", static_cast<double>(options.limits.queue)},
        {"raylift_threads", "Photographs that are worked on at once, at most.",
         static_cast<double>(queue.threads())},
        {"raylift_threads_busy", "Photographs that are worked on.",
         static_cast<double>(queue.NumInHand())},
        {"raylift_photograph_seconds", "What a photograph has taken a thread lately.",
         queue.usual().count()},
        {"raylift_connections", "Open connections.", static_cast<double>(connections.size())},
        {"raylift_body_bytes", "Bodies that are held.", static_cast<double>(held_bytes)},
        {"process_resident_memory_bytes", "Resident memory.", ResidentBytes()}};
  }

  int NumBatches() const;  // under way

  ServerOptions options;
  Service service;
  size_t held_bytes = 0;  // bodies in memory
  bool is_ready = true;   // else no more requests should be sent
  bool is_draining = false;
  std::set<class Connection*> connections;
  // Connections without a request, and connections that were answered and are about to end; the one
  // that has been so for longest is first.
  std::list<Connection*> idle, lingering;
  std::function<void()> on_closed;
  // These are destroyed first: what they hold refers to the others.
  asio::io_context io{1};
  WorkQueue queue;
};

// The connection of one client: reads a request, has it answered, writes the answer, and so on.
// Operations that wait for the network hold it, and so does its work in the queue, which lets go of
// it on the thread of `io`.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(tcp::socket socket, Shared& shared);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  void ReadHeader();
  // Closes the connection, which has no request under way.
  void Close();
  // Returns whether the client has had the time to send its request.
  bool CouldAsk() const;
  bool runs_batch() const { return runs_batch_; }

 private:
  void StandIn(std::list<Connection*>& list);
  void StandNowhere();
  void OnHeader(const error_code& error);
  void Fail(const error_code& error);
  void Refuse(const Problem& problem);
  void Continue();
  void ReadBody();
  void ReadSome();
  // Returns whether there is room for what has come, and refuses the request where there is not.
  bool CountBody();
  void Submit();
  void BeginWatch();

  template <typename Result>
  struct Job {
    std::shared_ptr<Connection> self;
    std::optional<Result> result = {};
    std::exception_ptr failure = {};
  };

  // Returns work for a thread of the queue; `then` takes its result on the thread of `io`. Where
  // either fails, the connection is closed: there is no memory even to tell.
  template <typename Work, typename Then>
  WorkQueue::Work Task(Work work, Then then) {
    using Result = decltype(work(*this));
    auto job = std::make_shared<Job<Result>>(Job<Result>{.self = shared_from_this()});
    return [job = std::move(job), work, then] {
      auto tells = WorkQueue::Tells::kNothing;
      try {
        job->result = work(*job->self);
        tells = WhatTells(*job->result);
      } catch (const std::exception&) {
        job->failure = std::current_exception();
      }
      PostUntilTaken(job->self->shared_.io, [job, then] {
        const std::shared_ptr<Connection> self = std::move(job->self);
        try {
          if (job->failure) std::rethrow_exception(job->failure);
          then(*self, std::move(*job->result));
        } catch (const std::exception&) {
          self->stream_.close();
          throw;
        }
      });
      return tells;
    };
  }
  static WorkQueue::Tells WhatTells(const HttpAnswer& answer) { return answer.tells; }
  static WorkQueue::Tells WhatTells(const Service::BatchLine& line) { return line.tells; }
  static WorkQueue::Tells WhatTells(const Service::BegunBatch&) {
    return WorkQueue::Tells::kNothing;
  }

  // Posts the handler, again and again where there is no memory for a while.
  template <typename Handler>
  static void PostUntilTaken(asio::io_context& io, const Handler& handler) {
    constexpr std::chrono::milliseconds kAgain(10);
    while (true) {
      try {
        return asio::post(io, handler);
      } catch (const std::bad_alloc&) {
        std::this_thread::sleep_for(kAgain);
      }
    }
  }

  // Watches for the end of a client that waits: one that sends nothing more has gone where the
  // socket can be read. (A client that sends its next request already is not watched any more.)
  void NoteIfGone();
  void OnBatch(Service::BegunBatch begun);
  void GoOnWithBatch();
  void WriteLine(Service::BatchLine line);
  void SetResponse(const HttpAnswer& answer);
  void Write(HttpAnswer answer);
  void OnWritten(const error_code& error);
  // Reads what still comes: closing at once would take the answer from a client that still sends.
  void Linger();

  Shared& shared_;
  beast::tcp_stream stream_;
  static constexpr size_t kMaxBufferBytes = size_t{64} << 10;
  beast::flat_buffer buffer_{kMaxBufferBytes};
  std::optional<http::request_parser<GrowingBody>> parser_;
  HttpRequest request_;
  size_t held_bytes_ = 0;
  AnswerWatch watch_;
  http::response<http::string_body> response_;
  std::unique_ptr<Service::Batch> batch_;  // null: it has asked for none
  std::optional<http::response_serializer<http::string_body>> streamed_;
  std::string line_;  // line of the batch that is being written
  struct Place {
    std::list<Connection*>& list;  // idle or lingering ones
    std::list<Connection*>::iterator position;
    std::chrono::steady_clock::time_point since = std::chrono::steady_clock::now();
  };
  std::optional<Place> place_;
  bool runs_batch_ = false;
  bool closes_ = true;  // after the answer
};

}  // namespace raylift
