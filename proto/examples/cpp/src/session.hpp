/// One session: the order of its messages, and the status of each error. It does not use gRPC's connections.
#pragma once

#include <optional>

#include "play.hpp"

namespace simulator {

/// The requests of one stream.
class Session {
 public:
  /// Begins a session that has not been started. The games must outlive it.
  explicit Session(const Games& games) : games_(games) {}

  /// Returns the response to one request. Throws a Refusal; the session must then end.
  pb::PlayResponse answer(const pb::PlayRequest& request);

 private:
  pb::PlayResponse respond(const pb::PlayRequest& request);

  const Games& games_;
  std::optional<Play> play_;  // empty before Start
};

}  // namespace simulator
