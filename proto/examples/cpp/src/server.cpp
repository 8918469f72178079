#include "server.hpp"

#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <iostream>
#include <limits>
#include <mutex>
#include <optional>
#include <set>
#include <stdexcept>

#include "joybridge/v1/bridge.grpc.pb.h"
#include "refusal.hpp"
#include "session.hpp"
#include "version.hpp"

namespace simulator {
namespace {

constexpr auto GRACE = std::chrono::seconds(2);  // time for clients to receive the status
const grpc::Status STOPPING(grpc::StatusCode::UNAVAILABLE, "the simulator is shutting down");

/// Runs a function that may throw and returns the status for the client.
template <typename Function>
grpc::Status status_of(Function function) {
  try {
    function();
    return grpc::Status::OK;
  } catch (const Refusal& refusal) {
    return refusal.status();
  } catch (const std::exception& error) {
    return {grpc::StatusCode::INTERNAL, error.what()};
  }
}

class Stream;

// Play passes bytes through: if gRPC decoded them, invalid bytes would look like the client's end of the stream.
using Simulator = pb::SimulatorService;
using Base = Simulator::WithCallbackMethod_ListGames<
    Simulator::WithCallbackMethod_DescribeGame<Simulator::WithRawCallbackMethod_Play<Simulator::Service>>>;

/// Answers the calls of joybridge.v1.SimulatorService, in gRPC's own threads.
class Service final : public Base {
 public:
  Service(const Games& games, std::size_t most_sessions) : games_(games), most_sessions_(most_sessions) {}

  grpc::ServerUnaryReactor* ListGames(grpc::CallbackServerContext* context, const pb::ListGamesRequest* request,
                                      pb::ListGamesResponse* response) override {
    return answered(context, [&] {
      check_version(request->version());
      *response->mutable_version() = own_version();
      for (const auto& [name, game] : games_) {
        pb::GameSummary& summary = *response->add_games();
        summary.set_name(name);
        summary.set_description(game->describe({}).description());
      }
    });
  }

  grpc::ServerUnaryReactor* DescribeGame(grpc::CallbackServerContext* context, const pb::DescribeGameRequest* request,
                                         pb::DescribeGameResponse* response) override {
    return answered(context, [&] {
      check_version(request->version());
      *response->mutable_version() = own_version();
      *response->mutable_spec() = choose(games_, request->game(), request->options()).spec;
    });
  }

  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* Play(grpc::CallbackServerContext* context) override;

  /// Ends all sessions, those that are still to come, too, and returns how many there were.
  std::size_t stop();

  /// Removes a stream that has ended.
  void forget(const std::shared_ptr<Stream>& stream);

 private:
  template <typename Function>
  static grpc::ServerUnaryReactor* answered(grpc::CallbackServerContext* context, Function function) {
    grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
    reactor->Finish(status_of(function));
    return reactor;
  }

