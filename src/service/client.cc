#include "raylift/service/client.h"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string_view>
#include <thread>
#include <utility>

#include "base/json_text.h"
#include <boost/asio.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using boost::system::error_code;
using Clock = std::chrono::steady_clock;
using Response = http::response<http::string_body>;

// Runs the operation that `begin` starts to its end, as only asynchronous ones can be given up
// after a time.
template <typename Begin>
error_code Await(asio::io_context& context, const Begin& begin) {
  error_code result;
  begin([&result](const error_code& error, const auto&...) { result = error; });
  context.restart();
  context.run();
  return result;
}

std::string FormOf(const Query& query, const std::string& photograph, const std::string& boundary) {
  nlohmann::ordered_json facts = {{"name", query.name}};
  if (query.priors.focal_range == 1) {
    std::string camera = query.camera.ToString();
    if (const auto& sigma = query.priors.focal_sigma) {
      camera += " focal_sigma " + FormatDouble(*sigma);
    }
    facts["camera"] = camera;
  }
  return fmt::format(
      "--{0}\r\nContent-Disposition: form-data; name=\"query\"\r\n\r\n{1}\r\n"
      "--{0}\r\nContent-Disposition: form-data; name=\"image\"\r\n\r\n{2}\r\n--{0}--\r\n",
      boundary, JsonText(facts), photograph);
}

// Returns a text that does not stand in the photograph.
std::string BoundaryFor(const std::string& photograph) {
  std::string boundary = "raylift";
  while (photograph.find(boundary) != std::string::npos) boundary += '-';
  return boundary;
}

// Returns HOST:PORT; an address of version 6 stands in brackets.
std::string AuthorityOf(const ServerUrl& server) {
  const bool is_v6 = server.host.find(':') != std::string::npos;
  return is_v6 ? fmt::format("[{}]:{}", server.host, server.port)
               : fmt::format("{}:{}", server.host, server.port);
}

http::request<http::string_body> RequestOf(const ClientOptions& options, const Query& query,
                                           const std::string& photograph) {
  const std::string boundary = BoundaryFor(photograph);
  const ServerUrl& server = options.server;
  http::request<http::string_body> request(http::verb::post,
                                           server.path + "/v1/localize" + server.parameters, 11);
  request.set(http::field::host, AuthorityOf(server));
  request.set(http::field::user_agent, "raylift");
  request.set(http::field::connection, "close");
  request.set(http::field::content_type, "multipart/form-data; boundary=" + boundary);
  if (!options.token.empty()) request.set(http::field::authorization, "Bearer " + options.token);
  request.body() = FormOf(query, photograph, boundary);
  request.prepare_payload();
  return request;
}

// Sends the request and reads the answer. Returns an error where there is no answer.
error_code Exchange(const ServerUrl& server, const http::request<http::string_body>& request,
                    Clock::duration patience, Response& response) {
  asio::io_context context;
  error_code error;
  asio::ip::tcp::resolver resolver(context);
  const auto addresses = resolver.resolve(server.host, server.port, error);
  if (error) return error;
  beast::tcp_stream stream(context);
  stream.expires_after(patience);
  error = Await(context, [&](auto done) { stream.async_connect(addresses, done); });
  if (error) return error;
  // A server that refuses a photograph may answer before it has read it.
  const error_code unwritten =
      Await(context, [&](auto done) { http::async_write(stream, request, done); });
  beast::flat_buffer buffer;
  http::response_parser<http::string_body> parser;
  constexpr uint64_t kMaxAnswerBytes = 64 << 20;
  parser.body_limit(kMaxAnswerBytes);
  error = Await(context, [&](auto done) { http::async_read(stream, buffer, parser, done); });
  if (error) return unwritten ? unwritten : error;
  response = parser.release();
  return {};
}

// Returns how long to wait before the same request is sent again; nullopt where it never will be
// answered.
std::optional<std::chrono::seconds> RetryAfter(const Response& response) {
  const bool is_busy = response.result() == http::status::too_many_requests ||
                       response.result() == http::status::service_unavailable;
  const std::string after(response[http::field::retry_after]);
  const auto seconds = ParseInt(after);
  constexpr int64_t kLongest = 86'400;
  if (!is_busy || !seconds || *seconds < 0 || *seconds > kLongest) return std::nullopt;
  return std::chrono::seconds(std::max<int64_t>(*seconds, 1));
}

// Returns the detail of a problem's JSON, or the status where there is none.
std::string DetailOf(const Response& response) {
  const auto problem = nlohmann::json::parse(response.body(), nullptr, false);
  if (problem.is_object() && problem.contains("detail") && problem["detail"].is_string()) {
    return problem["detail"].get<std::string>();
  }
  return fmt::format("{} {}", response.result_int(), std::string(response.reason()));
}

}  // namespace

ServerUrl ServerUrl::Parse(const std::string& text) {
  constexpr std::string_view kHttp = "http://";
  if (text.starts_with("https://")) {
    throw InputError(
        "https is not spoken here: give the http:// address of the server itself, or of a proxy "
        "on this machine that encrypts");
  }
  if (!text.starts_with(kHttp)) throw InputError("expected http://HOST:PORT");
  ServerUrl url;
  const size_t authority_end = std::min(text.find_first_of("/?", kHttp.size()), text.size());
  const std::string authority = text.substr(kHttp.size(), authority_end - kHttp.size());
  const size_t question = std::min(text.find('?', authority_end), text.size());
  url.path = text.substr(authority_end, question - authority_end);
  if (url.path.ends_with('/')) url.path.pop_back();
  url.parameters = text.substr(question);
  // The colons of an address of version 6 stand in brackets.
  const size_t colon =
      authority.find(':', authority.find(']') == std::string::npos ? 0 : authority.find(']'));
  url.host = authority.substr(0, colon);
  url.port = colon == std::string::npos ? "80" : authority.substr(colon + 1);
  if (url.host.starts_with('[') && url.host.ends_with(']')) {
    url.host = url.host.substr(1, url.host.size() - 2);
  }
  const auto port = ParseInt(url.port);
  const bool is_clean = text.find_first_of(" \t\r\n@#") == std::string::npos;
  if (url.host.empty() || !port || *port < 1 || *port > 65535 || !is_clean) {
    throw InputError("expected http://HOST:PORT");
  }
  return url;
}

std::string Client::Localize(const Query& query, const std::string& photograph) const {
  const auto request = RequestOf(options_, query, photograph);
  constexpr std::chrono::seconds kAfterCut(1);  // a busy server closes what it does not read
  const auto give_up = Clock::now() + options_.patience;
  const ServerUrl& server = options_.server;
  while (true) {
    Response response;
    const error_code error =
        Exchange(server, request, std::max<Clock::duration>(give_up - Clock::now(), {}), response);
    const bool was_cut = error == asio::error::connection_reset ||
                         error == asio::error::broken_pipe || error == http::error::end_of_stream;
    if (was_cut && Clock::now() + kAfterCut < give_up) {
      std::this_thread::sleep_for(kAfterCut);
      continue;
    }
    if (error) {
      throw InputError(fmt::format("http://{}: {}", AuthorityOf(server), error.message()));
    }
    if (response.result() == http::status::ok) return std::move(response.body());
    const auto wait = RetryAfter(response);
    if (!wait || Clock::now() + *wait > give_up) {
      throw InputError(
          fmt::format("{}: the server refuses it: {}", query.name, DetailOf(response)));
    }
    std::this_thread::sleep_for(*wait);
  }
}

}  // namespace raylift
