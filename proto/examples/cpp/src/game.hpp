/// The interface of a game: a spec, and arenas with one agent each. To serve your own game, write it like paddle.cpp
/// and name it in main.cpp; no other file mentions the game.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "joybridge/v1/bridge.pb.h"

namespace simulator {

namespace pb = joybridge::v1;

using Options = std::map<std::string, std::string>;  // a choice for every option
using Parameters = std::map<std::string, double>;    // a value for every parameter

/// What one agent does in one decision. Ranges and masks have been checked.
struct Action {
  std::span<const float> axes;            // a value per axis
  std::span<const std::int32_t> choices;  // the index of a choice per branch
};

enum class End { none, terminated, truncated };

/// What an agent gets after one decision.
struct TimeStep {
  std::vector<float> rewards;  // per channel
  End end = End::none;
  std::vector<float> metrics;  // per metric; sent where the episode ended
};

/// One copy of a game.
class Arena {
 public:
  virtual ~Arena() = default;

  /// Begins a new episode, which is played with these parameters.
  virtual void begin(const Parameters& parameters) = 0;

  /// Plays one decision. After an end, `observe` returns the last observation until `begin`.
  virtual TimeStep step(const Action& action) = 0;

  /// Returns the numbers of each sensor, row-major.
  virtual std::vector<std::vector<float>> observe() const = 0;

  /// Returns which choices are allowed now, per branch.
  virtual std::vector<std::vector<bool>> masks() const = 0;

  /// Returns a picture: height * width * 3 bytes, red, green and blue.
  virtual std::string draw() const = 0;

  /// Returns the complete state; its length is always the same.
  virtual std::string save() const = 0;

  /// Restores a state of the length that `save` returns. Throws std::invalid_argument for an impossible state.
  virtual void restore(const std::string& state) = 0;
};

/// A game of one behavior, with one agent per arena and sensors of FLOAT32.
class Game {
 public:
  virtual ~Game() = default;

  /// Returns the spec under the given choices; an option that is left out has its default.
  virtual pb::GameSpec describe(const Options& options) const = 0;

  /// Makes an arena; call `begin` next. All its randomness comes from the seed and its number.
  virtual std::unique_ptr<Arena> open(const Options& options, std::uint64_t seed, std::uint64_t number) const = 0;
};

/// The most that a session itself adds to a snapshot. It counts for every arena, since there may be only one.
constexpr std::uint32_t SESSION_BYTES = 512;

using Games = std::map<std::string, std::unique_ptr<Game>>;  // by name

}  // namespace simulator
