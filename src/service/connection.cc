#include "service/connection.h"

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <string_view>

#include <boost/asio/write.hpp>
#include <fmt/format.h>

namespace raylift {
namespace {

constexpr uint32_t kMaxHeaderBytes = 16 << 10;
constexpr std::chrono::seconds kLinger(2);

using Message = http::request<GrowingBody>;

std::chrono::milliseconds Milliseconds(double seconds) {
  constexpr double kMsPerS = 1000;
  return std::chrono::milliseconds(static_cast<int64_t>(seconds * kMsPerS));
}

// Returns what is wrong with bytes that are no request; nullopt where the connection itself failed.
std::optional<Problem> ProblemOf(const error_code& error) {
  if (error == http::error::header_limit || error == http::error::buffer_overflow) {
    return Problem(431, fmt::format("the header has more than {} bytes", kMaxHeaderBytes));
  }
  if (error == http::error::body_limit) return Problem(413, "the body is too large");
  const bool is_of_connection =
      error == http::error::end_of_stream || error == http::error::partial_message ||
      error.category() != http::make_error_code(http::error::bad_target).category();
  if (is_of_connection) return std::nullopt;
  return Problem(400, fmt::format("this is no HTTP request: {}", error.message()));
}

std::string Text(beast::string_view view) { return {view.data(), view.size()}; }

// Refuses a request whose end is ambiguous: proxies and servers that disagree on where a request
// ends let one smuggle another.
std::optional<Problem> FramingProblem(const Message& message) {
  const size_t encodings = message.count(http::field::transfer_encoding);
  const bool is_chunked =
      encodings == 1 && beast::iequals(message[http::field::transfer_encoding], "chunked");
  const bool is_old = message.version() < 11;
  if (encodings > 0 && (is_old || !is_chunked || message.count(http::field::content_length) > 0)) {
    return Problem(400, "Transfer-Encoding",
                   "expected chunked alone, without Content-Length, of HTTP/1.1");
  }
  if (!is_old && message.count(http::field::host) != 1) {
    return Problem(400, "Host", "expected one Host");
  }
  return std::nullopt;
}

Problem TooManyBatches() { return TryLater(429, "too many batches are under way"); }

Problem QueueIsFull() { return TryLater(429, "too many photographs wait"); }

HttpRequest HeadOf(const Message& message) {
  return {.method = Text(message.method_string()),
          .target = Text(message.target()),
          .content_type = Text(message[http::field::content_type]),
          .authorization = Text(message[http::field::authorization]),
          .origin = Text(message[http::field::origin]),
          .body = {}};
}

}  // namespace

int Shared::NumBatches() const {
  return static_cast<int>(std::count_if(connections.begin(), connections.end(),
                                        [](const Connection* one) { return one->runs_batch(); }));
}

Connection::Connection(tcp::socket socket, Shared& shared)
    : shared_(shared), stream_(std::move(socket)) {
  shared_.connections.insert(this);
}

Connection::~Connection() {
  StandNowhere();
  shared_.held_bytes -= held_bytes_;
  shared_.connections.erase(this);
  if (shared_.on_closed) shared_.on_closed();
}

void Connection::ReadHeader() {
  parser_.emplace();
  parser_->header_limit(kMaxHeaderBytes);
  parser_->body_limit(shared_.options.limits.body_bytes);
  StandIn(shared_.idle);
  stream_.expires_after(Milliseconds(shared_.options.limits.header_s));
  http::async_read_header(stream_, buffer_, *parser_,
                          [self = shared_from_this()](error_code error, size_t) {
                            self->StandNowhere();
                            // The connection may have given way to another while its header was on
                            // its way to here.
                            if (self->stream_.socket().is_open()) self->OnHeader(error);
                          });
}

void Connection::Close() {
  StandNowhere();
  stream_.close();
}

bool Connection::CouldAsk() const {
  constexpr std::chrono::milliseconds kTimeToAsk(500);
  return place_ && std::chrono::steady_clock::now() - place_->since >= kTimeToAsk;
}

void Connection::StandIn(std::list<Connection*>& list) {
  place_.emplace(Place{.list = list, .position = list.insert(list.end(), this)});
}

void Connection::StandNowhere() {
  if (place_) place_->list.erase(place_->position);
  place_.reset();
}

void Connection::OnHeader(const error_code& error) {
  request_ = {};
  closes_ = true;
  if (error) return Fail(error);
  request_ = HeadOf(parser_->get());
  if (const auto problem = FramingProblem(parser_->get())) return Refuse(*problem);
  auto answer =
      shared_.service.AnswerHead(request_, shared_.is_ready, [this] { return shared_.Gauges(); });
  // The rest of a body that is not read would be taken for the next request.
  closes_ = !parser_->keep_alive() || (answer && !parser_->is_done());
  if (answer) return Write(std::move(*answer));
  if (Service::IsBatch(request_) && parser_->get().version() < 11) {
    return Refuse(Problem(400, "a batch is answered in chunks, as HTTP/1.1 has them"));
  }
  if (shared_.queue.IsFull()) return Refuse(QueueIsFull());
  if (beast::iequals(parser_->get()[http::field::expect], "100-continue")) return Continue();
  ReadBody();
}

void Connection::Fail(const error_code& error) {
  if (const auto problem = ProblemOf(error)) Refuse(*problem);
}

void Connection::Refuse(const Problem& problem) {
  closes_ = closes_ || !parser_->is_done();
  Write(shared_.service.Refuse(request_, problem));
}

void Connection::Continue() {
  static constexpr std::string_view kContinue = "HTTP/1.1 100 Continue\r\n\r\n";
  stream_.expires_after(Milliseconds(shared_.options.limits.write_s));
  asio::async_write(stream_, asio::buffer(kContinue.data(), kContinue.size()),
                    [self = shared_from_this()](error_code error, size_t) {
                      if (!error) self->ReadBody();
                    });
}

void Connection::ReadBody() {
  stream_.expires_after(Milliseconds(shared_.options.limits.body_s));
  ReadSome();
}

void Connection::ReadSome() {
  if (parser_->is_done()) return Submit();
  http::async_read_some(stream_, buffer_, *parser_,
                        [self = shared_from_this()](error_code error, size_t) {
                          if (error) return self->Fail(error);
                          if (self->CountBody()) self->ReadSome();
                        });
}

bool Connection::CountBody() {
  const size_t bytes = parser_->get().body().size();
  shared_.held_bytes += bytes - held_bytes_;
  held_bytes_ = bytes;
  if (shared_.held_bytes <= shared_.options.limits.held_bytes) return true;
  Refuse(TryLater(503, "too many bodies are being read"));
  return false;
}

void Connection::Submit() {
  request_.body = std::move(parser_->get().body());
  runs_batch_ = Service::IsBatch(request_);
  if (shared_.NumBatches() > shared_.queue.threads()) return Refuse(TooManyBatches());
  BeginWatch();
  const bool has_room = shared_.queue.TryAdd(
      runs_batch_
          ? Task([](Connection& c) { return c.shared_.service.BeginBatch(std::move(c.request_)); },
                 [](Connection& c, auto begun) { c.OnBatch(std::move(begun)); })
          : Task([](Connection& c) { return c.shared_.service.Localize(c.request_, c.watch_); },
                 [](Connection& c, HttpAnswer answer) { c.Write(std::move(answer)); }));
  if (!has_room) return Refuse(QueueIsFull());
  stream_.expires_never();
  NoteIfGone();
}

void Connection::BeginWatch() {
  watch_ = {.deadline = AnswerWatch::Clock::now() + Milliseconds(shared_.options.limits.answer_s),
            .is_gone = std::make_shared<std::atomic<bool>>(false)};
}

void Connection::NoteIfGone() {
  stream_.socket().async_wait(tcp::socket::wait_read,
                              [self = shared_from_this(), gone = watch_.is_gone](error_code error) {
                                if (self->watch_.is_gone != gone) return;
                                tcp::socket& socket = self->stream_.socket();
                                const bool is_left = error == asio::error::operation_aborted;
                                if (is_left && socket.is_open()) return;
                                if (error || socket.available(error) == 0) *gone = true;
                              });
}

void Connection::OnBatch(Service::BegunBatch begun) {
  batch_ = std::move(begun.batch);
  if (!batch_) return Write(std::move(begun.answer));
  SetResponse(begun.answer);
  response_.chunked(true);
  stream_.expires_after(Milliseconds(shared_.options.limits.write_s));
  streamed_.emplace(response_);
  http::async_write_header(stream_, *streamed_,
                           [self = shared_from_this()](error_code error, size_t) {
                             if (!error) self->GoOnWithBatch();
                           });
}

void Connection::GoOnWithBatch() {
  if (batch_->AtEnd()) {
    asio::async_write(stream_, http::make_chunk_last(),
                      [self = shared_from_this()](error_code error, size_t) {
                        self->batch_.reset();
                        self->OnWritten(error);
                      });
    return;
  }
  stream_.expires_never();
  watch_.deadline = AnswerWatch::Clock::now() + Milliseconds(shared_.options.limits.answer_s);
  shared_.queue.AddAgain(
      Task([](Connection& c) { return c.shared_.service.Next(*c.batch_, c.watch_); },
           [](Connection& c, auto line) { c.WriteLine(std::move(line)); }));
}

void Connection::WriteLine(Service::BatchLine line) {
  line_ = std::move(line.text);
  stream_.expires_after(Milliseconds(shared_.options.limits.write_s));
  asio::async_write(stream_, http::make_chunk(asio::buffer(line_)),
                    [self = shared_from_this()](error_code error, size_t) {
                      if (!error) self->GoOnWithBatch();
                    });
}

void Connection::SetResponse(const HttpAnswer& answer) {
  response_ = http::response<http::string_body>(static_cast<http::status>(answer.status), 11);
  response_.reason(PhraseOf(answer.status));
  response_.set(http::field::server, "raylift");
  response_.set(http::field::content_type, answer.content_type);
  response_.set(http::field::cache_control, "no-store");
  response_.set("X-Content-Type-Options", "nosniff");
  for (const auto& [name, value] : answer.headers) response_.set(name, value);
  closes_ = closes_ || !shared_.is_ready;
  response_.keep_alive(!closes_);
}

void Connection::Write(HttpAnswer answer) {
  SetResponse(answer);
  if (request_.method == "HEAD") {
    response_.content_length(answer.body.size());
  } else {
    response_.body() = std::move(answer.body);
    response_.prepare_payload();
  }
  stream_.expires_after(Milliseconds(shared_.options.limits.write_s));
  http::async_write(stream_, response_, [self = shared_from_this()](error_code error, size_t) {
    self->OnWritten(error);
  });
}

void Connection::OnWritten(const error_code& error) {
  watch_.is_gone.reset();
  runs_batch_ = false;
  request_ = {};
  parser_.reset();  // and with it a body that was refused
  shared_.held_bytes -= std::exchange(held_bytes_, 0);
  if (error) return;
  if (!closes_ && !shared_.is_draining) return ReadHeader();
  error_code ignored;
  stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
  stream_.expires_after(kLinger);
  StandIn(shared_.lingering);
  Linger();
}

void Connection::Linger() {
  buffer_.clear();
  stream_.async_read_some(buffer_.prepare(kMaxBufferBytes),
                          [self = shared_from_this()](error_code error, size_t) {
                            if (!error) self->Linger();
                          });
}

}  // namespace raylift
