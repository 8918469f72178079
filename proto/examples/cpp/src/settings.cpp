#include "settings.hpp"

#include <algorithm>

#include "refusal.hpp"

namespace simulator {
namespace {

/// Returns the thing of that name. Throws a Refusal that lists the names.
template <typename Things>
const auto& named(const Things& things, const std::string& name, const std::string& what) {
  const auto found =
      std::find_if(things.begin(), things.end(), [&](const auto& thing) { return thing.name() == name; });
  if (found == things.end()) {
    std::vector<std::string> names;
    for (const auto& thing : things) names.push_back(thing.name());
    throw invalid(text(what, " '", name, "' is unknown, expected one of ", list(names)));
  }
  return *found;
}

}  // namespace

Chosen choose(const Games& games, const std::string& name,
              const google::protobuf::Map<std::string, std::string>& given) {
  const auto found = games.find(name);
  if (found == games.end()) {
    std::vector<std::string> names;
    for (const auto& [known, game] : games) names.push_back(known);
    throw Refusal(grpc::StatusCode::NOT_FOUND, text("no game named '", name, "'; this server has ", list(names)));
  }
  const Game& game = *found->second;
  const pb::GameSpec spec = game.describe({});
  Options options;
  for (const pb::Option& option : spec.options()) options[option.name()] = option.default_choice();
  for (const auto& [key, choice] : given) {
    const auto& choices = named(spec.options(), key, name + ": option").choices();
    if (std::find(choices.begin(), choices.end(), choice) == choices.end()) {
      throw invalid(text(name, ": option '", key, "' got '", choice, "', expected one of ", list(choices)));
    }
    options[key] = choice;
  }
  return {game, options, game.describe(options)};
}

Parameters defaults(const pb::GameSpec& spec) {
  Parameters parameters;
  for (const pb::Parameter& parameter : spec.parameters()) parameters[parameter.name()] = parameter.default_value();
  return parameters;
}

double checked(const pb::GameSpec& spec, const std::string& name, double value) {
  const pb::Parameter& parameter = named(spec.parameters(), name, spec.name() + ": parameter");
  const double low = parameter.low(), high = parameter.high();
  if (value >= low && value <= high) return value;  // false for NaN
  throw invalid(text(spec.name(), ": parameter '", name, "' got ", value, ", expected ", low, "..", high));
}

void check_none(const pb::GameSpec& spec, const google::protobuf::Map<std::string, pb::Distribution>& distributions) {
  if (distributions.empty()) return;
  const std::string& name = distributions.begin()->first;
  const std::string what = spec.name() + ": parameter '" + name + "' cannot be drawn per episode; give it a value";
  throw Refusal(grpc::StatusCode::FAILED_PRECONDITION, what);
}

}  // namespace simulator
