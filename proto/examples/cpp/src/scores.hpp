/// What a policy scores in a game, without a trainer and without a connection.
#pragma once

#include "game.hpp"

namespace simulator {

/// Lets a policy that `joybridge export RUN policy.json` wrote play so many episodes of its game. Returns means and
/// half the widths of their 95 % confidence intervals, as text. Throws for what is no policy of these games.
std::string scores(const Games& games, const std::string& policy, int episodes, std::uint64_t seed);

}  // namespace simulator
