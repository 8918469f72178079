/// What a client chooses: a game, its options and its parameters, by name.
#pragma once

#include "game.hpp"

namespace simulator {

/// A game under the options that were chosen.
struct Chosen {
  const Game& game;
  Options options;
  pb::GameSpec spec;
};

/// Returns the named game under the given options, defaults filled in. Throws a Refusal for a name it does not know.
Chosen choose(const Games& games, const std::string& name,
              const google::protobuf::Map<std::string, std::string>& given);

/// Returns the defaults of all parameters.
Parameters defaults(const pb::GameSpec& spec);

/// Returns the value of the named parameter. Throws a Refusal for an unknown name or a value out of its range.
double checked(const pb::GameSpec& spec, const std::string& name, double value);

/// Throws a Refusal if there are distributions: this server does not draw parameters per episode.
void check_none(const pb::GameSpec& spec, const google::protobuf::Map<std::string, pb::Distribution>& distributions);

}  // namespace simulator
