/// Paddle: a bat keeps a ball in the air, and earns double when it swings at the right moment.
#pragma once

#include "game.hpp"

namespace simulator {

/// The game as it is served.
class Paddle final : public Game {
 public:
  pb::GameSpec describe(const Options& options) const override;
  std::unique_ptr<Arena> open(const Options& options, std::uint64_t seed, std::uint64_t number) const override;
};

}  // namespace simulator