  const Games& games_;
  const std::size_t most_sessions_;
  std::mutex mutex_;  // guards what follows
  std::set<std::shared_ptr<Stream>> streams_;
  bool stopping_ = false;
};

/// One Play stream, which reads a request, writes its response, and reads the next. gRPC calls the On... functions one
/// at a time, OnDone last; others that call a function hold a pointer, so the stream outlives every call.
class Stream final : public grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>,
                     public std::enable_shared_from_this<Stream> {
 public:
  Stream(Service& service, const Games& games) : service_(service), session_(games) {}

  void begin() { StartRead(&request_); }

  /// Ends the stream with a status, once the response that is being written is out. A read may be under way.
  void end(const grpc::Status& status) {
    const std::lock_guard lock(mutex_);
    if (ended_) return;
    ended_ = status;
    if (!writing_) Finish(status);
  }

  void OnReadDone(bool ok) override {
    if (!ok) return end(grpc::Status::OK);  // the client closed its half or is gone: no error
    const grpc::Status status = status_of([this] {
      pb::PlayRequest request;
      if (!grpc::SerializationTraits<pb::PlayRequest>::Deserialize(&request_, &request).ok()) {
        throw invalid("these bytes are no PlayRequest");
      }
      response_.Clear();  // Serialize writes into an empty buffer only
      bool own;           // whether it made a copy; not used
      grpc::SerializationTraits<pb::PlayResponse>::Serialize(session_.answer(request), &response_, &own);
    });
    if (!status.ok()) return end(status);
    const std::lock_guard lock(mutex_);
    if (ended_) return;
    writing_ = true;
    StartWrite(&response_);
  }

  void OnWriteDone(bool ok) override {
    const std::lock_guard lock(mutex_);
    writing_ = false;
    if (!ok) ended_ = grpc::Status::OK;  // the client has gone, so no status can reach it
    if (ended_) {
      Finish(*ended_);
    } else {
      StartRead(&request_);
    }
  }

  void OnDone() override { service_.forget(shared_from_this()); }

 private:
  Service& service_;
  Session session_;
  grpc::ByteBuffer request_, response_;
  std::mutex mutex_;  // guards what follows
  bool writing_ = false;
  std::optional<grpc::Status> ended_;  // and how
};

grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* Service::Play(grpc::CallbackServerContext*) {
  const auto stream = std::make_shared<Stream>(*this, games_);
  const std::lock_guard lock(mutex_);
  streams_.insert(stream);
  if (stopping_) {
    stream->end(STOPPING);
  } else if (streams_.size() > most_sessions_) {
    stream->end({grpc::StatusCode::RESOURCE_EXHAUSTED,
                 text(most_sessions_, " sessions are open already; close one or start the server with --sessions")});
  } else {
    stream->begin();
  }
  return stream.get();  // which stays in the set until `forget`
}

std::size_t Service::stop() {
  std::set<std::shared_ptr<Stream>> open;
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    open = streams_;
  }
  for (const auto& stream : open) stream->end(STOPPING);
  return open.size();
}

void Service::forget(const std::shared_ptr<Stream>& stream) {
  const std::lock_guard lock(mutex_);
  streams_.erase(stream);
}

/// Returns the most bytes of a request under a spec: an Act, or a Start with a snapshot, of as many arenas as there
/// may be, and 64 KiB for all else.
std::uint64_t largest_request(const pb::GameSpec& spec) {
  std::uint64_t row = 0;
  for (const pb::Behavior& behavior : spec.behaviors()) {
    const pb::Device& device = behavior.device();
    row += std::uint64_t{4} * behavior.agents_per_arena() * (device.axes_size() + device.branches_size());
  }
  return (1 << 16) + spec.max_arenas() * std::max<std::uint64_t>(row, spec.snapshot_bytes_per_arena());
}

/// Returns the most bytes of a request to any of these games, under any choice of an option.
int largest_request(const Games& games) {
  std::uint64_t largest = 0;
  for (const auto& [name, game] : games) {
    const pb::GameSpec spec = game->describe({});
    largest = std::max(largest, largest_request(spec));
    for (const pb::Option& option : spec.options()) {
      for (const std::string& choice : option.choices()) {
        largest = std::max(largest, largest_request(game->describe({{option.name(), choice}})));
      }
    }
  }
  return static_cast<int>(std::min<std::uint64_t>(largest, std::numeric_limits<int>::max()));
}

}  // namespace

void serve(const Games& games, const std::string& address, std::size_t most_sessions, const Files& files) {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);  // gRPC's threads inherit this: the signals wait for sigwait below

  grpc::EnableDefaultHealthCheckService(true);
  grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  Service service(games, most_sessions);
  int port = 0;
  grpc::ServerBuilder builder;
  builder.AddListeningPort(address, server_credentials(address, files), &port);
  builder.RegisterService(&service);
  builder.SetMaxReceiveMessageSize(largest_request(games));
  for (const auto algorithm : {GRPC_COMPRESS_DEFLATE, GRPC_COMPRESS_GZIP}) {  // gRPC unpacks before it looks at a limit
    builder.SetCompressionAlgorithmSupportStatus(algorithm, false);
  }
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);         // a second server on one port is an error
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, 30'000);  // detects clients that are lost
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 20'000);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, 5'000);
  const std::unique_ptr<grpc::Server> server = builder.BuildAndStart();
  if (!server || port == 0) {
    throw std::runtime_error(text("cannot listen on ", address, ": it is in use or not an address of this machine, or the files of TLS do not fit"));
  }
  server->GetHealthCheckService()->SetServingStatus(pb::SimulatorService::service_full_name(), true);
  const std::string host = address.substr(0, address.rfind(':'));
  std::cout << "joybridge simulator listening on " << host << ":" << port << std::endl;

  int signal = 0;
  sigwait(&signals, &signal);
  server->GetHealthCheckService()->SetServingStatus(false);
  if (const std::size_t open = service.stop()) {
    std::cerr << "shutting down: " << open << " open sessions end with UNAVAILABLE" << std::endl;
  }
  server->Shutdown(std::chrono::system_clock::now() + GRACE);
}

}  // namespace simulator
