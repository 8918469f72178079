#include "session.hpp"

#include <iostream>

#include "version.hpp"

namespace simulator {
namespace {

Refusal early(const std::string& what) {
  return {grpc::StatusCode::FAILED_PRECONDITION, what + "; open a new stream and begin with start"};
}

}  // namespace

pb::PlayResponse Session::answer(const pb::PlayRequest& request) {
  try {
    return respond(request);
  } catch (const Refusal&) {
    throw;
  } catch (const std::exception& error) {  // an error in the game or in this server
    const std::string moment = play_ ? text("step ", play_->steps()) : "start";
    const std::string& game = play_ ? play_->name() : request.start().game();
    const std::string what = text(game, " failed in ", moment, ": ", error.what());
    std::cerr << what << std::endl;
    throw Refusal(grpc::StatusCode::INTERNAL, what);
  }
}

pb::PlayResponse Session::respond(const pb::PlayRequest& request) {
  const auto* kind = request.GetDescriptor()->FindFieldByNumber(request.request_case());
  if (kind == nullptr) {
    throw invalid("an empty PlayRequest, or a request that this server does not know; send start, act, reset or save");
  }
  if (!play_ && !request.has_start()) throw early(kind->name() + " came before start");
  if (play_ && request.has_start()) throw early("start came a second time");
  pb::PlayResponse response;
  if (request.has_start()) {
    const pb::Start& start = request.start();
    check_version(start.version());
    play_.emplace(choose(games_, start.game(), start.options()), start);
    *response.mutable_started()->mutable_spec() = play_->spec();
    *response.mutable_started()->mutable_step() = play_->observe();
    *response.mutable_started()->mutable_version() = own_version();
  } else if (request.has_act()) {
    *response.mutable_step() = play_->act(request.act());
  } else if (request.has_reset()) {
    *response.mutable_step() = play_->reset(request.reset());
  } else {
    *response.mutable_snapshot() = play_->save();
  }
  return response;
}

}  // namespace simulator
