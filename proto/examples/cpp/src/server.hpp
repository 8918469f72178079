/// The gRPC server: the three calls, health, reflection, limits and shutdown.
#pragma once

#include "authentication.hpp"
#include "game.hpp"

namespace simulator {

/// Serves games to at most so many sessions at once, until SIGINT or SIGTERM; then ends open sessions with UNAVAILABLE.
///
/// `address` is HOST:PORT, port 0 being any free one; prints where it listens as one line. Throws std::runtime_error if
/// it cannot listen there, or is not protected there. To be called by the main thread before there are others.
void serve(const Games& games, const std::string& address, std::size_t most_sessions, const Files& files);

}  // namespace simulator
